"""The estimation problem of mean readings: each is compared with the motion that the bench states.

The motion is a function of the bench's declared parameters. Parameters with a standard deviation
are nuisances; the others are exact.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.parameters import Parameter
from inercal.benches import MeanBench, MeanMotion
from inercal.estimation import Candidate, Estimate, Gauge, Gaussian, Problem
from inercal.methods import candidates, solving, temperature
from inercal.methods.estimator_inputs import require_matching_rows
from inercal.methods.residuals import vector_residuals
from inercal.methods.residuals.vector_equations import StatedMotion, VectorEquations
from inercal.methods.row_comparison import ReadingNoise, RowComparison
from inercal.physics.sensors import G0, Sensor
from inercal.recordings import Observations

ROUNDING = 2.0**-50  # of a reading: the error of the few operations that compute it

MotionFunction = Callable[[Mapping[str, Array]], MeanMotion]


class Unknowns(NamedTuple):
    """The parameters that a problem estimates, and the bench's parameters that are exact.

    Parameters
    ----------
    sensor : Sensor
    estimated : mapping of str to Parameter
        The bench's parameters with a deviation.
    exact : dict of str to () array
        Values of the others, SI.
    nuisances : tuple of str
        Names of the parameters that follow the coefficients.
    """

    sensor: Sensor
    estimated: Mapping[str, Parameter]
    exact: dict[str, Array]
    nuisances: tuple[str, ...]

    @property
    def p(self) -> int:
        """Number of the sensor's coefficients."""
        return len(self.sensor.coefficients)

    def bench_values(self, x: Array) -> Mapping[str, Array]:
        """Return the bench's parameters by full name, (...) SI, of parameters x (..., p + k)."""
        return self.exact | {n: x[..., self.p + k] for k, n in enumerate(self.nuisances)}


