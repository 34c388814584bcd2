"""The problem of readings in known attitudes: each against that of what its axis felt there.

What the bench makes of its declared parameters is felt; those that are not exact are nuisances
with their stated deviations.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import zip_longest
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inercal.arrays import Array
from inercal.benches import MeanBench, MeanMotion
from inercal.errors import InputError
from inercal.estimate import Candidate, Estimate, Gauge, Gaussian, Problem, least_squares
from inercal.methods import candidates, temperature
from inercal.observe import vector_residuals
from inercal.parameters import Parameter
from inercal.recording import Observations
from inercal.sensors import G0, Sensor

ROUNDING = 2.0**-50  # of a reading, by the few operations that give it

MotionFunction = Callable[[Mapping[str, Array]], MeanMotion]


def joint(
    observations: Observations,
    sensor: Sensor,
    bench: MeanBench,
    steps: Sequence[Any],
    priors: Sequence[Gaussian] = (),
) -> Estimate:
    """Return the estimate of mean readings on any bench of means, its parameters being nuisances.

    An estimator, for a method that needs nothing of its own.

    Parameters
    ----------
    observations : Observations
        (..., r, m), SI.
    sensor : Sensor
        With the coefficients that are wanted.
    bench : MeanBench
        Its parameters of scope "dwell" are not for this estimator.
    steps : sequence of r Step
        Of the rows; steps of a plan that have no row are left out.
    priors : sequence of Gaussian
        On coefficients.

    Raises
    ------
    InputError
        Rows without their steps, or a parameter of scope "dwell".
    NotObserved
        Coefficients that these steps leave open, by name.
    """
    by_label = {step.label: step for step in steps}
    done = [by_label[label] for label in observations.labels if label in by_label]
    require_matching_rows(observations, sensor, done)
    declared = bench.nuisances(done, sensor)
    if noisy := [name for name, one in declared.items() if one.scope == "dwell" and one.sd > 0]:
        raise InputError(f"{noisy[0]} is another in each dwell: this estimator has no noise of it")
    offsets = {
        name: bench.reading_offsets(done, sensor, {name: np.array(1.0)}) for name in declared
    }
    whole = problem(
        observations,
        sensor,
        declared,
        lambda q: bench.mean_motion(done, q),
        priors,
        reading_columns={
            name: one.ravel() for name, one in offsets.items() if one.ndim and one.any()
        },
        with_drift_candidate=True,
    )
    return replace(least_squares(whole), tests=observations.tests)


def require_matching_rows(
    observations: Observations,
    sensor: Sensor,
    steps: Sequence[Any],
) -> None:
    """Refuse steps or channels that are not those of the rows.

    Raises
    ------
    InputError
        Naming the first that differs, or a label that comes twice.
    """
    if observations.channels != sensor.channels:
        raise InputError(
            f"readings are of {', '.join(observations.channels)}, the sensor has "
            f"{', '.join(sensor.channels)}"
        )
    labels = tuple(step.label for step in steps)
    if len(set(labels)) < len(labels):
        raise InputError("two steps have one label; give each its own")
    if labels != observations.labels:
        pairs = zip_longest(observations.labels, labels)
        row, step = next(pair for pair in pairs if pair[0] != pair[1])
        raise InputError(f"row {row} has step {step}; give the step of each row, in order")


def problem(
    observations: Observations,
    sensor: Sensor,
    declared: Mapping[str, Parameter],
    motion_function: MotionFunction,
    priors: Sequence[Gaussian] = (),
    *,
    reading_columns: Mapping[str, Array] | None = None,
    dwell_covariance: Callable[[Array, MeanMotion], Array] | None = None,
    gauges: tuple[Gauge, ...] = (),
    with_drift_candidate: bool = False,
    families: Mapping[str, Sequence[str]] | None = None,
    common_errors: Sequence[str] = (),
    unknown_forces: Mapping[str, Array] | None = None,
    stated_noise: Array | None = None,
    zero_input: NDArray[np.bool_] | None = None,
) -> Problem:
    """Return the problem of all readings.

    Parameters
    ----------
    observations : Observations
        (..., r, m), m/s².
    sensor : Sensor
        Of m accelerometers.
    declared : mapping of str to Parameter
        The bench's parameters by full name.
    feel : callable
        From their values by full name, (...) SI, to what was felt.
    priors : sequence of Gaussian
        On coefficients.
    added : mapping of str to (m r,) array, optional
        What one of a parameter adds to the readings themselves, row after row.
    dwells : callable, optional
        From coefficients and what was felt to a covariance that is added to that of the means.
    gauges : tuple of Gauge
    timed : bool
        Whether a drift of the biases over the rows' times is a candidate of the score tests.
    families : mapping of str to sequence of str, optional
        Of candidates, as of `inercal.methods.candidates.candidate_function`.
    common_errors : sequence of str, optional
        Errors of single rows that may be alike, as of `inercal.methods.candidates.common_error_candidates`.
    forces : mapping of str to (...) array, optional
        Specific forces that nothing is known of, by the names that `feel` takes: where the search
        begins, m/s².
    stated : (..., m r) or (..., m r, m r) array, optional
        Deviations of the readings, or their covariance, in place of that of the observations.
    zero_input : (m r,) array of bool, optional
        As of `inercal.methods.candidates.candidate_function`.
    """
    p, not_found = len(sensor.coefficients), unknown_forces or {}
    loose, known = split_parameters(declared)
    nuisances = (*loose, *not_found)
    beside = {name: column for name, column in (reading_columns or {}).items() if name in loose}
    at = [p + list(loose).index(name) for name in beside]
    warmth = temperature.row_offsets(observations, sensor)
    columns = np.array(list(beside.values())).T

    def sensed_motion(x: Array) -> MeanMotion:
        made = motion_function(known | {n: x[..., p + k] for k, n in enumerate(nuisances)})
        return replace(made, motion=replace(made.motion, dT=warmth)) if warmth.ndim else made

    def linearise(x: Array) -> tuple[Array, Array]:
        here = sensed_motion(x)
        shape = here.motion.f.shape
        df, dw = _stacked_derivatives(here.df, nuisances, shape), None
        if here.dw:
            dw = _stacked_derivatives(here.dw, nuisances, shape)
        residual, slope = vector_residuals(
            sensor, observations.mean, x[..., :p], here.motion, df, dw
        )
        if beside:
            residual = residual - x[..., at] @ columns.T
            slope[..., at] = columns
        return residual, slope

    full = observations.full_covariance if stated_noise is None else stated_noise

    def noise(x: Array) -> Array:
        return (
            full
            if dwell_covariance is None
            else full + dwell_covariance(x[..., :p], sensed_motion(x))
        )

    def larger() -> Problem:
        whole = candidates.extended_sensor(
            sensor, temperature_varies=observations.temperature_varies
        )
        freed = candidates.parameters_with_deviations(declared)
        return problem(
            observations,
            whole,
            freed,
            motion_function,
            reading_columns=reading_columns,
            unknown_forces=unknown_forces,
            stated_noise=stated_noise,
        )

    first = start_values(p, loose)
    # Without forces all trials start from one point, which is then worked out once.
    if not_found:
        begin = np.stack([*not_found.values()], axis=-1)
        alike = np.broadcast_to(first, (*begin.shape[:-1], first.size))
        first = np.concatenate([alike, begin], axis=-1)
    names = (*sensor.coefficients, *nuisances)
    read = np.abs(observations.mean).reshape(*observations.mean.shape[:-2], -1)
    own = observations.full_covariance if stated_noise is not None else noise(first)
    largest = read / np.sqrt(np.diagonal(own, axis1=-2, axis2=-1))
    return Problem(
        names=names,
        start=first,
        linearise=linearise,
        noise=full if dwell_covariance is None else noise,
        scale=np.concatenate([parameter_scales(sensor, loose), np.full(len(not_found), G0)]),
        priors=with_bench_priors(loose, priors),
        gauges=gauges,
        wanted=sensor.coefficients,
        observations=tuple(f"{a}[{row}]" for row in observations.labels for a in sensor.channels),
        rounding=float(np.max(largest)) * ROUNDING,
        candidates=candidates.candidate_function(
            larger,
            names,
            sensor,
            declared,
            observations.time if with_drift_candidate else None,
            families,
            [name for prior in priors for name in prior.names],
            common_errors,
            zero_input,
        ),
    )


def row_subset(whole: Problem, at: NDArray[np.int64]) -> Problem:
    """Return the problem of some of a problem's observations alone.

    Parameters
    ----------
    whole : Problem
        Its noise is one covariance for all x.
    at : (k,) array of int
        Places of the observations that are kept.
    """
    assert not callable(whole.noise)
    places: list[int] = at.tolist()

    def linearise(x: Array) -> tuple[Array, Array]:
        residual, jacobian = whole.linearise(x)
        return residual[..., at], jacobian[..., at, :]

    def candidates(x: Array) -> list[Candidate]:
        assert whole.candidates is not None
        kept = (replace(one, rows=one.rows[at]) for one in whole.candidates(x))
        return [one.without_zero_components() for one in kept if np.any(one.rows)]

    return replace(
        whole,
        linearise=linearise,
        noise=whole.noise[..., at[:, None], at],
        observations=tuple(whole.observations[k] for k in places),
        candidates=candidates if whole.candidates else None,
    )


def _stacked_derivatives(
    by: Mapping[str, Array], loose: Sequence[str], shape: tuple[int, ...]
) -> Array:
    """Return the derivatives by each nuisance, (..., r, 3, q)."""
    made = np.zeros((*shape, len(loose)))
    for k, name in enumerate(loose):
        if name in by:
            made[..., k] = by[name]
    return made


def split_parameters(
    declared: Mapping[str, Parameter],
) -> tuple[dict[str, Parameter], dict[str, Array]]:
    """Return the parameters that are estimated, and the values of those that are exact."""
    loose = {name: parameter for name, parameter in declared.items() if parameter.sd > 0}
    known = {n: np.array(q.value) for n, q in declared.items() if n not in loose}
    return loose, known


def start_values(p: int, loose: Mapping[str, Parameter]) -> Array:
    """Return where a search starts: p coefficients at nominal, the bench as declared."""
    return np.concatenate([np.zeros(p), [parameter.value for parameter in loose.values()]])


def parameter_scales(sensor: Sensor, loose: Mapping[str, Parameter]) -> Array:
    """Return the natural size of each coefficient and of each of the bench's parameters."""
    return np.concatenate([sensor.unit_scale, [candidates.unit_scale(q) for q in loose.values()]])


def with_bench_priors(
    loose: Mapping[str, Parameter], priors: Sequence[Gaussian]
) -> tuple[Gaussian, ...]:
    """Return the priors, those of the bench's parameters before them."""
    if not loose:
        return tuple(priors)
    values, deviations = zip(*((q.value, q.sd) for q in loose.values()), strict=True)
    return (Gaussian.independent(tuple(loose), values, deviations), *priors)
