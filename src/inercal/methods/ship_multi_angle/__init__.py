"""A triad on a plain rate table, tilted by known angles, as in tests of ship models.

* `joint`: all states together, untilted and tilted, each axis against what it felt; the angles of
  each mounting, its radius, the speeds, the radius and gravity are nuisances with their stated
  deviations.
* `planar`: the untilted states alone, linear (`inercal.methods.ship_planar`).
* `planar_norm`: the untilted states as vectors and the tilted ones as norms, rows alike.
* `damped`: the source's Levenberg–Marquardt on the norms of the tilted states, from `planar`.
* `global`: the source's optimisation of the same norms, by differential evolution.

Norms see no rotation of the triad, and what damping or a search leaves there is no measurement:
both say what they left free, by name, and what its uncertainty rests on. That both reach the same
sum of squares validates neither.

Source: Xiao Changrun, Liu Yang, Liu Ruijie, Transducer and Microsystem Technologies 33(10), 2014,
10.13873/J.1000-9787(2014)10-0021-04; its equations are lost in the copy at hand and rebuilt from
its text. `joint`, `planar_norm` and all covariances are ours.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from inercal.benches.mountings import multi_angle_plan, planar_plan, tilted
from inercal.benches.rate_table import RateTable, felt, mountings
from inercal.errors import InputError, NotObserved
from inercal.estimate import Estimate, Gaussian, least_squares
from inercal.methods import vectors
from inercal.methods._base import Method
from inercal.methods.affine import Affine, require_twelve, to_affine
from inercal.methods.observed import require_observed
from inercal.methods.ship_multi_angle import both, norms
from inercal.methods.ship_multi_angle.evolution import GOAL, Bounds, Found, Generation, search
from inercal.methods.ship_multi_angle.freedom import Free, free, seen
from inercal.methods.ship_planar import (
    level,
    of_rows,
    planar,
    require_excited,
    require_rows,
    unjudged,
)
from inercal.motion import Motion
from inercal.plan import Spin
from inercal.recording import Observations
from inercal.sensors import G0, Sensor

Array = NDArray[np.float64]
FEWEST = 12  # groups
WIDE = Bounds()


def plan(seconds: float = 150.0, one_speed: bool = False) -> tuple[Spin, ...]:
    """Return the nine untilted states, then the sixteen groups.

    Parameters
    ----------
    seconds : float
        Length of each dwell, s.
    one_speed : bool
        Whether all groups are at one speed, as in the source.
    """
    return (
        *planar_plan(seconds=seconds),
        *multi_angle_plan(one_speed=one_speed, seconds=seconds),
    )


def joint(
    observations: Observations,
    sensor: Sensor,
    bench: RateTable,
    steps: Sequence[Spin],
    priors: Sequence[Gaussian] = (),
) -> Estimate:
    """Return the coefficients and the bench's errors, at the largest posterior probability.

    Parameters
    ----------
    observations : Observations
        One row a state, (..., r, 3) m/s².
    sensor : Sensor
        Of three accelerometers, with the coefficients that are wanted.
    bench : RateTable
    steps : sequence of r Spin
        Of the rows, in known attitudes.
    priors : sequence of Gaussian
        On coefficients, from elsewhere.

    Raises
    ------
    InputError
        Steps that are not those of the rows.
    NotObserved
        Coefficients that these states leave open.
    """
    require_rows(observations, sensor, steps)

    def feel(q: Mapping[str, Array]) -> vectors.Felt:
        made = felt(bench, steps, q)
        return vectors.Felt(Motion(made.f), made.by)

    asked = vectors.problem(observations, sensor, bench.nuisances(steps), feel, priors)
    try:
        estimate = least_squares(asked)
        require_observed(estimate, sensor, missing=())
    except NotObserved:
        if not priors:
            # Where the states are to blame, say what to add.
            require_excited(sensor, bench, steps)
        raise
    said = (
        f"all {len(sensor.coefficients)} coefficients are determined, no direction is null; the "
        f"frame is the mean of {len(set(mountings(steps)))} mountings by their stated angles",
    )
    return replace(estimate, notes=(*said, *estimate.notes))


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
    groups = _groups("damped", observations, sensor, steps)
    a, square = _norms(observations, bench, steps, groups)
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
    whole[..., _columns(groups)] = told.gain
    if gain is not None:
        whole[..., _columns(rest)] = told.free @ gain
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
    groups = _groups("global", observations, sensor, steps)
    a, square = _norms(observations, bench, steps, groups)
    found = search(a, square, bounds, seed=seed, seconds=seconds, progress=progress)
    done = norms.Damped(
        found.model, np.array(found.cost), np.array(True), np.array(len(found.history))
    )
    told = seen(found.model, a)
    at = _columns(groups)
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


def planar_norm(
    observations: Observations,
    sensor: Sensor,
    bench: RateTable,
    steps: Sequence[Spin],
    priors: Sequence[Gaussian] = (),
) -> Estimate:
    """Return the twelve coefficients by untilted states' vectors and tilted ones' norms.

    Arguments as of `damped`, without priors. The covariance holds what the bench's errors do to the
    result.

    Raises
    ------
    InputError
        Priors, another sensor, steps that are not those of the rows.
    NotObserved
        Fewer than twelve tilted states, or untilted ones that leave an axis unexcited.
    """
    if priors:
        raise InputError("estimator planar_norm takes no priors; joint does")
    groups = _groups("planar_norm", observations, sensor, steps)
    rest = [k for k in range(len(steps)) if k not in groups]
    here = [steps[k] for k in rest]
    require_excited(sensor, bench, here)
    a, square = _norms(observations, bench, steps, groups)
    plain, f = observations.mean[..., rest, :] / G0, felt(bench, here, {}).f / G0
    model, gain, converged = both.solve(plain, f, a, square)
    residual, _ = both.linearised(model, plain, f, a, square)
    # From errors of M a + p − f of all rows, axes within, to those of the rows as compared.
    v = model.correct(a)
    along = v / np.linalg.norm(v, axis=-1, keepdims=True)
    lead, size = residual.shape[:-1], 3 * len(rest)
    compared = np.zeros((*lead, residual.shape[-1], 3 * len(steps)))
    compared[..., np.arange(size), _columns(rest)] = 1.0
    for k, group in enumerate(groups):
        compared[..., size + k, 3 * group : 3 * group + 3] = along[..., k, :]
    spread = of_rows(observations, bench, steps, model.matrix)
    spread = compared @ spread @ np.swapaxes(compared, -1, -2)
    return unjudged(
        sensor,
        model,
        gain @ spread @ np.swapaxes(gain, -1, -2),
        residual,
        np.diagonal(spread, axis1=-2, axis2=-1),
        (
            *(f"f{axis}[{step.label}]" for step in here for axis in "xyz"),
            *(f"|f|[{steps[k].label}]" for k in groups),
        ),
        notes=("no direction is null; the untilted mountings' nominal axes are the frame",),
        converged=converged,
    )


def _goal(found: Found) -> str:
    """Say how the search went."""
    met = "is not met" if found.goal is None else f"is met at generation {found.goal}"
    ended = "" if found.in_time else f"; it was ended after {found.seconds:.3g} s"
    return (
        f"the source's goal of {GOAL:.0%} {met}, and says nothing of the coefficients; after "
        f"{len(found.history)} generations and polishing the largest error of a norm is "
        f"{found.worst:.2g}, the sum of squares {found.cost:.4g} g⁴{ended}"
    )


def _groups(
    name: str, observations: Observations, sensor: Sensor, steps: Sequence[Spin]
) -> list[int]:
    """Return the rows of the tilted states, or refuse too few."""
    require_twelve(sensor)
    require_rows(observations, sensor, steps)
    groups = [k for k, step in enumerate(steps) if tilted(step)]
    if len(groups) < FEWEST:
        raise NotObserved(
            f"not observed: {len(groups)} tilted states make {len(groups)} norms for {FEWEST} "
            f"coefficients; estimator {name} needs {FEWEST} or more, joint takes what there is"
        )
    return groups


def _norms(
    observations: Observations, bench: RateTable, steps: Sequence[Spin], groups: Sequence[int]
) -> tuple[Array, Array]:
    """Return readings of the groups, (..., r, 3) g, and A² + 1, (r,) g²."""
    f = felt(bench, [steps[k] for k in groups], {}).f / G0
    return observations.mean[..., groups, :] / G0, (f**2).sum(-1)


def _columns(rows: Sequence[int]) -> NDArray[np.intp]:
    """Return where three axes of each row stand."""
    return (3 * np.asarray(rows, dtype=np.intp)[:, None] + np.arange(3)).ravel()


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
        ideal = Affine(np.eye(3), np.zeros(3))
        none = np.zeros((3 * len(f), 3 * len(f)))
        left = free(sensor, ideal, f, none)
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
    a, square = _norms(observations, bench, steps, groups)
    at, r = _columns(groups), len(groups)
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
        null_directions=(*left.turns, *left.blind),
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
        said.append(f"warning: norms tell badly {'; '.join(left.weak)}")
    return tuple(said)


METHOD = Method(
    name="ship_multi_angle",
    bench=RateTable,
    finds={"f": ("k0", "k1", "delta_o", "delta_p")},
    needs=("f",),
    plan=plan,
    estimators={
        "joint": joint,
        "planar": planar,
        "planar_norm": planar_norm,
        "damped": damped,
        "global": global_,
    },
    source="Xiao, Liu and Liu, Transducer and Microsystem Technologies 33(10), 2014",
)
