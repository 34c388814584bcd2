"""The source's estimators for tilted states solve the norm equations by damped steps or a search.

Norms do not observe a rotation of the triad. The rotation that results from damping or a search is
therefore not a measurement. Both estimators name the free directions and state the uncertainty of
the start or of the bounds along them. If the frame of the sensor is stated, it fixes the rotation,
and both estimators agree.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.units import format_count
from inercal.benches.rate_table.bench import RateTable
from inercal.estimation import Estimate
from inercal.methods import Priors
from inercal.methods.ship_consistency import consistency, row_covariance
from inercal.methods.ship_multi_angle import free_norm_directions as free
from inercal.methods.ship_multi_angle import norm_equations
from inercal.methods.ship_planar import affine_estimate
from inercal.methods.solving import refuse_priors, require_single_recording
from inercal.physics.plan import Spins
from inercal.physics.sensors import Sensor
from inercal.physics.sensors.affine import AFFINE_NAMES, IDENTITY_PARAMETERS, AffineModel
from inercal.recordings import Observations

DEFAULT_SEARCH = norm_equations.SearchOptions()
_FIRST_BIAS = 9  # index in θ
_BOUND_TOLERANCE = 1e-6  # relative to a bound; smaller excesses are rounding


def damped(
    observations: Observations, sensor: Sensor, bench: RateTable, steps: Spins, priors: Priors = ()
) -> Estimate:
    """Return the twelve coefficients from norms of tilted states, damped as in the source.

    If norms leave a direction free, the result and its uncertainty along this direction are those
    of the start. The start comes from `planar` if there are untilted states, otherwise from priors
    on all twelve coefficients. If the sensor's frame is stated and norms determine everything else,
    the start is nominal and has no effect.

    Parameters
    ----------
    observations, sensor, bench, steps
        The same as for `joint`; the sensor's coefficients are the twelve in f = M a + p.
    priors : sequence of Gaussian
        Priors on all twelve coefficients, if there are no untilted states.

    Raises
    ------
    InputError
        The sensor is unsuitable, the steps do not match the rows, or there are priors together
        with untilted states or a stated frame.
    NotObserved
        There are fewer than twelve tilted states, there are neither untilted states nor priors for
        the directions that norms leave free, or the iteration does not converge because the tilts
        leave further directions free.
    """
    groups = norm_equations.tilted_rows("damped", observations, sensor, steps)
    a, square = norm_equations.norm_observations(observations, bench, steps, groups)
    start = free.starting_point(observations, sensor, bench, steps, priors, groups)
    done = norm_equations.damped_solution(a, square, start.model)
    free.require_convergence(done.converged, sensor, bench, steps, groups)
    done = _in_stated_frame(sensor, done)
    _, null, gain = free.group_information(done.model, a)
    spread = row_covariance(observations, bench, steps, done.model.matrix)
    whole = np.zeros((*gain.shape[:-1], 3 * len(steps)))
    whole[..., norm_equations.axis_columns(groups)] = gain
    rest: list[int] = []
    if start.gain is not None:
        rest = [k for k in range(len(steps)) if k not in groups]
        whole[..., norm_equations.axis_columns(rest)] = null @ start.gain
    covariance = whole @ spread @ whole.mT
    if start.prior_covariance is not None:
        covariance = covariance + null @ start.prior_covariance @ null
    decided = ("damping", start.uncertainty_source)
    return _norm_estimate(
        observations, sensor, bench, steps, (rest, groups), whole, done, covariance, decided
    )


def global_(
    observations: Observations,
    sensor: Sensor,
    bench: RateTable,
    steps: Spins,
    priors: Priors = (),
    *,
    options: norm_equations.SearchOptions = DEFAULT_SEARCH,
    progress: Callable[[norm_equations.Generation], None] | None = None,
) -> Estimate:
    """Return the twelve coefficients from a global search on the norms of the tilted states.

    If norms leave a direction free, all values within the bounds are equivalent. The uncertainty
    along this direction is that of a uniform distribution over the bounds.

    Parameters
    ----------
    observations, sensor, bench, steps
        The same as for `damped`, from one table.
    priors : sequence of Gaussian
        Must be empty.
    options : SearchOptions
        Bounds about nominal, seed, time limit and goal.
    progress : callable, optional
        Called after each generation.

    Raises
    ------
    InputError
        There are priors or many trials, the sensor is unsuitable, or the steps do not match the
        rows.
    NotObserved
        There are fewer than twelve tilted states.
    """
    refuse_priors(priors, "global", "joint")
    require_single_recording(observations, "estimator global")
    groups = norm_equations.tilted_rows("global", observations, sensor, steps)
    a, square = norm_equations.norm_observations(observations, bench, steps, groups)
    found = norm_equations.search(a, square, options, progress=progress)
    count = np.array(len(found.history))
    done = norm_equations.DampedSolution(found.model, np.array(found.cost), np.array(True), count)
    done = _in_stated_frame(sensor, done)
    _, null, gain = free.group_information(done.model, a)
    at = norm_equations.axis_columns(groups)
    spread = row_covariance(observations, bench, steps, done.model.matrix)[np.ix_(at, at)]
    uniform = null @ np.diag(options.bounds.half_width**2 / 3) @ null
    whole = np.zeros((12, 3 * len(steps)))
    whole[:, at] = gain
    estimate = _norm_estimate(
        observations,
        sensor,
        bench,
        steps,
        ([], groups),
        whole,
        done,
        gain @ spread @ gain.T + uniform,
        ("chance", "a uniform distribution over the bounds"),
    )
    beyond = _bound_warnings(done.model, options)
    return replace(estimate, notes=(_search_note(found, options), *estimate.notes, *beyond))


def _search_note(found: norm_equations.SearchResult, options: norm_equations.SearchOptions) -> str:
    """Return a note on the search: goal, generations and errors."""
    met = "is not met" if found.goal is None else f"is met at generation {found.goal}"
    ended = "" if found.completed else f"; it stopped at the time limit, {found.seconds:.3g} s"
    goal, worst = (f"{100 * share:.3g} %" for share in (options.goal, found.worst))
    return (
        f"The goal of {goal} {met}, which says nothing about the coefficients. After "
        f"{len(found.history)} generations of seed {options.seed} and polishing, the largest error "
        f"of a norm is {worst} and the sum of squares is {found.cost:.4g} g⁴{ended}."
    )


def _bound_warnings(model: AffineModel, options: norm_equations.SearchOptions) -> tuple[str, ...]:
    """Return a warning if polishing or the frame moved coefficients beyond the bounds."""
    off = model.theta - IDENTITY_PARAMETERS
    past = np.flatnonzero(np.abs(off) > options.bounds.half_width * (1 + _BOUND_TOLERANCE)).tolist()
    if not past:
        return ()
    text = ", ".join(
        f"{AFFINE_NAMES[k]} {1e3 * off[k]:+.4g} mg (±{1e3 * options.bounds.half_width[k]:.4g} mg)"
        if k >= _FIRST_BIAS
        else f"{AFFINE_NAMES[k]} {100 * off[k]:+.3g} % (±{100 * options.bounds.half_width[k]:.3g} "
        "%)"
        for k in past
    )
    return (
        f"Warning: beyond the bounds of the search: {text}. The bounds limit the search, but not "
        "the polishing after it: widen them, or look for the cause.",
    )


def _in_stated_frame(
    sensor: Sensor, done: norm_equations.DampedSolution
) -> norm_equations.DampedSolution:
    """Return the solution in the sensor's frame, if one is stated."""
    if sensor.frame == "mount":
        return done
    return done._replace(model=norm_equations.to_symmetric_frame(done.model))


