"""The directions that norms leave free, by name, and the uncertainty of a result there.

The right singular vectors of J with a zero singular value are not observed by any group: always the
three rotations of the triad, and further directions of the plan. Without a tilt of a second kind no
pose excites x and y together, and Exy + Eyx is not observed. A direction that only accidental
deviations of the mountings show, known no better than a tenth of its natural size, counts as not
observed.

The groups determine the other directions Q, with the errors ε of M a + p − f by noise and bench;
along the null directions N the result equals the start::

    θ̂ − θ = N Nᵀ (start − θ) − J⁺ (2 v·ε)

to first order, J⁺ within Q. So the covariance of the start enters fully along N: it comes from the
untilted states, from stated priors, or from the bounds of a search. None of it comes from damping.
"""

from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.estimation import NullDirection
from inercal.methods.observability import OBSERVABILITY_LIMIT, direction_in_words
from inercal.methods.ship_multi_angle.norm_equations import (
    RANK_TOLERANCE,
    norm_jacobian,
    rotation_directions,
)
from inercal.physics.sensors import Sensor
from inercal.physics.sensors.affine import AFFINE_NAMES, AffineModel, to_coefficients


class GroupInformation(NamedTuple):
    """The information of r groups at a solution, of (...) trials."""

    singular_values: Array  # (..., 12) singular values of J, descending
    null_projector: Array  # (..., 12, 12), N Nᵀ
    gain: Array  # (..., 12, 3 r), θ by ε of each group, axes within


def group_information(model: AffineModel, a: Array) -> GroupInformation:
    """Return the information of readings (..., r, 3) in g at a solution."""
    j = norm_jacobian(model, a)
    u, s, vt = np.linalg.svd(j, full_matrices=False)
    there = s > RANK_TOLERANCE * s[..., :1]
    inverse = np.where(there, 1 / np.where(there, s, 1.0), 0.0)
    v = np.swapaxes(vt, -1, -2)
    known = v * there[..., None, :]
    back = (v * inverse[..., None, :]) @ np.swapaxes(u, -1, -2)
    sensed = 2 * model.correct(a)
    gain = -back[..., None] * sensed[..., None, :, :]
    return GroupInformation(
        np.asarray(s), np.eye(12) - known @ vt, gain.reshape(*gain.shape[:-2], 3 * a.shape[-2])
    )


class FreeDirections(NamedTuple):
    """Directions of the coefficients that norms leave free at one solution."""

    rotations: tuple[NullDirection, ...]
    unobserved: tuple[NullDirection, ...]  # by the plan, in addition to the rotations
    rank: int  # of the others
    weak: tuple[NullDirection, ...]  # observed, but no better than a tenth of their natural size


def free_directions(sensor: Sensor, model: AffineModel, a: Array, spread: Array) -> FreeDirections:
    """Return the directions that the groups of one table leave free.

    Parameters
    ----------
    sensor : Sensor
    model : AffineModel
        The solution.
    a : (r, 3) array
        Readings of the groups, g.
    spread : (3 r, 3 r) array
        Covariance of M a + p − f over the groups, g².
    """
    _, slope = to_coefficients(sensor, model)
    here = group_information(model, a)
    turned = rotation_directions(model)
    turns = tuple(
        _null_direction(sensor, slope @ move, f"rotation of the triad about {axis}")
        for axis, move in zip("xyz", turned, strict=True)
    )
    nothing = here.singular_values <= RANK_TOLERANCE * here.singular_values[0]
    basis = np.linalg.svd(here.null_projector)[0][:, : int(nothing.sum())]
    frame = np.linalg.qr(turned.T)[0]
    left, size, _ = np.linalg.svd(basis - frame @ (frame.T @ basis))
    rest = left[:, : int((size > 1e-6).sum())].T
    blind = tuple(
        _null_direction(sensor, slope @ move, f"the plan's own {_direction_in_theta(move)}")
        for move in rest
    )
    covariance = here.gain @ spread @ here.gain.T
    variance, moves = np.linalg.eigh(covariance)
    weak = tuple(
        _null_direction(
            sensor,
            slope @ move,
            f"{_direction_in_theta(move)} (standard deviation {np.sqrt(v):.2g})",
        )
        for v, move in zip(variance, moves.T, strict=True)
        if v > OBSERVABILITY_LIMIT**2
    )
    return FreeDirections(turns, blind, 12 - int(nothing.sum()) - len(weak), weak)


def undetermined_rotations(sensor: Sensor, left: FreeDirections) -> tuple[NullDirection, ...]:
    """Return the rotations that a start or chance decides: none where a frame is stated."""
    return left.rotations if sensor.frame == "mount" else ()


def _null_direction(sensor: Sensor, move: Array, words: str) -> NullDirection:
    scaled = move / sensor.unit_scale
    # Of equal parts the first has the sign +: which is larger by rounding is chance.
    scaled = scaled / scaled[np.argmax(np.abs(scaled) > (1 - 1e-6) * np.abs(scaled).max())]
    weights: dict[str, float] = {
        name: float(w) for name, w in zip(sensor.coefficients, scaled, strict=True) if abs(w) > 1e-9
    }
    return NullDirection(weights, f"{words}: {direction_in_words(scaled, sensor.coefficients)}")


def _direction_in_theta(move: Array) -> str:
    """Return the large parts of a direction in the source's names: "Exy + Eyx"."""
    large = np.flatnonzero(np.abs(move) > 0.3 * np.abs(move).max())
    move = move / move[large[0]]
    words = ""
    for k in large.tolist():
        size = "" if f"{abs(move[k]):.1f}" == "1.0" else f"{abs(move[k]):.2g} "
        words += (" − " if move[k] < 0 else " + " if words else "") + size + AFFINE_NAMES[k]
    return words
