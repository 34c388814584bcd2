"""Traditional calibration on a turntable, with means at rest and over whole turns.

Accelerometers read gravity in fixed positions. Gyros read the earth's rate in these positions, and
constant rates of both signs in rotations. The sum over both signs gives the biases and the earth's
rate, and the difference gives scale and misalignment. The table's errors are nuisances with their
stated deviations. The drift of the biases correlates neighbouring rows
(`turntable.drift.covariance_of_means`), and a bias is its mean over the run. Accelerometer readings
during rotations are not used, because an unstated lever arm would affect them.

The motion is the mean of what an IMU senses in a position or over a rotation. The readback's
attitude C_k at times t_k is wrong by a small rotation φ_k = B_k β in the level frame::

    f̄ = mean Cᵀ(v + v × φ),  v = (0, 0, g)
    ω̄ = mean Cᵀ(Ω + Ω × φ) + Σ log(C_kᵀ C_k+1)/T + Σ Cᵀ (φ_k+1 − φ_k)/T

Ω is the earth's rate. Means are computed by the trapezoidal rule. Harmonics cancel over whole
turns. A delay of the readback shifts the sum at its two ends. The shift is zero from rest to rest
and at a constant rate.

Source: IEEE Std 1293 and 1431, multipoint and rate tests; Titterton and Weston, Strapdown Inertial
Navigation Technology, 2nd edition, chapter 8.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import copysign, pi

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.keys import CoefficientName
from inercal.basics.parameters import Parameter
from inercal.benches import MeanMotion
from inercal.benches.turntable.attitude import Misalignment, linear_misalignment, reference_attitude
from inercal.benches.turntable.bench import Turntable
from inercal.benches.turntable.paths import path_by_name
from inercal.estimation import Estimate, Problem
from inercal.estimation import least_squares as solve
from inercal.methods import Method, Priors, mean_problem
from inercal.methods.observability import require_observed
from inercal.methods.turntable import DEFAULT_COEFFICIENTS, FURTHER_COEFFICIENTS, remarks
from inercal.methods.turntable.drift import covariance_of_means
from inercal.methods.turntable.score_columns import families
from inercal.physics.earth import earth_rate_up_north
from inercal.physics.frames import log_so3, skew
from inercal.physics.motion import Motion
from inercal.physics.plan import Position, Rotation, TableSteps
from inercal.physics.sensors import Sensor
from inercal.recordings import STAMP_ROUNDING, Observations, Track

_TURN_POINTS = 361  # points per turn, if the turn comes from the plan
_MIN_SAMPLES = 3  # samples per row


@dataclass(frozen=True, eq=False)
class AxisAngles:
    """The table's angles over time in one row.

    Parameters
    ----------
    time : (n,) array
        Times, s; a single sample means a fixed position.
    angles : (..., n, k) array
        Readback, rad; the outermost axis comes first.
    """

    time: Array
    angles: Array


def declared_parameters(bench: Turntable) -> dict[str, Parameter]:
    """Return the bench's parameters by name, with its latitude, which is exact."""
    meaning = "latitude of the bench"
    latitude = Parameter("latitude", "rad", 0.0, "run", bench.latitude, meaning)
    return bench.acting_parameters() | {"latitude": latitude}


def planned_angles(bench: Turntable, steps: TableSteps) -> list[AxisAngles]:
    """Return the planned angles; a rotation is represented by one turn at its constant rate.

    Parameters
    ----------
    bench : Turntable
    steps : sequence of TableStep
        Steps in the order of execution: a rotation may begin where the step before ended.
    """
    now = np.zeros(len(bench.axes))
    ways: list[AxisAngles] = []
    for step in steps:
        if step.angles is not None:
            now = np.array(step.angles, dtype=float)
        if isinstance(step, Position):
            ways.append(AxisAngles(np.zeros(1), now[None]))
            continue
        turned = np.zeros((_TURN_POINTS, len(now)))
        turned[:, step.axis] = np.linspace(0, copysign(2 * pi, step.angle), _TURN_POINTS)
        ways.append(AxisAngles(np.linspace(0, 2 * pi / step.rate, _TURN_POINTS), now + turned))
        now = now.copy()
        now[step.axis] += step.angle
    return ways


def _time_weights(time: Array) -> Array:
    """Return the weight of each sample in a trapezoidal time mean, (n,)."""
    if len(time) == 1:
        return np.ones(1)
    steps = np.diff(time) / (time[-1] - time[0])
    weights = np.zeros(len(time))
    weights[1:] += 0.5 * steps
    weights[:-1] += 0.5 * steps
    return weights


