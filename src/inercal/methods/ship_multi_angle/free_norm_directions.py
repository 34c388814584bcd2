"""Find the directions that norms leave free, and the uncertainty of a result along them.

The right singular vectors of J with a zero singular value are not observed by any group. The three
rotations of the triad are always among them, and the plan may add others. Without a tilt of a
second kind no pose excites x and y together, so Exy + Eyx is not observed. A direction that only
accidental deviations of the mountings excite, with an uncertainty above a tenth of its natural
size, counts as not observed.

The groups determine the other directions Q, with the errors ε of M a + p − f from noise and bench.
Along the null directions N the result equals the start. To first order, with J⁺ within Q::

    θ̂ − θ = N Nᵀ (start − θ) − J⁺ (2 v·ε)

The covariance of the start is therefore fully included along N. This covariance comes from the
untilted states, from stated priors, or from the bounds of a search. Damping does not contribute to
it.

This module also computes the start of the damped iteration and its uncertainty along these
directions.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Bools
from inercal.basics.errors import InputError, NotObserved
from inercal.benches.rate_table.bench import RateTable, sensed_motion
from inercal.estimation import NullDirection
from inercal.estimation.nullspace import first_combinations
from inercal.methods import Priors
from inercal.methods.observability import OBSERVABILITY_LIMIT, direction_in_words
from inercal.methods.ship_multi_angle.norm_equations import (
    RANK_TOLERANCE,
    norm_jacobian,
    rotation_directions,
)
from inercal.methods.ship_planar import fit_level_states, require_excitation
from inercal.physics.plan import Spins
from inercal.physics.sensors import G0, Sensor, affine
from inercal.physics.sensors.affine import AffineModel
from inercal.recordings import Observations


class GroupInformation(NamedTuple):
    """The information that r groups contain at a solution, for (...) trials."""

    singular_values: Array  # (..., 12) singular values of J, descending
    null_projector: Array  # (..., 12, 12), N Nᵀ
    gain: Array  # (..., 12, 3 r), sensitivity of θ to ε in each group; axis index varies fastest


def group_information(model: AffineModel, a: Array) -> GroupInformation:
    """Return the information that readings (..., r, 3) in g contain at a solution."""
    j = norm_jacobian(model, a)
    u, s, vt = np.linalg.svd(j, full_matrices=False)
    there = s > RANK_TOLERANCE * s[..., :1]
    inverse = np.where(there, 1 / np.where(there, s, 1.0), 0.0)
    v = vt.mT
    known = v * there[..., None, :]
    back = (v * inverse[..., None, :]) @ u.mT
    sensed = 2 * model.correct(a)
    gain = -back[..., None] * sensed[..., None, :, :]
    return GroupInformation(
        np.asarray(s), np.eye(12) - known @ vt, gain.reshape(*gain.shape[:-2], 3 * a.shape[-2])
    )


class FreeDirections(NamedTuple):
    """Directions in the space of coefficients that norms leave free at one solution."""

    rotations: tuple[NullDirection, ...]  # of the triad; none if a frame is stated
    unobserved: tuple[NullDirection, ...]  # due to the plan, in addition to the rotations
    rank: int  # of the other directions
    weak: tuple[NullDirection, ...]  # observed, but with an uncertainty above the limit


def free_directions(sensor: Sensor, model: AffineModel, a: Array, spread: Array) -> FreeDirections:
    """Return the directions that the groups from one table leave free.

    Parameters
    ----------
    sensor : Sensor
    model : AffineModel
        The solution.
    a : (r, 3) array
        Readings in the groups, g.
    spread : (3 r, 3 r) array
        Covariance of M a + p − f in the groups, g².
    """
    _, slope = affine.to_coefficients(sensor, model)
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
    turns = turns if sensor.frame == "mount" else ()
    return FreeDirections(turns, blind, 12 - int(nothing.sum()) - len(weak), weak)


def _null_direction(sensor: Sensor, move: Array, words: str) -> NullDirection:
    scaled = move / sensor.unit_scale
    # If parts are equal, the first gets the sign +, because rounding decides which is larger.
    scaled = scaled / scaled[np.argmax(np.abs(scaled) > (1 - 1e-6) * np.abs(scaled).max())]
    weights: dict[str, float] = {
        name: float(w) for name, w in zip(sensor.coefficients, scaled, strict=True) if abs(w) > 1e-9
    }
    return NullDirection(weights, f"{words}: {direction_in_words(scaled, sensor.coefficients)}")


def _direction_in_theta(move: Array) -> str:
    """Return the largest components of a direction in the source's names, such as "Exy + Eyx"."""
    large = np.flatnonzero(np.abs(move) > 0.3 * np.abs(move).max())
    move = move / move[large[0]]
    words = ""
    for k in large.tolist():
        size = "" if f"{abs(move[k]):.1f}" == "1.0" else f"{abs(move[k]):.2g} "
        words += (" − " if move[k] < 0 else " + " if words else "") + size + affine.AFFINE_NAMES[k]
    return words


