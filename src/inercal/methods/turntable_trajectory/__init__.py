"""Calibrate an IMU on a turntable by generalised least squares over a complete recording.

The gyros propagate the attitude from one readback to the next, ten times a second. The
accelerometers read gravity in holds. Coefficients and the table's errors, including timing, are
estimated together by Gauss–Newton steps on whitened residuals. A Kalman filter with the noise of
gyros, accelerometers and readback and the drift of biases (`turntable.drift`) whitens the residual
and every column of the Jacobian exactly. For normal noise no unbiased estimate is better
(Cramér–Rao); tests compare the filters of `turntable_kalman` with this estimate.

Source: Aitken 1935, Proc. R. Soc. Edinburgh 55, 42–48 (generalised least squares); Kailath 1968,
IEEE TAC 13, 646–655 (innovations).
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.basics.errors import InputError
from inercal.benches.turntable.bench import Turntable
from inercal.benches.turntable.paths import path_by_name
from inercal.estimation import Candidate, Estimate, Gaussian, ModelTest, Problem
from inercal.estimation import least_squares as solve
from inercal.estimation.innovations import epoch_groups, group_innovations, residual_mean_test
from inercal.methods import Method, Priors, mean_problem, temperature
from inercal.methods.candidates import prior_candidates
from inercal.methods.turntable import (
    BIAS,
    DEFAULT_COEFFICIENTS,
    FURTHER_COEFFICIENTS,
    model,
    remarks_on_samples,
    score_columns,
)
from inercal.methods.turntable.score_columns import ConstantColumn
from inercal.methods.turntable_trajectory.rows import (
    RotationRows,
    StaticRows,
    TriadRows,
    parameters,
)
from inercal.physics.plan import TableSteps
from inercal.physics.sensors import Sensor
from inercal.recordings import Observations, Track

# Whitening depends on the coefficients and sums many increments; smaller decreases of χ² are
# rounding.
_ROUNDING = 1e-7


def trajectory(
    observations: Observations,
    sensor: Sensor,
    bench: Turntable,
    steps: TableSteps,
    priors: Priors = (),
) -> Estimate:
    """Return the coefficients from a complete recording, one trial after the other.

    Parameters
    ----------
    observations : Observations
        Observations with the track of samples; the rows are not used.
    sensor : Sensor
        Triads of gyros, of accelerometers or of both, with stated noise.
    bench : Turntable
    steps : sequence of Position or Rotation
        Unused, because the motion comes from the readback.
    priors : sequence of Gaussian
        Priors on coefficients.

    Raises
    ------
    InputError
        There is no track, no rest for accelerometers, or the method does not support the sensor.
    NotObserved
        The run does not determine some directions.
    """
    if observations.track is None:
        raise InputError(
            "the data are means of positions, but turntable_trajectory needs samples; give a "
            "recording",
            key="track",
        )
    track = temperature.with_steady_temperature(observations.track)
    lead = track.reading.shape[:-2]
    spans = np.column_stack([observations.time, observations.duration])
    return stack_estimates(
        [
            # With several trials only the first is tested.
            solve_trial(sensor, bench, track.trial(*k), priors, steps=None if any(k) else spans)
            for k in np.ndindex(*lead)
        ],
        lead,
    )


def solve_trial(
    sensor: Sensor,
    bench: Turntable,
    track: Track,
    priors: Priors = (),
    epochs: Indices | None = None,
    steps: Array | None = None,
) -> Estimate:
    """Return the estimate from one trial.

    Parameters
    ----------
    sensor, bench, priors
        The same as for `trajectory`.
    track : Track
        Track of one trial.
    epochs : (e,) array of int, optional
        Samples at which the readback is compared with the gyros; None means ten times a second.
    steps : (r, 2) array, optional
        Midpoint and duration of each step of the run, s; mean residuals are tested per step.

    Raises
    ------
    InputError, NotObserved
        The same as for `trajectory`.
    """
    parts = tuple(_row_sets(sensor, bench, track, epochs))
    requested = trajectory_problem(sensor, bench, parts, priors)
    estimate = solve(requested)
    # The assumed sizes of coefficients do not count as data, and neither do lost rows.
    lost = sum(part.lost_rows for part in parts) + len(sensor.coefficients)
    estimate = replace(estimate, dof=estimate.dof - lost)
    if steps is not None:
        _, jacobian = requested.linearise(estimate.value)
        estimate = replace(estimate, tests=_tests(estimate, jacobian, parts, steps))
    estimate = with_mean_biases(estimate, sensor, bench, parts)
    for part in parts:
        at = [sensor.coefficients.index(name) for name in part.triad.sensor.coefficients]
        model.require_decided(part.triad, estimate.covariance[np.ix_(at, at)], part.triad_name)
    return estimate


def trajectory_problem(
    sensor: Sensor, bench: Turntable, parts: Sequence[TriadRows], priors: Priors = ()
) -> Problem:
    """Return the problem with the whitened residuals of one trial.

    Parameters
    ----------
    sensor : Sensor
    bench : Turntable
    parts : sequence of RotationRows or StaticRows
        The residuals of gyros and accelerometers.
    priors : sequence of Gaussian
        Priors on coefficients, in addition to those from `model.EXPECTED_SIZES`.
    """
    loose = {one.name: one for one in parameters(bench)}
    p, q = len(sensor.coefficients), len(loose)
    own = [_coefficient_indices(part, sensor) for part in parts]
    expected = [
        Gaussian.independent(one.triad.sensor.coefficients, 0.0, model.expected_size(one.triad))
        for one in parts
    ]

    def linearise(x: Array) -> tuple[Array, Array]:
        nuisances = dict(zip(loose, x[p:].tolist(), strict=True))
        residuals: list[Array] = []
        jacobians: list[Array] = []
        for part, at in zip(parts, own, strict=True):
            whole, _, _ = part.whiten(x[at], nuisances)
            jacobian = np.zeros((len(whole), p + q))
            jacobian[:, np.concatenate([at, np.arange(p, p + q)])] = whole[:, 1:]
            residuals.append(whole[:, 0])
            jacobians.append(jacobian)
        return np.concatenate(residuals), np.concatenate(jacobians)

    def candidates(x: Array) -> list[Candidate]:
        nuisances = dict(zip(loose, x[p:].tolist(), strict=True))
        found: list[tuple[tuple[ConstantColumn, ...], Array]] = []
        drifts: list[tuple[tuple[ConstantColumn, ...], Array]] = []
        by = np.eye(p + q)
        for part, at in zip(parts, own, strict=True):
            columns, beside = part.omitted_columns(x[at])
            whole, drift, _ = part.whiten(x[at], nuisances, beside)
            end = whole.shape[1] - len(columns)
            for k, one in enumerate(columns):
                if one.name in loose:  # as estimated, but without its prior
                    same = end - q + list(loose).index(one.name)
                    whole[:, end + k], drift[:, end + k] = whole[:, same], drift[:, same]
            found.append((columns, whole[:, end:]))
            mean = _mean_drift_by_coefficient(part, at, drift, p + q)
            by[:, at] -= mean[:, 1 : 1 + at.size]
            by[:, p:] -= mean[:, end - q : end]
            drifts.append((columns, mean[:, end:]))
        columns, rows = score_columns.stack_columns(found)
        # Stacked rows: each part affects only its own coefficients.
        moved = score_columns.stack_columns(drifts)[1].reshape(len(parts), p + q, -1).sum(axis=0)
        # `with_mean_biases` adds the mean drift to the estimate and to these shifts afterwards.
        before = np.asarray(np.linalg.solve(by, moved), dtype=float)
        column = dict(zip((*sensor.coefficients, *loose), linearise(x)[1].T, strict=True))
        return [
            *score_columns.candidates(columns, rows, before),
            *prior_candidates(sensor, (*sensor.coefficients, *loose), priors, column),
        ]

    start = mean_problem.start_values(p, loose)
    return Problem(
        names=(*sensor.coefficients, *loose),
        start=start,
        linearise=linearise,
        noise=np.ones(len(linearise(start)[0])),
        scale=mean_problem.parameter_scales(sensor, loose),
        priors=(*expected, *mean_problem.with_bench_priors(loose, priors)),
        wanted=sensor.coefficients,
        rounding=_ROUNDING,
        candidates=candidates,
    )


def with_mean_biases(
    estimate: Estimate, sensor: Sensor, bench: Turntable, parts: Sequence[TriadRows]
) -> Estimate:
    """Return the estimate from one trial with biases as means over the run (`turntable.drift`).

    The drift is estimated from the residuals, and depends on the parameters in the same way.

    Parameters
    ----------
    estimate : Estimate
        Estimate from `trajectory_problem`.
    sensor, bench, parts
        The same as for `trajectory_problem`.
    """
    value, by = estimate.value.copy(), np.eye(len(estimate.names))
    beyond = np.zeros_like(by)
    p = len(sensor.coefficients)
    nuisances = dict(zip(estimate.names[p:], estimate.value[p:].tolist(), strict=True))
    for part in parts:
        at, t = _coefficient_indices(part, sensor), part.triad.terms
        _, drift, covariance = part.whiten(estimate.value[at], nuisances)
        biases = np.flatnonzero(t.bias)
        axis, weight = t.axis[biases], t.weights[biases, BIAS]
        mean = _mean_drift_by_coefficient(part, at, drift, len(by))
        value += mean[:, 0]
        by[:, np.concatenate([at, np.arange(p, len(by))])] -= mean[:, 1:]
        beyond[np.ix_(at[biases], at[biases])] = covariance[np.ix_(axis, axis)] / np.outer(
            weight, weight
        )
    return replace(
        estimate,
        value=value,
        covariance=by @ estimate.covariance @ by.T + beyond,
        scoring=estimate.scoring.then(lambda one: one.with_shifts(lambda shift: by @ shift)),
    )


def _mean_drift_by_coefficient(part: TriadRows, at: Indices, drift: Array, count: int) -> Array:
    """Return the effect of each bias's mean drift on that bias, (count, m); drifts are (3, m)."""
    t, result = part.triad.terms, np.zeros((count, drift.shape[1]))
    biases = np.flatnonzero(t.bias)
    axis, weight = t.axis[biases], t.weights[biases, BIAS]
    result[at[biases]] = drift[axis] / weight[:, None]
    return result