def row_means(bench: Turntable, time: Array, mat: Array, seen: Misalignment) -> MeanMotion:
    """Return the sensed motion in one row, assuming that the readback is correct.

    Parameters
    ----------
    bench : Turntable
    time : (n,) array
        Times, s.
    mat : (..., n, 3, 3) array
        Attitude from the readback, body to level.
    seen : Misalignment
        Rotation of the attitude by the bench's parameters, at the same samples.
    """
    up, north = earth_rate_up_north(bench.latitude)
    force, earth = np.array([0, 0, bench.gravity.value]), np.array([0, north, up])
    back = mat.mT
    weighted = _time_weights(time)[:, None, None] * back
    mean = weighted.sum(axis=-3)
    # Means of products of an element of Cᵀ and one of B: (..., 9, 3 q) over n samples.
    products = weighted.reshape(*mat.shape[:-2], 9).mT @ seen.by.reshape(*mat.shape[:-2], -1)
    products = products.reshape(*products.shape[:-2], 3, 3, 3, -1)

    def moved(v: Array) -> Array:
        """Return mean Cᵀ (v × B), (..., 3, q)."""
        return np.einsum("jk,...ijkq->...iq", skew(v), products)

    f, w = mean @ force, mean @ earth
    by_f, by_w = moved(force), moved(earth)
    northward = np.array([0, -up, north])  # ∂(earth's rate)/∂(latitude)
    dw = {"latitude": mean @ northward}
    if len(time) > 1:
        lasting = time[-1] - time[0]
        steps = log_so3(back[..., :-1, :, :] @ mat[..., 1:, :, :])
        turned = steps.sum(axis=-2) / lasting
        middle = 0.5 * (back[..., :-1, :, :] + back[..., 1:, :, :])
        by_w = by_w + np.sum(middle @ np.diff(seen.by, axis=-3), axis=-3) / lasting
        rates = steps / np.diff(time)[:, None]
        first, last = (
            1.5 * rates[..., a, :] - 0.5 * rates[..., b, :] for a, b in ((0, 1), (-1, -2))
        )
        dw["latency"] = (last - first) / lasting
        dw["clock"] = turned
        w = w + turned
    names = [q.name for q in seen.parameters]
    df = {name: by_f[..., j] for j, name in enumerate(names)} | {"g": f / bench.gravity.value}
    dw |= {name: by_w[..., j] for j, name in enumerate(names)}
    return MeanMotion(Motion(f, w), df, dw)


def stack_row_means(bench: Turntable, ways: Sequence[AxisAngles]) -> MeanMotion:
    """Return the motion in all rows, (..., r, 3), and its sensitivity to the bench's parameters.

    Raises
    ------
    InputError
        The number of axes in the angles is wrong.
    """
    lead = np.broadcast_shapes(*(way.angles.shape[:-2] for way in ways))
    angles = np.concatenate(
        [np.broadcast_to(way.angles, (*lead, *way.angles.shape[-2:])) for way in ways], axis=-2
    )
    mat, seen = reference_attitude(bench, angles), linear_misalignment(bench, angles)
    result: list[MeanMotion] = []
    start = 0
    for way in ways:
        at = slice(start, start := start + len(way.time))
        there = Misalignment(seen.parameters, seen.by[..., at, :, :])
        result.append(row_means(bench, way.time, mat[..., at, :, :], there))
    zero = np.zeros_like(result[0].f)
    df = {n: np.stack([one.df[n] for one in result], axis=-2) for n in result[0].df}
    names = dict.fromkeys(name for one in result for name in one.dw)
    dw = {n: np.stack([one.dw.get(n, zero) for one in result], axis=-2) for n in names}
    f, w = (np.stack([getattr(one, which) for one in result], axis=-2) for which in "fw")
    return MeanMotion(Motion(f, w), df, dw)


def sensed_motion(bench: Turntable, nominal: MeanMotion, q: Mapping[str, Array]) -> MeanMotion:
    """Return the sensed motion with bench parameters q, to first order in their errors.

    Parameters
    ----------
    bench : Turntable
    nominal : MeanMotion
        The same as for `stack_row_means`.
    q : mapping of str to (...) array
        Values by name, SI; missing parameters have their declared values.
    """
    known = declared_parameters(bench)
    f, w, df, dw = nominal.f, nominal.w, nominal.df, nominal.dw
    for name in (one for one in {**df, **dw} if one in q):
        # The readback is not corrected for its stated delay, so the full delay acts as an error.
        off = q[name] - (0.0 if name == "latency" else known[name].value)
        if np.any(off):
            beside = off[..., None, None]
            f = f + df[name] * beside if name in df else f
            w = w + dw[name] * beside if name in dw else w
    return MeanMotion(Motion(f, w), df, dw)


def least_squares(
    observations: Observations,
    sensor: Sensor,
    bench: Turntable,
    steps: TableSteps,
    priors: Priors = (),
) -> Estimate:
    """Return the coefficients, with one row for each position and each rotation.

    Parameters
    ----------
    observations : Observations
        (..., r, m) in SI. If there is a track, its readback states the table's attitude in each row
        and how far it turned. Otherwise positions are as planned, and rotations are whole turns at
        the constant rate.
    sensor : Sensor
        Accelerometers, gyros or both, with the coefficients to estimate.
    bench : Turntable
    steps : sequence of r Position or Rotation
        The steps of the rows, in the order of execution.
    priors : sequence of Gaussian
        Priors on coefficients, from other measurements.

    Raises
    ------
    InputError
        The steps do not match the rows, two steps have the same label, the angles do not fit
        the table's axes, or a row has no noise.
    NotObserved
        These steps do not determine all coefficients.
    """
    mean_problem.require_matching_rows(observations, sensor, steps)
    if observations.track is None:
        _require_axes(bench, steps)
        ways = planned_angles(bench, steps)
    else:
        observations, ways = _rows_from_readback(observations, observations.track, steps)
        observations = _add_readback_noise(observations, sensor, bench, steps)
    estimate = solve(
        discrete_problem(_with_stated_drift(observations, sensor), sensor, bench, ways, priors)
    )
    require_observed(estimate, sensor, missing=())
    return replace(estimate, noise_dof=observations.dof)  # for means, although there is a track


