"""What norms leave free, by name, and what a result that norms alone made is worth there.

The right singular vectors of J whose singular value is nothing are what no group sees: three
rotations of the triad always, and what the plan is blind to besides. Without a tilt of a second
kind no pose presses on x and y together, and Exy + Eyx goes unseen. What only accidents of the
mountings show, known no better than a tenth of its natural size, does not count as seen.

The other directions Q are told by the groups, with the errors ε of M a + p − f by noise and bench;
along the null directions N the result is as the start was::

    θ̂ − θ = N Nᵀ (start − θ) − J⁺ (2 v·ε)

to first order, J⁺ within Q. So the covariance of the start enters along N, whole: it comes from the
untilted states, from stated priors, or from the bounds of a search. None of it comes from damping.
"""

from typing import NamedTuple

import numpy as np

from inercal.arrays import Array
from inercal.estimate import NullDirection
from inercal.methods.observed import OBSERVED, in_natural_words
from inercal.methods.ship_multi_angle.norms import NOTHING, rotations, rows
from inercal.sensors import Sensor
from inercal.sensors.affine import NAMES, Affine, to_coefficients


class Seen(NamedTuple):
    """What r groups tell at a solution, of (...) trials."""

    values: Array  # (..., 12) singular values of J, descending
    free: Array  # (..., 12, 12), N Nᵀ
    gain: Array  # (..., 12, 3 r), θ by ε of each group, axes within


def seen(model: Affine, a: Array) -> Seen:
    """Return what readings (..., r, 3) in g tell at a solution."""
    j = rows(model, a)
    u, s, vt = np.linalg.svd(j, full_matrices=False)
    there = s > NOTHING * s[..., :1]
    inverse = np.where(there, 1 / np.where(there, s, 1.0), 0.0)
    v = np.swapaxes(vt, -1, -2)
    known = v * there[..., None, :]
    back = (v * inverse[..., None, :]) @ np.swapaxes(u, -1, -2)
    felt = 2 * model.correct(a)
    gain = -back[..., None] * felt[..., None, :, :]
    return Seen(
        np.asarray(s), np.eye(12) - known @ vt, gain.reshape(*gain.shape[:-2], 3 * a.shape[-2])
    )


class Free(NamedTuple):
    """Directions of the coefficients that norms leave free at one solution."""

    turns: tuple[NullDirection, ...]
    blind: tuple[NullDirection, ...]  # what the plan does not see besides
    rank: int  # of the others
    weak: tuple[NullDirection, ...]  # what it sees, no better than a tenth of its natural size


def free(sensor: Sensor, model: Affine, a: Array, spread: Array) -> Free:
    """Return what one table's groups leave free.

    Parameters
    ----------
    sensor : Sensor
    model : Affine
        The solution.
    a : (r, 3) array
        Readings of the groups, g.
    spread : (3 r, 3 r) array
        Covariance of M a + p − f over the groups, g².
    """
    _, slope = to_coefficients(sensor, model)
    here = seen(model, a)
    turned = rotations(model)
    turns = tuple(
        _named(sensor, slope @ move, f"rotation of the triad about {axis}")
        for axis, move in zip("xyz", turned, strict=True)
    )
    nothing = here.values <= NOTHING * here.values[0]
    basis = np.linalg.svd(here.free)[0][:, : int(nothing.sum())]
    frame = np.linalg.qr(turned.T)[0]
    left, size, _ = np.linalg.svd(basis - frame @ (frame.T @ basis))
    rest = left[:, : int((size > 1e-6).sum())].T
    blind = tuple(
        _named(sensor, slope @ move, f"the plan's own {_in_theta(move)}") for move in rest
    )
    covariance = here.gain @ spread @ here.gain.T
    variance, moves = np.linalg.eigh(covariance)
    weak = tuple(
        _named(sensor, slope @ move, f"{_in_theta(move)} (standard deviation {np.sqrt(v):.2g})")
        for v, move in zip(variance, moves.T, strict=True)
        if v > OBSERVED**2
    )
    return Free(turns, blind, 12 - int(nothing.sum()) - len(weak), weak)


def turns_left(sensor: Sensor, left: Free) -> tuple[NullDirection, ...]:
    """Return the rotations that are left to a start or to chance: none where a frame is stated."""
    return left.turns if sensor.frame == "mount" else ()


def _named(sensor: Sensor, move: Array, words: str) -> NullDirection:
    scaled = move / sensor.unit_scale
    scaled = scaled / scaled[np.argmax(np.abs(scaled))]
    weights: dict[str, float] = {
        name: float(w) for name, w in zip(sensor.coefficients, scaled, strict=True) if abs(w) > 1e-9
    }
    return NullDirection(weights, f"{words}: {in_natural_words(scaled, sensor.coefficients)}")


def _in_theta(move: Array) -> str:
    """Return the large parts of a direction in the source's names: "Exy + Eyx"."""
    large = np.flatnonzero(np.abs(move) > 0.3 * np.abs(move).max())
    move = move / move[large[0]]
    words = ""
    for k in large.tolist():
        size = "" if f"{abs(move[k]):.1f}" == "1.0" else f"{abs(move[k]):.2g} "
        words += (" − " if move[k] < 0 else " + " if words else "") + size + NAMES[k]
    return words