def _tests(
    estimate: Estimate, jacobian: Array, parts: Sequence[TriadRows], steps: Array
) -> tuple[ModelTest, ...]:
    """Return the tests of mean residuals per step, for gyros and for accelerometers."""
    result: list[ModelTest] = []
    first = 0
    for part in parts:
        time, p = part.row_times, jacobian.shape[1]
        rows = slice(first, first + 3 * time.size)
        first = rows.stop
        group = epoch_groups(time, *steps.T)
        residual = estimate.whitened[rows].reshape(-1, 3)
        group[~residual.any(axis=1)] = -1  # across a gap
        z = group_innovations(residual, group)
        if not z.size:
            continue
        slope = group_innovations(jacobian[rows].reshape(-1, 3 * p), group).reshape(-1, p)
        name = f"mean residuals of the {part.triad_name} in each step"
        result.append(residual_mean_test(z.ravel(), slope, estimate.covariance, name))
    return tuple(result)


def _row_sets(
    sensor: Sensor, bench: Turntable, track: Track, epochs: Indices | None
) -> Iterator[TriadRows]:
    kinds, run_duration = {axis.measures for axis in sensor.axes}, model.run_duration(track, None)
    if "w" in kinds:
        gyros = model.triad_model(sensor, "w", run_duration)
        yield RotationRows.from_track(gyros, bench, track, epochs)
    if "f" in kinds:
        accelerometers = model.triad_model(sensor, "f", run_duration)
        yield StaticRows.from_track(accelerometers, bench, track)


def _coefficient_indices(part: TriadRows, sensor: Sensor) -> Indices:
    names = part.triad.sensor.coefficients
    return np.array([sensor.coefficients.index(name) for name in names], dtype=np.int64)


def stack_estimates(estimates: Sequence[Estimate], lead: tuple[int, ...]) -> Estimate:
    """Return the estimates from several trials as one, with leading axes for the trials."""
    if not lead:
        return estimates[0]

    def together(name: str) -> Array:
        result = np.stack([np.asarray(getattr(one, name)) for one in estimates])
        return result.reshape(*lead, *result.shape[1:])

    changed = ("value", "covariance", "chi2", "residual", "whitened", "converged", "iterations")
    return replace(estimates[0], **{name: together(name) for name in changed})


METHOD = Method(
    name="turntable_trajectory",
    bench=Turntable,
    default_coefficients=DEFAULT_COEFFICIENTS,
    also=FURTHER_COEFFICIENTS,
    needs=(),
    plan=path_by_name,
    estimators={"trajectory": trajectory},
    remarks=remarks_on_samples,
    source="Generalised least squares (Aitken 1935), whitened by innovations (Kailath 1968)",
    triads_because="it carries whole vectors from sample to sample",
)
