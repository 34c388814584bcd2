"""An IMU on a turntable by the traditional procedure: means at rest, and over steady whole turns.

Accelerometers read gravity in positions; gyros read the earth's rate there and steady rates of
both signs in rotations. The sum over both signs gives biases and the earth's rate, the difference
scale and misalignment. The table's errors are nuisances with their stated deviations; the drift of
biases correlates neighbouring rows (`turntable.drift.covariance_of_means`), and a bias is its mean
over the run. Accelerometers in rotations are not used: an unstated lever arm would add to them.

Source: IEEE Std 1293 and 1431, multipoint and rate tests; Titterton and Weston, Strapdown Inertial
Navigation Technology, 2nd edition, chapter 8.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from inercal.basics.errors import InputError
from inercal.benches.turntable.bench import Turntable
from inercal.benches.turntable.paths import path_by_name
from inercal.estimation import Estimate, Gaussian, Problem
from inercal.estimation import least_squares as solve
from inercal.methods import mean_problem
from inercal.methods._base import Method
from inercal.methods.observability import require_observed
from inercal.methods.turntable import DEFAULT_COEFFICIENTS, FURTHER_COEFFICIENTS
from inercal.methods.turntable.drift import covariance_of_means
from inercal.methods.turntable.fit_remarks import remarks
from inercal.methods.turntable.score_columns import families
from inercal.methods.turntable_discrete.mean_motion import (
    AxisAngles,
    declared_parameters,
    planned_angles,
    sensed_motion,
    stack_row_means,
    time_mean,
)
from inercal.physics.plan import Position, Rotation, TableStep
from inercal.physics.sensors import Sensor
from inercal.recordings import STAMP_ROUNDING, Observations, Track

_MIN_SAMPLES = 3  # samples of a row


def least_squares(
    observations: Observations,
    sensor: Sensor,
    bench: Turntable,
    steps: Sequence[TableStep],
    priors: Sequence[Gaussian] = (),
) -> Estimate:
    """Return the coefficients from one row for each position and each rotation.

    Parameters
    ----------
    observations : Observations
        (..., r, m) in SI. With a track, its readback says where the table was in each row and how
        far it turned; without one, positions are as planned and rotations whole turns at the
        steady rate.
    sensor : Sensor
        Accelerometers, gyros or both, and the coefficients that are wanted.
    bench : Turntable
    steps : sequence of r Position or Rotation
        Of the rows, in the order they were carried out.
    priors : sequence of Gaussian
        On coefficients, from elsewhere.

    Raises
    ------
    InputError
        Steps that are not those of the rows, two of one label, angles of other axes than the
        table's, or a row without noise.
    NotObserved
        Coefficients that these steps do not determine.
    """
    mean_problem.require_matching_rows(observations, sensor, steps)
    if observations.track is None:
        _require_axes(bench, steps)
        ways = planned_angles(bench, steps)
    else:
        observations, ways = _rows_from_readback(observations, observations.track, steps)
        observations = _add_readback_noise(observations, sensor, bench, steps)
    estimate = solve(problem(_with_stated_drift(observations, sensor), sensor, bench, ways, priors))
    require_observed(estimate, sensor, missing=())
    return replace(estimate, noise_dof=observations.dof)  # of means, although there is a track


def problem(
    observations: Observations,
    sensor: Sensor,
    bench: Turntable,
    row_angles: Sequence[AxisAngles],
    priors: Sequence[Gaussian] = (),
) -> Problem:
    """Return the problem of all readings but those of accelerometers in rotations.

    Parameters
    ----------
    observations : Observations
        (..., r, m) in SI.
    sensor : Sensor
    bench : Turntable
    row_angles : sequence of r AxisAngles
        Of the rows.
    priors : sequence of Gaussian
        On coefficients.
    """
    motion, df, dw = stack_row_means(bench, row_angles)
    known = {n: p for n, p in declared_parameters(bench).items() if n in df or n in dw}
    whole = mean_problem.problem(
        observations,
        sensor,
        known,
        lambda q: sensed_motion(bench, motion, df, dw, q),
        priors,
        with_drift_candidate=True,
        families=families(bench),
    )
    turns = np.array([len(way.time) > 1 for way in row_angles])
    forces = np.array([axis.measures == "f" for axis in sensor.axes])
    at = np.flatnonzero(~(turns[:, None] & forces))
    return mean_problem.row_subset(whole, at)


def _add_readback_noise(
    observations: Observations, sensor: Sensor, bench: Turntable, steps: Sequence[TableStep]
) -> Observations:
    """Return the observations with the readback's white noise σ in their covariance.

    In a position the mean of n readings errs by σ/√n about each axis, which turns gravity; in a
    rotation over T both ends err by σ, which is √2 σ/T in the mean rate.
    """
    count, lasting = observations.samples, observations.duration
    turns = np.array([isinstance(step, Rotation) for step in steps])
    force = np.where(turns, 0.0, bench.gravity.value * bench.white / np.sqrt(count))
    rate = np.where(turns, np.sqrt(2) * bench.white / lasting, 0.0)
    forces = np.array([axis.measures == "f" for axis in sensor.axes])
    sd = np.where(forces, force[:, None], rate[:, None])
    added = sd[..., None] ** 2 * np.eye(len(sensor.axes))
    return replace(observations, covariance=observations.covariance + added)


def _with_stated_drift(observations: Observations, sensor: Sensor) -> Observations:
    """Return the observations with the drift that the sensor states, in place of another."""
    noises = [axis.noise for axis in sensor.axes]
    if not any(one.bias_instability or one.random_walk for one in noises):
        return observations
    start = observations.time - observations.duration / 2
    stop = start + observations.duration
    track = observations.track
    run = (
        (float(start.min()), float(stop.max()))
        if track is None
        else (float(track.time[0]), float(track.time[-1]))
    )
    return replace(observations, drift=covariance_of_means(noises, start, stop, run))


def _rows_from_readback(
    observations: Observations, track: Track, steps: Sequence[TableStep]
) -> tuple[Observations, list[AxisAngles]]:
    """Return the rows' ways by readback, and rotations' means by trapezoids over the same span."""
    means, ways = observations.mean.copy(), list[AxisAngles]()
    for r, step in enumerate(steps):
        reach = observations.duration[r] / 2 + STAMP_ROUNDING
        at = np.flatnonzero(np.abs(track.time - observations.time[r]) <= reach)
        if at.size < _MIN_SAMPLES:
            raise InputError(
                f"step {step.label}: the recording has {at.size} samples of this step; it needs "
                f"{_MIN_SAMPLES}: check the times of the step",
                names=(step.label,),
            )
        if isinstance(step, Rotation):
            # A label may begin with the first moving sample: the sample before is at rest.
            at = np.arange(max(int(at[0]) - 1, 0), int(at[-1]) + 1)
        time, angles = track.time[at], track.angles[..., at, :]
        if isinstance(step, Position):
            ways.append(AxisAngles(time[:1], angles.mean(axis=-2, keepdims=True)))
        else:
            ways.append(AxisAngles(time, angles))
            means[..., r, :] = time_mean(track.reading[..., at, :], time)
    return replace(observations, mean=means), ways


def _require_axes(bench: Turntable, steps: Sequence[TableStep]) -> None:
    k = len(bench.axes)
    for step in steps:
        if step.angles is not None and len(step.angles) != k:
            raise InputError(
                f"step {step.label}: {len(step.angles)} angles are given; the table has {k} axes",
                names=(step.label,),
            )
        if not isinstance(step, Position) and step.axis >= k:
            raise InputError(
                f"step {step.label}: the table has no axis {step.axis}; its axes are 0 to {k - 1}",
                names=(step.label,),
            )


METHOD = Method(
    name="turntable_discrete",
    bench=Turntable,
    default_coefficients=DEFAULT_COEFFICIENTS,
    also=FURTHER_COEFFICIENTS,
    needs=(),
    plan=partial(path_by_name, path="discrete"),
    estimators={"least_squares": least_squares},
    remarks=remarks,
    source="IEEE Std 1293 and 1431, multipoint and rate tests on a turntable",
)
