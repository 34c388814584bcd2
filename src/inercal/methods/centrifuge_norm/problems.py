"""Build maximum-likelihood problems, which compare norms, or vectors in known attitudes.

The problem of norms computes f̂ with the inverse of the sensor's model and compares ‖f̂‖ with the
norm on the arm. A rotation of the triad (h_i → R h_i) changes no norm, so it is a gauge freedom.
Lever arms act through the rate, whose direction in the body depends on the attitudes and the
mounting angles.

The problem of vectors compares each axis's reading with the reading predicted for its attitude. The
errors of the attitudes are nuisances with their stated deviations. The information in the norms is
therefore used even if the attitudes are poorly known.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from typing import TypeVar

import numpy as np

from inercal.basics.arrays import Array, Bools, Indices
from inercal.basics.parameters import Parameter
from inercal.basics.run_file_advice import Change
from inercal.benches import MeanMotion
from inercal.benches.centrifuge.arm_motion import (
    SpecificForceNorm,
    sensed_motion,
    specific_force_norm,
)
from inercal.benches.centrifuge.bench import Centrifuge
from inercal.estimation import Candidate, Problem
from inercal.estimation.gauss_newton_steps import QR_MAX_TRIALS
from inercal.estimation.problem import NormalEquations
from inercal.methods import Priors, candidates, mean_problem, temperature
from inercal.methods.centrifuge_norm import rotation_gauge
from inercal.methods.mean_problem import Unknowns
from inercal.methods.residuals import (
    NoisyNormResiduals,
    StatedNorms,
    noisy_norm_residuals,
    norm_normal_equations,
    norm_residuals,
)
from inercal.methods.residuals.term_table import term_table
from inercal.physics.plan import Spins
from inercal.physics.sensors import SI_UNITS, Sensor
from inercal.physics.sensors.coefficient_tables import TABLES
from inercal.recordings import Observations

_Result = TypeVar("_Result")
_COMPARED = 16  # number of trials that are compared
_ARM_ERROR = 0.25  # relative error of a lever arm's effect if the attitudes are unknown


def likelihood_problem(
    observations: Observations, sensor: Sensor, bench: Centrifuge, steps: Spins, priors: Priors = ()
) -> Problem:
    """Return the problem for `ml`: vectors if the bench knows its attitudes, otherwise norms."""
    build = norm_problem if bench.indexing is None else vector_problem
    return build(observations, sensor, bench, steps, priors)


def norm_problem(
    observations: Observations, sensor: Sensor, bench: Centrifuge, steps: Spins, priors: Priors = ()
) -> Problem:
    """Return the problem with norms only; arguments as for `inercal.methods.centrifuge_norm.ml`.

    The noise is given as standard deviations, or as a covariance if rows share a dwell's errors or
    a drift.

    Raises
    ------
    NotObserved
        The misalignments include rotations of the triad, and neither a gauge nor a prior fixes
        them.
    InputError
        There are lever arms, and a step has an unknown attitude.
    """
    rotation_gauge.require_gauge(sensor, priors)
    turning = sensor.uses("wi", "wp", "wo") and bench.platform == "locked"
    declared = bench.acting_parameters(steps, vectors=turning)
    built = _ungauged_norm_problem(observations, sensor, bench, steps, declared, priors)

    def all_candidates(x: Array) -> list[Candidate]:
        larger = _extended_sensor(
            sensor, bench, steps, temperature_varies=observations.temperature_varies
        )
        listed = candidates.candidate_function(
            lambda: _ungauged_norm_problem(
                observations, larger, bench, steps, candidates.parameters_with_deviations(declared)
            ),
            built.names,
            larger,
            declared,
            observations.time,
            families=_nonorthogonality_family(sensor),
            priors=priors,
        )
        arms = (
            () if larger.uses("wi", "wp", "wo") else _lever_arm_candidates(built, sensor, steps, x)
        )
        return [*_with_reversed_sense(listed(x), bench), *arms]

    return replace(
        built,
        gauges=rotation_gauge.gauges(sensor),
        known_nulls=rotation_gauge.rotation_null_directions(sensor, len(built.names)),
        candidates=all_candidates,
    )


def _with_reversed_sense(listed: Iterable[Candidate], bench: Centrifuge) -> Iterator[Candidate]:
    """Yield the candidates, and after the latitude a reversed sense of rotation.

    The sense only affects the sign of Earth's rate along the spindle, Ω sin φ.
    """
    for one in listed:
        yield one
        if one.name == "latitude" and bench.latitude is not None and bench.platform == "locked":
            rows = -2 * np.tan(bench.latitude.value) * one.rows
            other = "clockwise" if bench.sense > 0 else "counter-clockwise"
            yield Candidate(
                "reversed sense of rotation",
                "bench",
                ("sense",),
                ("",),
                rows,
                changes=(Change("bench", "sense", other),),
                is_switch=True,
            )


def _lever_arm_candidates(
    built: Problem, sensor: Sensor, steps: Spins, x: Array
) -> list[Candidate]:
    """Return candidates for lever arms along the axes when the attitudes are unknown.

    An arm l along an axis adds −ω² l (1 − v²) to the axis's reading, where v is the component of
    the vertical along the axis. Norms determine only the direction û of the force, and the vertical
    is perpendicular to it. The mean of v² over all perpendicular directions is (1 − û²)/2, which
    makes the effect inaccurate. The norm changes by û per unit of a reading.
    """
    _, jacobian = built.linearise(x)
    rates = np.array([step.rate for step in steps])
    full = [f"{axis.name}.k0" for axis in sensor.axes]
    if not set(full) <= set(built.names):
        return []
    up = jacobian[..., [built.names.index(name) for name in full]]
    columns = -(rates[:, None] ** 2) * up * (1 + up**2) / 2
    line = next(line for line in TABLES["f"] if line.name == "arm_i")
    arms = [
        candidates.Column(f"{axis.name}.arm_i", SI_UNITS[line.unit], rows, line.largest)
        for axis, rows in zip(sensor.axes, np.moveaxis(columns, -1, 0), strict=True)
    ]
    listed = candidates.together_and_alone("coefficient", [("arm_i", arms)])
    return [replace(one, effect_error=_ARM_ERROR) for one in listed]


def exact_bench_norm_problem(
    observations: Observations, sensor: Sensor, bench: Centrifuge, steps: Spins
) -> Problem:
    """Return the problem of norms that includes only the readings' noise and no bench errors."""
    exact = replace(bench, dwell_rate=0.0, dwell_tilt=0.0)
    declared = exact.acting_parameters(steps, vectors=False)
    known = {name: replace(parameter, sd=0.0) for name, parameter in declared.items()}
    return _ungauged_norm_problem(observations, sensor, exact, steps, known)


