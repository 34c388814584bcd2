"""Calibrate an IMU that a table turns between rests, by navigation without the table's angles.

During a rest the IMU is stationary on the Earth, and gravity and the Earth's rate are known. The
gyros propagate the attitude from one rest to the next, and the velocity integrated over a turn from
rest to rest is zero. `rest_and_turn_rows` contains the equations, `_kernels` the integration.

Conventions fix the gauges. The body frame is that of the accelerometers: ax along x, ay in the xy
plane. Lever arms are relative to az, because a common arm moves a rigid point whose velocity is
zero at both ends of every turn.

Sources: Camberlein and Mangeret, Calibration technique for strapdown inertial navigation systems;
Savage 2000, Strapdown Analytics; Aitken 1935 (generalised least squares).

Remarks state the lag, navigation errors, moving rests and weak turns. Only the azimuth measures
turns about the vertical, because gravity is the same at both ends. One ppm of a quarter turn is
0.3″, but the azimuth of a navigation-grade IMU has an uncertainty of 80″. A turn about the vertical
therefore says almost nothing about the scale factor and misalignments of the gyro along the turn
axis.

Navigation errors after calibration are compared with those without calibration. Over a rest of T
seconds, starting at its own attitude, body errors δf and δω cause a velocity::

    v = C δf T − ½ g e_up × C δω T²

A level navigation at rest with body axes east, north and up starts from the true state. Its errors
are as follows (Schuler oscillation with the Earth's radius R, without the vertical channel)::

    ṗ = v,   v̇ = −g e_up × ψ − 2 ω_ie × v + δf,   ψ̇ = −ω_ie × ψ − e_up × v/R + δω

Source: Titterton and Weston, Strapdown Inertial Navigation Technology, 2nd edition, 12.2.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import degrees
from typing import Any

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units import format_quantity, format_value_and_uncertainty
from inercal.benches.report_data import Panel, Plot, Series
from inercal.benches.turntable.bench import StillTable, Turntable
from inercal.benches.turntable.paths import systematic_plan
from inercal.estimation import Estimate
from inercal.estimation.uncertainty import COVERAGE
from inercal.methods import Fit, Method, Priors, Remarks, triangular_frame
from inercal.methods.systematic.filter_estimators import sequential, solve_by_filter
from inercal.methods.systematic.generalised_least_squares import (
    LAG,
    estimated_attitudes,
    require_determined,
    solve,
)
from inercal.methods.systematic.navigation import earth_rate
from inercal.methods.systematic.segments import (
    Segments,
    rest_change_deviations,
    rest_change_test,
    segments_of_track,
    shift_forces,
    shift_forces_of_track,
)
from inercal.physics.frames import log_so3, skew
from inercal.physics.motion import Motion
from inercal.physics.plan import TableSteps
from inercal.physics.sensors import Sensor
from inercal.recordings import Finding, Observations, Track

EARTH_RADIUS = 6_371_000.0  # m, mean
HOUR = 3600.0
_STEP = 4.0  # s
_UP = np.array([0.0, 0.0, 1.0])
_VERTICAL = 0.9  # cosine between turn axis and vertical, above which a turn is about the vertical
_TURNED = 0.02  # rad; the axis of a smaller turn is undefined
_NAMED = 4  # number of turns named in a message
_MOVED = 4.5  # standard deviations between halves of a rest; chance probability in 114 tests: 8e-4


def velocity_errors(
    segments: Segments, sensor: Sensor, c: Array, attitudes: Array, gravity: float, latitude: float
) -> tuple[Array, Array]:
    """Return the velocity errors after each rest, with nominal and with estimated coefficients.

    The errors are magnitudes of the horizontal velocity, (m,) m/s each.

    Parameters
    ----------
    segments : Segments
    sensor : Sensor
    c : (p,) array
        Estimated coefficients, SI.
    attitudes : (m, 3, 3) array
        C at each rest.
    gravity, latitude : float
        Local gravity, m/s², and latitude, rad.
    """
    back = attitudes.mT
    earth = earth_rate(latitude)
    f, w = gravity * back @ _UP, back @ earth
    at = sensor.linearise(Motion(f, w), c)
    slope = np.broadcast_to(at.slope, (len(f), 6, 6))
    off = (segments.mean - at.reading)[..., None]
    sensed = np.asarray(np.linalg.solve(slope, off)[..., 0], dtype=float)
    nominal = segments.mean - np.concatenate([f, w], axis=1)
    seconds = segments.rest_seconds[:, None]

    def velocity(error: Array) -> Array:
        force, rate = (
            (attitudes @ error[:, part, None])[..., 0] for part in (slice(0, 3), slice(3, 6))
        )
        v = force * seconds - 0.5 * gravity * np.cross(_UP, rate) * seconds**2
        return np.linalg.norm(v[:, :2], axis=1)

    return velocity(nominal), velocity(sensed)


def position_drift(
    sensor: Sensor, c: Array, covariance: Array, gravity: float, latitude: float
) -> tuple[Array, Array]:
    """Return the position error after an hour without calibration, and its U with calibration.

    Parameters
    ----------
    sensor : Sensor
        Three accelerometers, then three gyros.
    c, covariance : (p,) and (p, p) arrays
        Estimated coefficients and their covariance, SI.
    gravity, latitude : float
        Local gravity, m/s², and latitude, rad.
    """
    earth = earth_rate(latitude)
    design = sensor.design(Motion(gravity * _UP[None], earth[None]), np.zeros(len(c)))[0]
    by = _response(gravity, earth) @ design
    variance = np.einsum("ip,pq,iq->i", by, covariance, by)
    return by @ c, COVERAGE * np.sqrt(variance)


def _response(gravity: float, earth: Array) -> Array:
    """Return ∂(position east, north)/∂(δf, δω) after an hour, (2, 6)."""
    level = np.diag([1.0, 1.0, 0.0])
    up = skew(_UP)
    a: Array = np.zeros((9, 9))
    a[:3, 3:6] = level
    a[3:6, 3:6] = -2 * level @ skew(earth)
    a[3:6, 6:] = -gravity * level @ up
    a[6:, 3:6] = -up / EARTH_RADIUS
    a[6:, 6:] = -skew(earth)
    b = np.zeros((9, 6))
    b[3:6, :3], b[6:, 3:] = level, np.eye(3)
    x = np.zeros((9, 6))
    for _ in range(round(HOUR / _STEP)):  # fourth order; the period of the motion is 84 min
        k = [a @ x + b]
        for share in (0.5, 0.5, 1.0):
            k.append(a @ (x + share * _STEP * k[-1]) + b)
        x = x + _STEP / 6 * (k[0] + 2 * k[1] + 2 * k[2] + k[3])
    return x[:2]


def remarks(fit: Fit[Any, Any]) -> Remarks:
    """Return the lag as a condition, findings on rests, and notes."""
    if not np.all(fit.estimate.converged):
        return Remarks()
    known = StillTable.from_turntable(fit.bench)
    estimate, sensor = fit.estimate, fit.sensor
    k = estimate.names.index(LAG)
    lag = format_quantity(float(estimate.value[k]), float(estimate.std[k]), "ms")
    track = fit.observations.track
    assert track is not None  # the estimator rejects other data
    segments = segments_of_track(track, fit.observations.labels, sensor)
    z = rest_change_deviations(segments, sensor)
    findings: list[Finding] = []
    rest, axis = np.unravel_index(int(np.abs(z).argmax()), z.shape)
    if abs(z[rest, axis]) > _MOVED:
        text = (
            f"the two halves of rest {segments.labels[rest]} differ by {abs(z[rest, axis]):.1f} "
            f"standard deviations in {sensor.channels[axis]}: the table creeps or was knocked; "
            "wait longer after turns, or record again"
        )
        findings.append(Finding("warning", "moving", text))
    notes = (
        f"The accelerometers lag the gyros by {lag} (negative: they lead).",
        "The stated gravity and latitude set the scale: an error of 40 mGal changes all scale "
        "factors of accelerometers by 40 ppm, and no residual would show it.",
    )
    p = len(sensor.coefficients)
    place = known.gravity.value, known.latitude.value
    drift = position_drift(sensor, estimate.value[:p], estimate.stated_covariance[:p, :p], *place)
    before, after = (float(np.hypot(*one)) for one in drift)
    notes += (
        "After one hour of navigation at rest, z up, from the true state, the position would be "
        f"wrong by {_kilometres(before)} without this calibration, and by up to U = "
        f"{_kilometres(after)} with it (k = 2, without noise and later changes).",
    )
    attitudes = estimated_attitudes(estimate, segments, sensor, place[1])
    errors = velocity_errors(segments, sensor, estimate.value[:p], attitudes, *place)
    findings += [
        Finding("warning", "path", text)
        for text in vertical_turn_messages(attitudes, segments.labels)
    ]
    return Remarks(
        tuple(findings), notes, {"lag of the accelerometers": lag}, (_velocity_plot(*errors),)
    )


def _kilometres(metres: float) -> str:
    return f"{format_value_and_uncertainty(0.0, metres / 1e3)[1]} km"


def _velocity_plot(before: Array, after: Array) -> Plot:
    number = np.arange(1.0, len(before) + 1)
    series = tuple(
        Series(number, np.log10(np.maximum(1e3 * y, 1e-6)), name, hollow=name == "before")
        for name, y in (("before", before), ("after", after))
    )
    return Plot(
        "navigation",
        "Level velocity at the end of each rest, before and after calibration",
        "Level velocity error at the end of each rest, navigated from the rest's own attitude with "
        "nominal coefficients (before) and with the estimated ones (after), as log₁₀ of mm/s. "
        "After calibration all rests should be alike.",
        "log₁₀(mm/s)",
        (Panel("velocity over a rest", "rest", series),),
    )


def vertical_turn_messages(attitudes: Array, labels: Sequence[str]) -> tuple[str, ...]:
    """Return a warning for each body axis whose turns are about the vertical.

    Parameters
    ----------
    attitudes : (m, 3, 3) array
        C, body to n, at each rest.
    labels : sequence of m str
        Labels of the rests.
    """
    before, after = attitudes[:-1], attitudes[1:]
    in_body = log_so3(before.mT @ after)
    angle = np.linalg.norm(in_body, axis=-1)
    up = np.einsum("kij,kj->ki", before, in_body)[:, 2]
    about = np.abs(up) > _VERTICAL * np.maximum(angle, _TURNED)
    body = np.abs(in_body).argmax(axis=-1)
    found: list[str] = []
    for k, axis in enumerate("xyz"):
        turns = np.flatnonzero(about & (body == k))
        if not turns.size:
            continue
        level = float(degrees(angle[(body == k) & ~about].sum()))
        names = [f"{labels[i]} to {labels[i + 1]}" for i in turns[:_NAMED].tolist()]
        rest = f" and {turns.size - _NAMED} more" if turns.size > _NAMED else ""
        found.append(
            f"body axis {axis} turns about the vertical {turns.size} "
            f"time{'s' * (turns.size > 1)} ({', '.join(names)}{rest}): gravity cannot measure "
            f"such turns. About level axes it turns by {level:.0f}° in total. Scale factor and "
            f"misalignments of the gyro about {axis} need turns about a level axis"
        )
    return tuple(found)


_LARGEST_LAG = 0.5  # s, half of the rest that a turn has at its ends


def batch(
    observations: Observations,
    sensor: Sensor,
    bench: Turntable | StillTable,
    steps: TableSteps,
    priors: Priors = (),
) -> Estimate:
    """Return the coefficients by generalised least squares over all rests and turns.

    Parameters
    ----------
    observations : Observations
        One row for each rest, with the track of samples, from one trial.
    sensor : Sensor
        Three accelerometers, then three gyros, with their noise.
    bench : Turntable or StillTable
        Gravity and latitude.
    steps : sequence of steps
        Unused, because the gyros measure the motion.
    priors : sequence of Gaussian
        Priors on coefficients.

    Raises
    ------
    InputError
        There is no track or no noise, there are trials or fewer than six rests, or the axes do not
        fit together.
    NotObserved
        The run does not determine all coefficients.
    """
    track = _checked_track(observations, sensor, priors)
    known = StillTable.from_turntable(bench)
    segments = segments_of_track(track, observations.labels, sensor)
    estimate = _by_whole_samples_of_lag(
        lambda samples: solve(shift_forces(segments, samples), sensor, known, priors), segments.dt
    )
    return replace(estimate, tests=(*estimate.tests, rest_change_test(segments, sensor)))


def kalman(
    observations: Observations,
    sensor: Sensor,
    bench: Turntable | StillTable,
    steps: TableSteps,
    priors: Priors = (),
) -> Estimate:
    """Return the coefficients from a Kalman filter that passes over the recording several times.

    The arguments and exceptions are as for `batch`.
    """
    track = _checked_track(observations, sensor, priors)
    known = StillTable.from_turntable(bench)
    dt = float((track.time[-1] - track.time[0]) / (track.time.size - 1))
    return _by_whole_samples_of_lag(
        lambda samples: solve_by_filter(
            shift_forces_of_track(track, samples), observations.labels, sensor, known, priors
        ),
        dt,
    )


def _by_whole_samples_of_lag(solve_shifted: Callable[[int], Estimate], dt: float) -> Estimate:
    """Solve with the forces shifted by whole samples if the lag is longer than a sample.

    The models are of second order in the remaining lag.
    """
    estimate = solve_shifted(0)
    k = estimate.names.index(LAG)
    samples = round(float(estimate.value[k]) / dt)
    if abs(samples) <= 1 or abs(samples) * dt >= _LARGEST_LAG:
        return estimate
    estimate = solve_shifted(samples)
    value = estimate.value.copy()
    value[k] += samples * dt
    return replace(estimate, value=value)


def _checked_track(observations: Observations, sensor: Sensor, priors: Priors) -> Track:
    track = observations.track
    if track is None or track.reading.ndim != 2:
        raise InputError(
            "systematic needs the samples of one recording; give a recording", key="track"
        )
    for axis in sensor.axes:
        if not axis.noise.white > 0:
            raise InputError(
                f"{axis.name} has no noise density, but rests and turns are weighted by it; "
                "state it",
                key="white",
                names=(axis.name,),
            )
    require_determined(sensor, observations, priors)
    return track


METHOD = Method(
    name="systematic",
    bench=Turntable,
    default_coefficients={
        "f": ("bias", "scale", "nonorthogonality", "k2", "ax.arm", "ay.arm"),
        "w": ("bias", "scale", "misalignment"),
    },
    also={"f": ("misalignment", "az.arm", "k1_prime", "k3"), "w": ("g", "scale_prime")},
    needs=("f", "w"),
    plan=systematic_plan,
    estimators={"batch": batch, "kalman": kalman},
    closed_formulas=("kalman",),
    sequential=sequential,
    final_by_recording=True,
    frame=triangular_frame,
    remarks=remarks,
    require_determined=require_determined,
    without_angles=True,
    triads_because="without angles of the table, only three gyros can carry the attitude",
    source="Camberlein and Mangeret; Savage 2000; generalised least squares (Aitken 1935)",
)

__all__ = ["METHOD", "batch", "kalman"]
