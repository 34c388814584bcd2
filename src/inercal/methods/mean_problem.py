"""Build the problem that compares mean readings with the motion that the bench states.

The motion is a function of the bench's declared parameters. Parameters with a standard deviation
are nuisances; the others are exact.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Bools, Indices, row_products
from inercal.basics.errors import InputError
from inercal.basics.parameters import Parameter
from inercal.benches import MeanBench, MeanMotion
from inercal.estimation import Candidate, Estimate, Gaussian, Problem
from inercal.estimation.problem import Linearise, NormalEquationsOf
from inercal.methods import Priors, candidates, solving, temperature
from inercal.methods.residuals import VectorEquations, vector_residuals
from inercal.methods.solving import require_matching_rows
from inercal.physics.sensors import G0, Sensor
from inercal.recordings import Observations

ROUNDING = 2.0**-50  # relative to a reading: the error of the few operations that compute it

MotionFunction = Callable[[Mapping[str, Array]], MeanMotion]


class ReadingNoise(NamedTuple):
    """Standard deviations of readings, (..., m r), or their covariance, (..., m r, m r)."""

    noise: Array
    correlated: bool


@dataclass(frozen=True, eq=False)
class Unknowns:
    """The parameters of a problem: coefficients, uncertain bench parameters, and forces.

    Parameters
    ----------
    sensor : Sensor
        The sensor with the coefficients to estimate.
    declared : mapping of str to Parameter
        The bench's parameters by full name; those with a deviation are nuisances.
    forces : mapping of str to (...) array
        Start values of specific forces without a prior, as for `problem_of_readings`.
    """

    sensor: Sensor
    declared: Mapping[str, Parameter]
    forces: Mapping[str, Array] = field(default_factory=dict[str, Array])

    @property
    def p(self) -> int:
        """Number of coefficients of the sensor."""
        return len(self.sensor.coefficients)

    @cached_property
    def estimated(self) -> dict[str, Parameter]:
        """The bench's parameters that have a standard deviation."""
        return {name: one for name, one in self.declared.items() if one.sd > 0}

    @cached_property
    def exact(self) -> dict[str, Array]:
        """Values of the bench's exact parameters, () SI."""
        return {n: np.array(q.value) for n, q in self.declared.items() if n not in self.estimated}

    @property
    def nuisances(self) -> tuple[str, ...]:
        """Names of the parameters that come after the coefficients."""
        return (*self.estimated, *self.forces)

    @cached_property
    def start(self) -> Array:
        """Start of a search; if there are no forces, all trials share one start."""
        first = start_values(self.p, self.estimated)
        if not self.forces:  # with a shared start the Jacobian is computed once
            return first
        begin = np.stack([*self.forces.values()], axis=-1)
        alike = np.broadcast_to(first, (*begin.shape[:-1], first.size))
        return np.concatenate([alike, begin], axis=-1)

    def bench_values(self, x: Array) -> Mapping[str, Array]:
        """Return the bench's parameters by full name, (...) SI, from parameters x (..., p + k)."""
        return self.exact | {n: x[..., self.p + k] for k, n in enumerate(self.nuisances)}

    def compose(
        self,
        linearise: Linearise,
        noise: Array | Callable[[Array], Array],
        observations: tuple[str, ...],
        priors: Priors,
        relative_size: float | Array,
        *,
        correlated: bool,
        normal_equations: NormalEquationsOf | None,
    ) -> Problem:
        """Return the problem with these parameters; arguments as for `inercal.estimation.Problem`.

        `relative_size` is the largest ratio of an observation to its deviation (per trial), and
        `priors` apply to coefficients.
        """
        scale = parameter_scales(self.sensor, self.estimated)
        return Problem(
            names=(*self.sensor.coefficients, *self.nuisances),
            start=self.start,
            linearise=linearise,
            noise=noise,
            correlated=correlated,
            scale=np.concatenate([scale, np.full(len(self.forces), G0)]),
            priors=with_bench_priors(self.estimated, priors),
            wanted=self.sensor.coefficients,
            observations=observations,
            rounding=relative_size * ROUNDING,
            normal_equations=normal_equations,
        )