def _extended_sensor(
    sensor: Sensor, bench: Centrifuge, steps: Spins, *, temperature_varies: bool
) -> Sensor:
    """Return the sensor with all coefficients observable from norms, those of `sensor` first.

    Of the misalignments, norms observe only the non-orthogonality, which users can select by name.
    Terms of the rate are included if the rate in the body is known, and temperature terms if the
    temperature is known and varies.
    """
    turns = bench.platform == "locked" and all(step.attitude is not None for step in steps)
    words = ("nonlinearity", "asymmetry", "cross", *(("rotation", "arm") if turns else ()))
    words += ("nonorthogonality",) if _is_triad(sensor) else ("misalignment",)
    words += ("temperature",) if temperature_varies else ()
    shown = sensor.with_coefficients("bias", "scale", *words).coefficients
    more = tuple(name for name in shown if name not in sensor.coefficients)
    return replace(sensor, coefficients=(*sensor.coefficients, *more))


def _nonorthogonality_family(sensor: Sensor) -> dict[str, tuple[str, ...]]:
    """Return the non-orthogonality as a family of misalignments, under the user's name for it."""
    if not _is_triad(sensor):
        return {}
    return {"nonorthogonality": sensor.with_coefficients("nonorthogonality").coefficients}


def _is_triad(sensor: Sensor) -> bool:
    i = np.array([axis.i for axis in sensor.axes])
    return len(i) == 3 and bool(np.allclose(i @ i.T, np.eye(3), atol=1e-9))