def _norm_estimate(
    observations: Observations,
    sensor: Sensor,
    bench: RateTable,
    steps: Spins,
    used: tuple[Sequence[int], Sequence[int]],
    gain: Array,
    done: norm_equations.DampedSolution,
    covariance: Array,
    decided: tuple[str, str],
) -> Estimate:
    """Return the estimate that follows from norms.

    The arguments are as for `consistency`. `used` are the rows that the estimator used as vectors
    and as norms. `decided` says what decided the free directions and where their uncertainty comes
    from.
    """
    level, groups = used
    a, square = norm_equations.norm_observations(observations, bench, steps, groups)
    at, r = norm_equations.axis_columns(groups), len(groups)
    spread = row_covariance(observations, bench, steps, done.model.matrix)[..., at, :][..., at]
    v = done.model.correct(a)
    length = np.linalg.norm(v, axis=-1)
    along = v / length[..., None]
    blocks = np.einsum("...aiaj->...aij", spread.reshape(*spread.shape[:-2], r, 3, r, 3))
    first = (0,) * length[..., 0].ndim
    one = AffineModel(done.model.matrix[first], done.model.offset[first])
    left = free.free_directions(sensor, one, a[first], spread[first])
    if sensor.frame != "mount":
        kept = norm_equations.frame_projection(done.model)
        covariance = kept @ covariance @ kept.mT
        gain = kept @ gain
    agreement = consistency(observations, sensor, bench, steps, done.model, gain, level, groups)
    return affine_estimate(
        sensor,
        done.model,
        covariance,
        np.sqrt(square) - length,
        np.einsum("...ai,...aij,...aj->...a", along, blocks, along),
        tuple(f"|f|[{steps[k].label}]" for k in groups),
        agreement,
        notes=tuple(_free_direction_notes(left, decided)),
        rank=left.rank,
        null_directions=(*left.rotations, *left.unobserved, *left.weak),
        converged=done.converged,
        iterations=done.steps,
    )


def _free_direction_notes(left: free.FreeDirections, decided: tuple[str, str]) -> Iterator[str]:
    """Yield notes on free directions, on what decided them, and on weak directions."""
    named = [one.words for one in (*left.rotations, *left.unobserved)]
    what, source = decided
    rank = f"Norms determine {left.rank} of 12 coefficients"
    if not left.rotations:
        yield (
            f"{rank}, and the stated frame determines three (symmetric misalignments). The "
            "orientation of this frame in the housing is not determined."
        )
    if named:
        yield (
            f"Warning: {rank}. {what.capitalize()} decided "
            f"{format_count(len(named), 'direction')}, whose uncertainty is that of {source}: "
            f"{'; '.join(named)}."
        )
    if left.weak:
        words = "; ".join(one.words for one in left.weak)
        yield f"Warning: only accidental deviations of the mountings determine {words}."