class StartingPoint(NamedTuple):
    """The start of the damped iteration, and the source of its uncertainty."""

    model: AffineModel
    uncertainty_source: str
    gain: Array | None = None  # (..., 12, 3 r) for r untilted states
    prior_covariance: Array | None = None  # (12, 12) from priors


def starting_point(
    observations: Observations,
    sensor: Sensor,
    bench: RateTable,
    steps: Spins,
    priors: Priors,
    groups: Sequence[int],
) -> StartingPoint:
    """Return the start: nominal if the frame fixes the rest, otherwise from states or priors.

    Raises
    ------
    InputError, NotObserved
        The same as for `damped`.
    """
    rest = [k for k in range(len(steps)) if k not in groups]
    if sensor.frame == "symmetric":
        if priors:
            raise InputError(
                "estimator damped does not use priors together with [sensor] frame = "
                '"symmetric", because norms and frame determine all coefficients; remove the '
                "priors or the frame",
                key="priors",
            )
        if not _nominal_free_directions(sensor, bench, steps, groups).unobserved:
            return StartingPoint(AffineModel.of(affine.IDENTITY_PARAMETERS), "")
    if not rest:
        return _start_from_priors(sensor, priors, bench, groups, steps)
    if priors:
        raise InputError(
            "estimator damped uses either priors or untilted states, not both; remove the "
            "priors, or use estimator joint",
            key="priors",
        )
    here = [steps[k] for k in rest]
    require_excitation(bench, here)
    model, gain = fit_level_states(
        observations.mean[..., rest, :] / G0, sensed_motion(bench, here, {}).f / G0
    )
    return StartingPoint(model, "the untilted states", gain)


def require_convergence(
    converged: Bools, sensor: Sensor, bench: RateTable, steps: Spins, groups: Sequence[int]
) -> None:
    """Raise NotObserved if the iteration diverged because these tilts do not observe a direction.

    Such a direction is excited only by accidental deviations of the mountings, which move the
    solution far along it.

    Raises
    ------
    NotObserved
        The message names the directions and the tilts to add.
    """
    if converged.ndim or converged:  # with many trials, each has its own flag
        return
    blind = tuple(
        one.words for one in _nominal_free_directions(sensor, bench, steps, groups).unobserved
    )
    if blind:
        raise NotObserved(
            f"the norms of these {len(groups)} tilted states do not determine "
            f"{first_combinations(blind)}, so the damped iteration does not converge; add "
            "tilts of a second kind, such as XY 135 + 45, or use estimator joint",
            blind,
        )


def _start_from_priors(
    sensor: Sensor, priors: Priors, bench: RateTable, groups: Sequence[int], steps: Spins
) -> StartingPoint:
    """Return θ and its covariance from priors; raise NotObserved if a coefficient has no prior."""
    names = sensor.coefficients
    without = tuple(name for name in names if not any(name in prior.names for prior in priors))
    if without:
        left = _nominal_free_directions(sensor, bench, steps, groups)
        words = tuple(one.words for one in (*left.rotations, *left.unobserved))
        others = "tilts of a second kind, such as XY 135 + 45"
        if sensor.frame == "mount":
            others = "priors on all twelve coefficients"
        raise NotObserved(
            f"these norms do not determine {first_combinations(words)}; add the untilted states "
            f"XY, YX and ZY, or {others}, or use estimator joint",
            words,
            names=without,
        )
    rows = [prior.rows(names) for prior in priors]
    root = np.concatenate([b for b, _ in rows])
    covariance = np.asarray(np.linalg.inv(root.T @ root), dtype=float)
    mean = np.concatenate([target for _, target in rows], axis=-1) @ root @ covariance
    model, slope = affine.to_affine(sensor, mean)
    stated = slope @ covariance @ slope.mT
    return StartingPoint(model, "the stated priors", prior_covariance=stated)


def _nominal_free_directions(
    sensor: Sensor, bench: RateTable, steps: Spins, groups: Sequence[int]
) -> FreeDirections:
    """Return the free directions for an ideal sensor without noise."""
    f = sensed_motion(bench, [steps[k] for k in groups], {}).f / G0
    return free_directions(
        sensor, AffineModel.of(affine.IDENTITY_PARAMETERS), f, np.zeros((f.size, f.size))
    )