def _ungauged_norm_problem(
    observations: Observations,
    sensor: Sensor,
    bench: Centrifuge,
    steps: Spins,
    declared: Mapping[str, Parameter],
    priors: Priors = (),
) -> Problem:
    """Return the problem of norms for any coefficients, without gauges.

    The norm of each row's specific force is compared with the norm that the arm produces.
    """
    unknowns = Unknowns(sensor, declared)
    p, loose = unknowns.p, unknowns.nuisances
    turning = sensor.uses("wi", "wp", "wo") and bench.platform == "locked"
    shared = _same_dwell_rows(observations, bench, steps)
    warmth = temperature.row_offsets(observations, sensor, priors)
    between = observations.between_rows
    in_common = between is not None or observations.common is not None
    correlated = shared is not None or in_common
    exact = None if loose else specific_force_norm(bench, steps, unknowns.exact)

    @_cache_last_result
    def compared(x: Array) -> tuple[SpecificForceNorm, MeanMotion | None, NoisyNormResiduals]:
        q = unknowns.bench_values(x)
        result = exact or specific_force_norm(bench, steps, q)
        turned = sensed_motion(bench, steps, q) if turning else None
        y, covariance = observations.mean, observations.covariance
        w = None if turned is None else turned.w
        seen = noisy_norm_residuals(sensor, y, covariance, x[..., :p], result.norm, w, warmth)
        return result, turned, seen

    def linearise(x: Array) -> tuple[Array, Array]:
        result, turned, seen = compared(x)
        if not loose:
            return seen.residual, seen.jacobian
        rows = np.broadcast_shapes(seen.residual.shape, result.norm.shape)
        jacobian = np.empty((*rows, p + len(loose)))
        jacobian[..., :p] = seen.jacobian
        for k, name in enumerate(loose):
            jacobian[..., p + k] = -result.derivatives[name] if name in result.derivatives else 0.0
            if turned is not None and name in turned.dw:
                jacobian[..., p + k] += (seen.by_rate * turned.dw[name]).sum(-1)
        return seen.residual, jacobian

    def noise(x: Array) -> Array:
        result, turned, seen = compared(x)
        if not correlated:
            return np.sqrt(seen.variance + result.dwell**2)
        full = seen.variance[..., None] * np.eye(len(steps))
        if shared is None:
            full += result.dwell[..., None] ** 2 * np.eye(len(steps))
        else:
            for name, sd in (("dwell_rate", bench.dwell_rate), ("dwell_tilt", bench.dwell_tilt)):
                by = sd * result.derivatives[name]
                full = full + shared * (by[..., :, None] * by[..., None, :])
        if not in_common:
            return full
        w = None if turned is None else turned.w
        at = norm_residuals(sensor, observations.mean, x[..., :p], result.norm, w, warmth)
        along = at.norm_by_reading
        if between is not None:
            full = full + np.einsum("...ia,ija,...ja->...ij", along, between, along)
        if observations.common is not None:
            effect = np.einsum("...ia,...iak->...ik", along, observations.common)
            full = full + effect @ effect.mT
        return full

    y, covariance, table = observations.mean, observations.covariance, term_table(sensor)

    def norm_equations(x: Array, which: Indices) -> NormalEquations:
        assert table is not None
        result = exact or specific_force_norm(bench, steps, unknowns.bench_values(x))
        norm = result.norm
        derivatives = np.zeros((len(loose), *norm.shape))
        for k, name in enumerate(loose):
            derivatives[k] = result.derivatives.get(name, 0.0)
        stated = StatedNorms(norm, derivatives, np.broadcast_to(result.dwell**2, norm.shape))
        return norm_normal_equations(table, y, covariance, warmth, stated, x, which)

    normal_equations = None if correlated or table is None else norm_equations

    def relative_size() -> float | Array:
        # For a norm of tens of g the rounding error is a millionth of the norm's uncertainty.
        x, lead = unknowns.start, observations.trial_shape
        if normal_equations is not None and lead > (QR_MAX_TRIALS,):
            # Trials differ little in this ratio unless their noise differs.
            alike = covariance.ndim == 3 or len(covariance) == 1
            some = np.arange(_COMPARED if alike and lead[0] > _COMPARED else lead[0])
            weight = normal_equations(np.tile(x, (some.size, 1)), some).weight
            made = exact or specific_force_norm(bench, steps, unknowns.bench_values(x))
            return float(np.max(made.norm * weight))
        result, _, seen = compared(x)
        return np.max(result.norm / np.sqrt(seen.variance), axis=-1)

    return unknowns.compose(
        linearise,
        noise,
        observations.labels,
        priors,
        relative_size(),
        correlated=correlated,
        normal_equations=normal_equations,
    )


