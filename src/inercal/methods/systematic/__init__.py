"""Calibrate an IMU that a table turns between rests, by navigation without the table's angles.

During a rest the IMU is stationary on the Earth, and gravity and the Earth's rate are known. The
gyros propagate the attitude from one rest to the next, and the velocity integrated over a turn from
rest to rest is zero. `rest_and_turn_rows` contains the equations, `_kernels` the integration.

Conventions fix the gauges. The body frame is that of the accelerometers: ax along x, ay in the xy
plane. Lever arms are relative to az, because a common arm moves a rigid point whose velocity is
zero at both ends of every turn.

Sources: Camberlein and Mangeret, Calibration technique for strapdown inertial navigation systems;
Savage 2000, Strapdown Analytics; Aitken 1935 (generalised least squares).
"""

from collections.abc import Callable
from dataclasses import replace

from inercal.basics.errors import InputError
from inercal.benches.turntable.bench import Turntable
from inercal.benches.turntable.paths import systematic_plan
from inercal.benches.turntable.still_table import StillTable
from inercal.estimation import Estimate
from inercal.methods import Method, Priors, triangular_frame
from inercal.methods.systematic.coefficient_rules import require_determined
from inercal.methods.systematic.filter_estimators import sequential, solve_by_filter
from inercal.methods.systematic.generalised_least_squares import LAG, solve
from inercal.methods.systematic.remarks import remarks
from inercal.methods.systematic.segments import (
    rest_change_test,
    segments_of_track,
    shift_forces,
    shift_forces_of_track,
)
from inercal.physics.plan import TableSteps
from inercal.physics.sensors import Sensor
from inercal.recordings import Observations, Track

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
