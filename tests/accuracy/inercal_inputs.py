"""Generated sessions as inputs of inercal: recording, marks, bench and plan."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from tests.accuracy.ferraris import CHANNELS, FerrarisSession, Handling, Imu

from inercal.basics.units import Measured
from inercal.benches import Hand
from inercal.physics.plan import HandStep, Hold, Turn
from inercal.physics.sensors import Sensor
from inercal.recordings import Mark, Observations, Recording
from inercal.recordings.segments import average_sections

Array = NDArray[np.float64]


def recording(made: FerrarisSession, trial: int | None = None) -> Recording:
    """Return the recording of all trials, or of one without the axis of trials."""
    data = made.data if trial is None else made.data[trial]
    units = ("m/s²",) * 3 + ("rad/s",) * 3
    return Recording(made.time, data, CHANNELS, units, labels=made.labels())


def make_marks(made: FerrarisSession) -> tuple[Mark, ...]:
    return tuple(Mark(label, *span) for label, span in made.marks.items())


def make_observations(
    made: FerrarisSession, sensor: Sensor, steps: tuple[HandStep, ...], trial: int | None = None
) -> Observations:
    return average_sections(recording(made, trial), sensor, make_marks(made), steps)


def make_bench(hands: Handling, **changes: Any) -> Hand:
    """Return the bench that states what the hands did; changes state something else."""
    stated: dict[str, Any] = {
        "tilt": hands.tilt,
        "turn_angle": hands.turn_angle,
        "turn_tilt": hands.turn_tilt,
        "timebase": hands.timebase,
    }
    gravity = Measured(hands.gravity, hands.gravity_sd)
    return Hand(gravity, hands.latitude, **(stated | changes))


def true_coefficients(imu: Imu, sensor: Sensor) -> Array:
    named = imu.coefficients()
    return np.array([named[name] for name in sensor.coefficients])


def make_hold(label: str, up: Array, seconds: float = 10.0) -> Hold:
    return Hold(label, (float(up[0]), float(up[1]), float(up[2])), seconds)


def make_turn(label: str, axis: Array, angle: float, seconds: float = 8.0) -> Turn:
    return Turn(label, (float(axis[0]), float(axis[1]), float(axis[2])), angle, seconds)
