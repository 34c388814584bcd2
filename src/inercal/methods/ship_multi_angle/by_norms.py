"""The source's estimators of the tilted states: damped equations of their norms, or a search.

Norms see no rotation of the triad, and what damping or a search leaves there is no measurement.
Both say what they left free, by name, and state there the uncertainty of what decided it.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from inercal.benches.rate_table import RateTable, felt
from inercal.errors import InputError, NotObserved
from inercal.estimate import Estimate, Gaussian
from inercal.methods.affine import IDEAL, Affine, to_affine
from inercal.methods.ship_multi_angle import norms
from inercal.methods.ship_multi_angle.evolution import GOAL, Bounds, Found, Generation, search
from inercal.methods.ship_multi_angle.freedom import Free, free, seen
from inercal.methods.ship_multi_angle.states import columns, of_norms, tilted_rows
from inercal.methods.ship_planar import level, of_rows, require_excited, unjudged
from inercal.plan import Spin
from inercal.recording import Observations
from inercal.sensors import G0, Sensor

Array = NDArray[np.float64]
WIDE = Bounds()


def damped(
    observations: Observations,
    sensor: Sensor,
    bench: RateTable,
    steps: Sequence[Spin],
    priors: Sequence[Gaussian] = (),
) -> Estimate:
    """Return the twelve coefficients by the norms of the tilted states, damped as in the source.

    Where norms leave a direction free the result is the start's, and so is its uncertainty: of
    `planar` where there are untilted states, else of priors on all twelve coefficients.

    Parameters
    ----------
    observations, sensor, bench, steps
        As of `joint`; the sensor's coefficients are the twelve of f = M a + p.
    priors : sequence of Gaussian
        On all twelve coefficients, in the place of untilted states.

    Raises
    ------
    InputError
        Another sensor, steps that are not those of the rows, priors beside untilted states.
    NotObserved
        Fewer than twelve tilted states, or nothing that tells what norms leave free.
    """
    groups = tilted_rows("damped", observations, sensor, steps)
    a, square = of_norms(observations, bench, steps, groups)
    rest = [k for k in range(len(steps)) if k not in groups]
    if rest:
        if priors:
            raise InputError(
                "damped takes priors in the place of untilted states; joint takes both"
            )
        here = [steps[k] for k in rest]
        require_excited(sensor, bench, here)
        start, gain = level(observations.mean[..., rest, :] / G0, felt(bench, here, {}).f / G0)
        stated, whose = None, "the untilted states"
    else:
        start, stated = _told(sensor, priors, bench, groups, steps)
        gain, whose = None, "the stated priors"
    done = norms.damped(a, square, start)
    told = seen(done.model, a)
    spread = of_rows(observations, bench, steps, done.model.matrix)
    whole = np.zeros((*told.gain.shape[:-1], 3 * len(steps)))
    whole[..., columns(groups)] = told.gain
    if gain is not None:
        whole[..., columns(rest)] = told.free @ gain
    covariance = whole @ spread @ np.swapaxes(whole, -1, -2)
    if stated is not None:
        covariance = covariance + told.free @ stated @ told.free
    return _estimate(
        observations, sensor, bench, steps, groups, done, covariance, ("damping alone", whose)
    )


def global_(
    observations: Observations,
    sensor: Sensor,
    bench: RateTable,
    steps: Sequence[Spin],
    priors: Sequence[Gaussian] = (),
    *,
    bounds: Bounds = WIDE,
    seed: int = 0,
    seconds: float = 20.0,
    progress: Callable[[Generation], None] | None = None,
) -> Estimate:
    """Return the twelve coefficients by a global search of the norms of the tilted states.

    Where norms leave a direction free any value within the bounds is as good: the uncertainty there
    is that of an even distribution over them.

    Parameters
    ----------
    observations, sensor, bench, steps
        As of `damped`, of one table.
    priors : sequence of Gaussian
        None are taken.
    bounds : Bounds
        Of the search, about nominal.
    seed : int
    seconds : float
        After which the search ends.
    progress : callable, optional
        Called after each generation: number, least sum of squares, worst relative error.

    Raises
    ------
    InputError
        Priors, a trial axis, another sensor, steps that are not those of the rows.
    NotObserved
        Fewer than twelve tilted states.
    """
    if priors:
        raise InputError("estimator global takes bounds, no priors; joint takes priors")
    if observations.mean.ndim != 2:
        raise InputError("estimator global works on one table at a time")
    groups = tilted_rows("global", observations, sensor, steps)
    a, square = of_norms(observations, bench, steps, groups)
    found = search(a, square, bounds, seed=seed, seconds=seconds, progress=progress)
    done = norms.Damped(
        found.model, np.array(found.cost), np.array(True), np.array(len(found.history))
    )
    told = seen(found.model, a)
    at = columns(groups)
    spread = of_rows(observations, bench, steps, found.model.matrix)[np.ix_(at, at)]
    even = told.free @ np.diag(bounds.half**2 / 3) @ told.free
    estimate = _estimate(
        observations,
        sensor,
        bench,
        steps,
        groups,
        done,
        told.gain @ spread @ told.gain.T + even,
        ("chance", "an even distribution over the bounds"),
    )
    return replace(estimate, notes=(_goal(found), *estimate.notes))


def _goal(found: Found) -> str:
    """Say how the search went."""
    met = "is not met" if found.goal is None else f"is met at generation {found.goal}"
    ended = "" if found.in_time else f"; it was ended after {found.seconds:.3g} s"
    return (
        f"the source's goal of {GOAL:.0%} {met}, and says nothing of the coefficients; after "
        f"{len(found.history)} generations and polishing the largest error of a norm is "
        f"{found.worst:.2g}, the sum of squares {found.cost:.4g} g⁴{ended}"
    )


def _told(
    sensor: Sensor,
    priors: Sequence[Gaussian],
    bench: RateTable,
    groups: Sequence[int],
    steps: Sequence[Spin],
) -> tuple[Affine, Array]:
    """Return where priors put θ, and their covariance of it, (12, 12); refuse where they do not."""
    names = sensor.coefficients
    untold = [name for name in names if not any(name in prior.names for prior in priors)]
    if untold:
        f = felt(bench, [steps[k] for k in groups], {}).f / G0
        none = np.zeros((3 * len(f), 3 * len(f)))
        left = free(sensor, Affine.of(IDEAL), f, none)
        words = tuple(one.words for one in (*left.turns, *left.blind))
        raise NotObserved(
            f"not observed: norms leave free {'; '.join(words)}; add the untilted states XY, YX "
            f"and ZY, or priors on all twelve coefficients ({', '.join(untold)} without), or use "
            "joint: damping would decide in silence",
            words,
        )
    rows = [prior.rows(names) for prior in priors]
    root = np.concatenate([b for b, _ in rows])
    covariance = np.asarray(np.linalg.inv(root.T @ root), dtype=float)
    mean = np.concatenate([target for _, target in rows], axis=-1) @ root @ covariance
    model, slope = to_affine(sensor, mean)
    return model, slope @ covariance @ np.swapaxes(slope, -1, -2)


def _estimate(
    observations: Observations,
    sensor: Sensor,
    bench: RateTable,
    steps: Sequence[Spin],
    groups: Sequence[int],
    done: norms.Damped,
    covariance: Array,
    decided: tuple[str, str],
) -> Estimate:
    """Return the estimate of norms; `decided` is by what, and whose uncertainty it is then."""
    a, square = of_norms(observations, bench, steps, groups)
    at, r = columns(groups), len(groups)
    spread = of_rows(observations, bench, steps, done.model.matrix)[..., at, :][..., at]
    v = done.model.correct(a)
    length = np.linalg.norm(v, axis=-1)
    along = v / length[..., None]
    blocks = np.einsum("...aiaj->...aij", spread.reshape(*spread.shape[:-2], r, 3, r, 3))
    first = (0,) * length[..., 0].ndim
    one = Affine(done.model.matrix[first], done.model.offset[first])
    left = free(sensor, one, a[first], spread[first])
    return unjudged(
        sensor,
        done.model,
        covariance,
        np.sqrt(square) - length,
        np.einsum("...ai,...aij,...aj->...a", along, blocks, along),
        tuple(f"|f|[{steps[k].label}]" for k in groups),
        notes=_warned(left, decided),
        rank=left.rank,
        null_directions=(*left.turns, *left.blind, *left.weak),
        converged=done.converged,
        iterations=done.steps,
    )


def _warned(left: Free, decided: tuple[str, str]) -> tuple[str, ...]:
    """Say what norms left free, what decided it, and what they tell badly."""
    named = [one.words for one in (*left.turns, *left.blind)]
    what, whose = decided
    said = [
        f"warning: norms determine {left.rank} of 12 coefficients; {what} decided "
        f"{len(named)} directions, whose uncertainty is that of {whose}: {'; '.join(named)}"
    ]
    if left.weak:
        words = "; ".join(one.words for one in left.weak)
        said.append(f"warning: accidents of the mountings alone show {words}")
    return tuple(said)