def discrete_problem(
    observations: Observations,
    sensor: Sensor,
    bench: Turntable,
    row_angles: Sequence[AxisAngles],
    priors: Priors = (),
) -> Problem:
    """Return the problem with the readings of the axes that have coefficients.

    Accelerometer readings during rotations are not included.

    Parameters
    ----------
    observations : Observations
        (..., r, m) in SI.
    sensor : Sensor
    bench : Turntable
    row_angles : sequence of r AxisAngles
        Angles of the rows.
    priors : sequence of Gaussian
        Priors on coefficients.
    """
    nominal = stack_row_means(bench, row_angles)
    acting = {*nominal.df, *nominal.dw}
    known = {n: p for n, p in declared_parameters(bench).items() if n in acting}
    whole = mean_problem.problem_of_readings(
        observations,
        sensor,
        known,
        lambda q: sensed_motion(bench, nominal, q),
        priors,
        with_drift_candidate=True,
        families=families(bench),
    )
    turns = np.array([len(way.time) > 1 for way in row_angles])
    forces = np.array([axis.measures == "f" for axis in sensor.axes])
    names = {CoefficientName(name).axis for name in sensor.coefficients}
    estimated = np.array([axis.name in names for axis in sensor.axes])
    at = np.flatnonzero(~(turns[:, None] & forces) & estimated)
    return mean_problem.row_subset(whole, at)


def _add_readback_noise(
    observations: Observations, sensor: Sensor, bench: Turntable, steps: TableSteps
) -> Observations:
    """Return the observations with the readback's white noise σ added to their covariance.

    In a position the mean of n readings has the error σ/√n about each axis, which rotates gravity.
    In a rotation over T both ends have the error σ, which gives √2 σ/T in the mean rate. Axes that
    are not at right angles share these errors.
    """
    count, lasting = observations.samples, observations.duration
    turns = np.array([isinstance(step, Rotation) for step in steps])
    force = np.where(turns, 0.0, bench.gravity.value * bench.white / np.sqrt(count))
    rate = np.where(turns, np.sqrt(2) * bench.white / lasting, 0.0)
    forces = np.array([axis.measures == "f" for axis in sensor.axes])
    sd = np.where(forces, force[:, None], rate[:, None])
    directions = np.array([axis.i for axis in sensor.axes])
    added = sd[..., None] * sd[..., None, :] * (directions @ directions.T)
    return replace(observations, covariance=observations.covariance + added)


def _with_stated_drift(observations: Observations, sensor: Sensor) -> Observations:
    """Return the observations with the sensor's stated drift instead of any other drift."""
    noises = [axis.noise for axis in sensor.axes]
    if not any(one.bias_instability or one.random_walk for one in noises):
        return observations
    start = observations.time - observations.duration / 2
    stop = start + observations.duration
    track, run = observations.track, (float(start.min()), float(stop.max()))
    if track is not None:
        run = float(track.time[0]), float(track.time[-1])
    return replace(observations, drift=covariance_of_means(noises, start, stop, run))


def _rows_from_readback(
    observations: Observations, track: Track, steps: TableSteps
) -> tuple[Observations, list[AxisAngles]]:
    """Return the rows' angles from the readback, and means of rotations over the same span."""
    means, ways = observations.mean.copy(), list[AxisAngles]()
    for r, step in enumerate(steps):
        reach = observations.duration[r] / 2 + STAMP_ROUNDING
        at = np.flatnonzero(np.abs(track.time - observations.time[r]) <= reach)
        if at.size < _MIN_SAMPLES:
            raise InputError(
                f"step {step.label}: the recording has {at.size} samples of this step, but "
                f"{_MIN_SAMPLES} are needed; check the times of the step",
                names=(step.label,),
            )
        if isinstance(step, Rotation):
            # A label may begin with the first moving sample, so the sample before is at rest.
            at = np.arange(max(int(at[0]) - 1, 0), int(at[-1]) + 1)
        time, angles = track.time[at], track.angles[..., at, :]
        if isinstance(step, Position):
            ways.append(AxisAngles(time[:1], angles.mean(axis=-2, keepdims=True)))
        else:
            ways.append(AxisAngles(time, angles))
            means[..., r, :] = _time_weights(time) @ track.reading[..., at, :]
    return replace(observations, mean=means), ways


def _require_axes(bench: Turntable, steps: TableSteps) -> None:
    k = len(bench.axes)
    for step in steps:
        if step.angles is not None and len(step.angles) != k:
            raise InputError(
                f"step {step.label} has {len(step.angles)} angles, but the table has {k} axes",
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