def joint(
    observations: Observations,
    sensor: Sensor,
    bench: MeanBench,
    steps: Sequence[Any],
    priors: Sequence[Gaussian] = (),
) -> Estimate:
    """Return the estimate from mean readings on any bench of means, with its errors as nuisances.

    An estimator for methods that need no estimator of their own.

    Parameters
    ----------
    observations : Observations
        (..., r, m), SI.
    sensor : Sensor
        With the coefficients to estimate.
    bench : MeanBench
        Without parameters of scope "dwell".
    steps : sequence of r Step
        Of the rows; steps of a plan that have no row are ignored.
    priors : sequence of Gaussian
        On coefficients.

    Raises
    ------
    InputError
        Rows without their steps, or a parameter of scope "dwell".
    NotObserved
        Coefficients that these steps do not determine, by name.
    """
    by_label = {step.label: step for step in steps}
    done = [by_label[label] for label in observations.labels if label in by_label]
    require_matching_rows(observations, sensor, done)
    declared = bench.nuisances(done, sensor)
    noisy = tuple(name for name, one in declared.items() if one.scope == "dwell" and one.sd > 0)
    if noisy:
        raise InputError(
            f"[bench] {noisy[0]} differs from dwell to dwell, which estimator joint does not "
            "model; set it to 0, or use another estimator",
            key=f"[bench] {noisy[0]}",
            names=noisy,
        )
    offsets = {
        name: bench.reading_offsets(done, sensor, {name: np.array(1.0)}) for name in declared
    }
    columns = {name: one.ravel() for name, one in offsets.items() if one.ndim and one.any()}
    estimate = solving.solve(
        observations,
        priors,
        lambda some, own: problem(
            some,
            sensor,
            declared,
            lambda q: bench.mean_motion(done, q),
            own,
            reading_columns=columns,
            with_drift_candidate=True,
        ),
    )
    return replace(estimate, tests=observations.tests)


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
    stated_noise: ReadingNoise | None = None,
    zero_input: NDArray[np.bool_] | None = None,
    suspects: Mapping[str, Parameter] | None = None,
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
    motion_function : callable
        From their values by full name, (...) SI, to the sensed motion.
    priors : sequence of Gaussian
        On coefficients.
    reading_columns : mapping of str to (m r,) array, optional
        What a unit of a parameter adds to the readings themselves, row after row.
    dwell_covariance : callable, optional
        From coefficients and the sensed motion to a covariance that is added to that of the means.
    gauges : tuple of Gauge
    with_drift_candidate : bool
        Whether a drift of the biases over the rows' times is a candidate of the score tests.
    families : mapping of str to sequence of str, optional
        Of candidates, as of `inercal.methods.candidates.candidate_function`.
    common_errors : sequence of str, optional
        Errors of single rows that may be common, as of
        `inercal.methods.candidates.common_error_candidates`.
    unknown_forces : mapping of str to (...) array, optional
        Start values of specific forces without a prior, m/s², by the names that `motion_function`
        takes.
    stated_noise : ReadingNoise, optional
        In place of that of the observations.
    zero_input : (m r,) array of bool, optional
        As of `inercal.methods.candidates.candidate_function`.
    suspects : mapping of str to Parameter, optional
        The bench's parameters that are candidates, where they are more than those declared.
    """
    forces = unknown_forces or {}
    doubted = declared if suspects is None else suspects

    def compare(unknowns: Unknowns) -> RowComparison:
        return compare_vectors(
            unknowns, observations, motion_function, reading_columns, dwell_covariance, stated_noise
        )

    def larger() -> Problem:
        whole = candidates.extended_sensor(
            sensor, temperature_varies=observations.temperature_varies
        )
        freed = candidates.parameters_with_deviations(doubted)
        return build_problem(whole, freed, compare, forces=forces)

    built = build_problem(sensor, declared, compare, priors, forces=forces)
    return replace(
        built,
        gauges=gauges,
        candidates=candidates.candidate_function(
            larger,
            built.names,
            sensor,
            doubted,
            observations.time if with_drift_candidate else None,
            families,
            priors,
            common_errors,
            zero_input,
        ),
    )


def build_problem(
    sensor: Sensor,
    declared: Mapping[str, Parameter],
    compare: Callable[[Unknowns], RowComparison],
    priors: Sequence[Gaussian] = (),
    *,
    forces: Mapping[str, Array] | None = None,
) -> Problem:
    """Return the problem of mean readings of steps, by either comparison.

    Parameters
    ----------
    sensor : Sensor
        With the coefficients to estimate.
    declared : mapping of str to Parameter
        The bench's parameters by full name; those with a deviation are nuisances.
    compare : callable
        From the unknowns to how readings are compared: `compare_vectors`, or the norms of
        `inercal.methods.centrifuge_norm.problems`.
    priors : sequence of Gaussian
        On coefficients.
    forces : mapping of str to (...) array, optional
        Specific forces without a prior, as of `problem`.
    """
    loose, known = split_parameters(declared)
    forces = forces or {}
    unknowns = Unknowns(sensor, loose, known, (*loose, *forces))
    comparison = compare(unknowns)
    first = start_values(unknowns.p, loose)
    # Without forces all trials share one start, whose Jacobian is computed once.
    if forces:
        begin = np.stack([*forces.values()], axis=-1)
        alike = np.broadcast_to(first, (*begin.shape[:-1], first.size))
        first = np.concatenate([alike, begin], axis=-1)
    return Problem(
        names=(*sensor.coefficients, *unknowns.nuisances),
        start=first,
        linearise=comparison.linearise,
        noise=comparison.noise,
        correlated=comparison.correlated,
        scale=np.concatenate([parameter_scales(sensor, loose), np.full(len(forces), G0)]),
        priors=with_bench_priors(loose, priors),
        wanted=sensor.coefficients,
        observations=comparison.rows,
        rounding=comparison.relative_size(first) * ROUNDING,
        normal_equations=comparison.normal_equations,
    )


def compare_vectors(
    unknowns: Unknowns,
    observations: Observations,
    motion_function: MotionFunction,
    reading_columns: Mapping[str, Array] | None = None,
    dwell_covariance: Callable[[Array, MeanMotion], Array] | None = None,
    stated_noise: ReadingNoise | None = None,
) -> RowComparison:
    """Compare each reading with that of the motion its axis sensed; arguments as of `problem`."""
    p, sensor, nuisances = unknowns.p, unknowns.sensor, unknowns.nuisances
    added = {n: one for n, one in (reading_columns or {}).items() if n in unknowns.estimated}
    at = [p + nuisances.index(name) for name in added]
    offsets = temperature.row_offsets(observations, sensor)
    columns = np.array(list(added.values())).T

    def sensed_motion(x: Array, dT: Array = offsets) -> MeanMotion:
        result = motion_function(unknowns.bench_values(x))
        return replace(result, motion=replace(result.motion, dT=dT)) if dT.ndim else result

    def linearise(x: Array) -> tuple[Array, Array]:
        here = sensed_motion(x)
        shape = here.motion.f.shape
        df, dw = _stacked_derivatives(here.df, nuisances, shape), None
        if here.dw:
            dw = _stacked_derivatives(here.dw, nuisances, shape)
        residual, slope = vector_residuals(
            sensor, observations.mean, x[..., :p], here.motion, df, dw
        )
        if added:
            residual = residual - x[..., at] @ columns.T
            slope[..., at] = columns
        return residual, slope

    full, correlated = stated_noise or ReadingNoise(observations.full_covariance, correlated=True)

    def noise(x: Array) -> Array:
        assert dwell_covariance is not None
        return full + dwell_covariance(x[..., :p], sensed_motion(x))

    def relative_size(x: Array) -> float:
        own = observations.full_covariance
        if stated_noise is None and dwell_covariance is not None:
            own = noise(x)
        read = np.abs(observations.mean).reshape(*observations.mean.shape[:-2], -1)
        return float(np.max(read / np.sqrt(np.diagonal(own, axis1=-2, axis2=-1))))

    def stated_motion(x: Array, which: NDArray[np.int64]) -> StatedMotion:
        own = offsets[which] if offsets.ndim == 2 and len(offsets) > 1 else offsets
        here = sensed_motion(x, own)
        return StatedMotion(here.motion, here.df, here.dw)

    equations = VectorEquations(
        sensor,
        observations.mean.reshape(-1, *observations.mean.shape[-2:]),
        stated_motion,
        nuisances,
        added,
        full,
        correlated,
        np.arange(len(observations.labels) * len(observations.channels), dtype=np.int64),
    )
    return RowComparison(
        linearise,
        full if dwell_covariance is None else noise,
        correlated,
        tuple(f"{a}[{row}]" for row in observations.labels for a in sensor.channels),
        relative_size,
        equations if dwell_covariance is None else None,
    )


def row_subset(whole: Problem, at: NDArray[np.int64]) -> Problem:
    """Return the problem of some of a problem's observations alone.

    Parameters
    ----------
    whole : Problem
        Its noise is one covariance for all x.
    at : (k,) array of int
        Indices of the observations of the subset.
    """
    assert not callable(whole.noise)
    places: list[int] = at.tolist()
    equations = whole.normal_equations

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
        normal_equations=equations.subset(at) if isinstance(equations, VectorEquations) else None,
        observations=tuple(whole.observations[k] for k in places),
        candidates=candidates if whole.candidates else None,
    )


def _stacked_derivatives(
    by: Mapping[str, Array], loose: Sequence[str], shape: tuple[int, ...]
) -> Array:
    """Return the derivatives by each nuisance, (..., r, 3, q)."""
    result = np.zeros((*shape, len(loose)))
    for k, name in enumerate(loose):
        if name in by:
            result[..., k] = by[name]
    return result


def split_parameters(
    declared: Mapping[str, Parameter],
) -> tuple[dict[str, Parameter], dict[str, Array]]:
    """Return the parameters that are estimated, and the values of the exact parameters."""
    loose = {name: parameter for name, parameter in declared.items() if parameter.sd > 0}
    known = {n: np.array(q.value) for n, q in declared.items() if n not in loose}
    return loose, known


def start_values(p: int, loose: Mapping[str, Parameter]) -> Array:
    """Return the start: p coefficients at nominal, the bench's parameters as declared."""
    return np.concatenate([np.zeros(p), [parameter.value for parameter in loose.values()]])


def parameter_scales(sensor: Sensor, loose: Mapping[str, Parameter]) -> Array:
    """Return the natural size of each coefficient and of each of the bench's parameters."""
    return np.concatenate([sensor.unit_scale, [candidates.unit_scale(q) for q in loose.values()]])


def with_bench_priors(
    loose: Mapping[str, Parameter], priors: Sequence[Gaussian]
) -> tuple[Gaussian, ...]:
    """Return the bench's parameters as priors, followed by `priors`."""
    if not loose:
        return tuple(priors)
    values, deviations = zip(*((q.value, q.sd) for q in loose.values()), strict=True)
    return (Gaussian.independent(tuple(loose), values, deviations), *priors)