def joint(
    observations: Observations,
    sensor: Sensor,
    bench: MeanBench,
    steps: Sequence[Any],
    priors: Priors = (),
) -> Estimate:
    """Return the estimate from mean readings, with the errors of the bench as nuisances.

    Methods without their own estimator use this one, on any bench that states mean motions.

    Parameters
    ----------
    observations : Observations
        (..., r, m), SI.
    sensor : Sensor
        The sensor with the coefficients to estimate.
    bench : MeanBench
        A bench without parameters in the scope "dwell".
    steps : sequence of r Step
        The steps of the rows; planned steps without a row are ignored.
    priors : sequence of Gaussian
        Priors on coefficients.

    Raises
    ------
    InputError
        Rows and steps do not match, or the bench has a parameter in the scope "dwell".
    NotObserved
        These steps do not determine all coefficients; the message names them.
    """
    by_label = {step.label: step for step in steps}
    done = [by_label[label] for label in observations.labels if label in by_label]
    require_matching_rows(observations, sensor, done)
    declared = bench.nuisances(done, sensor)
    noisy = tuple(name for name, one in declared.items() if one.scope == "dwell" and one.sd > 0)
    if noisy:
        raise InputError(
            f"estimator joint cannot model that [bench] {noisy[0]} differs from dwell to "
            "dwell; set it to 0, or use another estimator",
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
        lambda some, own: problem_of_readings(
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


def problem_of_readings(
    observations: Observations,
    sensor: Sensor,
    declared: Mapping[str, Parameter],
    motion_function: MotionFunction,
    priors: Priors = (),
    *,
    reading_columns: Mapping[str, Array] | None = None,
    dwell_covariance: Callable[[Array, MeanMotion], Array] | None = None,
    with_drift_candidate: bool = False,
    families: Mapping[str, Sequence[str]] | None = None,
    common_errors: Sequence[str] = (),
    unknown_forces: Mapping[str, Array] | None = None,
    stated_noise: ReadingNoise | None = None,
    zero_input: Bools | None = None,
    suspects: Mapping[str, Parameter] | None = None,
) -> Problem:
    """Return the estimation problem with all readings.

    Parameters
    ----------
    observations : Observations
        (..., r, m), m/s².
    sensor : Sensor
        Sensor with m accelerometers.
    declared : mapping of str to Parameter
        The bench's parameters by full name.
    motion_function : callable
        Maps the parameters' values by full name, (...) SI, to the sensed motion.
    priors : sequence of Gaussian
        Priors on coefficients.
    reading_columns : mapping of str to (m r,) array, optional
        Direct effect of a unit of each parameter on the readings, row after row.
    dwell_covariance : callable, optional
        Maps coefficients and sensed motion to a covariance that is added to that of the means.
    with_drift_candidate : bool
        Whether a linear drift of the biases over the rows' times is a candidate for score tests.
    families : mapping of str to sequence of str, optional
        Families of candidates, as for `inercal.methods.candidates.candidate_function`.
    common_errors : sequence of str, optional
        Errors of single rows that may be common to all rows, as for
        `inercal.methods.candidates.common_error_candidates`.
    unknown_forces : mapping of str to (...) array, optional
        Start values of specific forces without a prior, m/s², under the names that
        `motion_function` expects.
    stated_noise : ReadingNoise, optional
        Noise that replaces the noise of the observations.
    zero_input : (m r,) array of bool, optional
        The same as for `inercal.methods.candidates.candidate_function`.
    suspects : mapping of str to Parameter, optional
        The bench parameters that are candidates, if these are more than the declared ones.
    """
    given = observations, motion_function, reading_columns or {}, dwell_covariance, stated_noise
    forces, own = unknown_forces or {}, priors
    doubted = declared if suspects is None else suspects

    def build(unknowns: Unknowns, priors: Priors = ()) -> Problem:
        warmth = temperature.row_offsets(observations, unknowns.sensor, own)
        return _compare_vectors(unknowns, priors, warmth, *given)

    def larger() -> Problem:
        whole = candidates.extended_sensor(
            sensor, temperature_varies=observations.temperature_varies
        )
        return build(Unknowns(whole, candidates.parameters_with_deviations(doubted), forces))

    built = build(Unknowns(sensor, declared, forces), priors)
    return replace(
        built,
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


def _compare_vectors(
    unknowns: Unknowns,
    priors: Priors,
    offsets: Array,
    observations: Observations,
    motion_function: MotionFunction,
    reading_columns: Mapping[str, Array],
    dwell_covariance: Callable[[Array, MeanMotion], Array] | None,
    stated_noise: ReadingNoise | None,
) -> Problem:
    """Compare each reading with the motion that its axis sensed; see `problem_of_readings`."""
    p, sensor, nuisances = unknowns.p, unknowns.sensor, unknowns.nuisances
    added = {n: one for n, one in reading_columns.items() if n in unknowns.estimated}
    at = [p + nuisances.index(name) for name in added]
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
            residual = residual - row_products(x[..., at], columns.T)
            slope[..., at] = columns
        return residual, slope

    full, correlated = stated_noise or ReadingNoise(observations.full_covariance, correlated=True)

    def noise(x: Array) -> Array:
        assert dwell_covariance is not None
        return full + dwell_covariance(x[..., :p], sensed_motion(x))

    own = observations.full_covariance
    if stated_noise is None and dwell_covariance is not None:
        own = noise(unknowns.start)
    read = np.abs(observations.mean).reshape(*observations.mean.shape[:-2], -1)
    relative_size = np.max(read / np.sqrt(np.linalg.diagonal(own)), axis=-1)

    def stated_motion(x: Array, which: Indices) -> MeanMotion:
        own = offsets[which] if offsets.ndim == 2 and len(offsets) > 1 else offsets
        return sensed_motion(x, own)

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
    return unknowns.compose(
        linearise,
        full if dwell_covariance is None else noise,
        tuple(f"{a}[{row}]" for row in observations.labels for a in sensor.channels),
        priors,
        relative_size,
        correlated=correlated,
        normal_equations=equations if dwell_covariance is None else None,
    )


def row_subset(whole: Problem, at: Indices) -> Problem:
    """Return the problem with only some of its observations.

    Parameters
    ----------
    whole : Problem
        A problem whose noise is one covariance for all x.
    at : (k,) array of int
        Indices of the observations in the subset.
    """
    assert not callable(whole.noise)
    places: list[int] = at.tolist()
    equations = whole.normal_equations

    def linearise(x: Array) -> tuple[Array, Array]:
        residual, jacobian = whole.linearise(x)
        return residual[..., at], jacobian[..., at, :]

    def candidates(x: Array) -> list[Candidate]:
        assert whole.candidates is not None
        kept = (replace(one, rows=one.rows[..., at, :]) for one in whole.candidates(x))
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
    """Return the derivatives with respect to each nuisance, (..., r, 3, q)."""
    result = np.zeros((*shape, len(loose)))
    for k, name in enumerate(loose):
        if name in by:
            result[..., k] = by[name]
    return result


def start_values(p: int, loose: Mapping[str, Parameter]) -> Array:
    """Return the start: p coefficients at nominal, and the bench's parameters as declared."""
    return np.concatenate([np.zeros(p), [parameter.value for parameter in loose.values()]])


def parameter_scales(sensor: Sensor, loose: Mapping[str, Parameter]) -> Array:
    """Return the natural size of each coefficient and of each bench parameter."""
    return np.concatenate([sensor.unit_scale, [candidates.unit_scale(q) for q in loose.values()]])


def with_bench_priors(loose: Mapping[str, Parameter], priors: Priors) -> tuple[Gaussian, ...]:
    """Return the bench's parameters as priors, followed by `priors`."""
    if not loose:
        return tuple(priors)
    values, deviations = zip(*((q.value, q.sd) for q in loose.values()), strict=True)
    return (Gaussian.independent(tuple(loose), values, deviations), *priors)