def _same_dwell_rows(observations: Observations, bench: Centrifuge, steps: Spins) -> Bools | None:
    """Return which rows share a dwell, (r, r), or None if rows do not share any dwell error."""
    if not (bench.dwell_rate or bench.dwell_tilt):
        return None
    at_azimuth = np.array([step.azimuth is not None for step in steps])
    same = observations.time[:, None] == observations.time
    same &= at_azimuth[:, None] & at_azimuth
    return (same | np.eye(len(steps), dtype=bool)) if at_azimuth.any() else None


def vector_problem(
    observations: Observations, sensor: Sensor, bench: Centrifuge, steps: Spins, priors: Priors = ()
) -> Problem:
    """Return the problem of vectors in known attitudes; the arguments are as for `norm_problem`.

    Raises
    ------
    InputError
        A step has an unknown attitude.
    """
    own = {"dwell_rate": bench.dwell_rate, "dwell_tilt": bench.dwell_tilt}
    own = {name: sd for name, sd in own.items() if sd}

    def dwells(c: Array, sensed: MeanMotion) -> Array:
        slope = sensor.slope(sensed.motion, c)[..., :3]
        r, m = observations.mean.shape[-2:]
        blocks = np.zeros((*c.shape[:-1], r, m, r, m))
        for name, sd in own.items():
            by = sd * (slope @ sensed.df[name][..., None])[..., 0]
            for k in range(r):
                blocks[..., k, :, k, :] += by[..., k, :, None] * by[..., k, None, :]
        return blocks.reshape(*c.shape[:-1], r * m, r * m)

    built = mean_problem.problem_of_readings(
        observations,
        sensor,
        bench.acting_parameters(steps, vectors=True),
        lambda q: sensed_motion(bench, steps, q),
        priors,
        dwell_covariance=dwells if own else None,
        with_drift_candidate=True,
        families=_nonorthogonality_family(sensor)
        | {"misalignment": sensor.with_coefficients("misalignment").coefficients},
    )
    listed = built.candidates
    assert listed is not None

    def all_candidates(x: Array) -> list[Candidate]:
        return [*_with_reversed_sense(listed(x), bench)]

    return replace(built, gauges=rotation_gauge.gauges(sensor), candidates=all_candidates)


def _cache_last_result(work: Callable[..., _Result]) -> Callable[..., _Result]:
    """Cache a function's last result, because residual and noise are computed at the same x."""
    last: list[tuple[tuple[Array, ...], _Result]] = []

    def result(*x: Array) -> _Result:
        if not (last and all(map(np.array_equal, last[0][0], x))):
            last[:] = [(tuple(a.copy() for a in x), work(*x))]
        return last[0][1]

    return result
