"""Undo the corrections that a flight controller made before it wrote the log.

    reading = R ((raw − offset) ∘ scale)        raw = (Rᵀ reading) / scale + offset

R rotates from sensor axes to vehicle axes, yaw · pitch · roll. A calibration from raw readings can
replace that of the controller. A calibration from corrected readings depends on the controller's
calibration, and the two must stay together, so its parameters are recorded (`stated_parameters`).

Sources: PX4, src/lib/sensor_calibration (Accelerometer.hpp, Gyroscope.hpp) and
src/lib/conversion/rotation.h; ArduPilot, libraries/AP_InertialSensor/AP_InertialSensor_Backend.cpp.
The first 39 rotations are the same in both programs.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.recordings.io.readers import Option

CORRECTIONS_OPTION = Option(
    "corrections",
    str,
    "undo",
    '"undo" gives the readings before the corrections of the flight controller, "keep" those after',
)

COPY_AGAIN = "copy it from the flight controller again"


def damaged_log(kind: str, path: Path, at: int, why: str) -> InputError:
    """Return the error for a log of some kind, "a ULog file", that is damaged at a byte."""
    return InputError(f"{path.name} is not {kind} or is damaged at byte {at}: {why}; {COPY_AGAIN}")


# Roll, pitch and yaw in °, by the value of the parameter.
ROTATIONS: tuple[tuple[int, int, int], ...] = (
    *((0, 0, yaw) for yaw in range(0, 360, 45)),
    *((180, 0, yaw) for yaw in (0, 45, 90, 135)),
    (0, 180, 0),
    *((180, 0, yaw) for yaw in (225, 270, 315)),
    *((90, 0, yaw) for yaw in (0, 45, 90, 135)),
    *((270, 0, yaw) for yaw in (0, 45, 90, 135)),
    (0, 90, 0),
    (0, 270, 0),
    (0, 180, 90),
    (0, 180, 270),
    *((roll, 90, 0) for roll in (90, 180, 270)),
    (90, 180, 0),
    (270, 180, 0),
    *((roll, 270, 0) for roll in (90, 180, 270)),
    (90, 180, 90),
    (90, 0, 270),
    (90, 68, 293),
)


@dataclass(frozen=True, eq=False)
class Correction:
    """The correction that a controller applied to the readings of one sensor.

    Parameters
    ----------
    offset : (3,) array
        Offset along the sensor axes, SI.
    scale : (3,) array
    rotation : (3, 3) array
        Rotation from sensor axes to vehicle axes.
    """

    offset: Array
    scale: Array
    rotation: Array

    def undo(self, readings: Array) -> Array:
        """Return the readings (n, 3) as they were before the correction."""
        return readings @ self.rotation / self.scale + self.offset


def stated_parameters(parameters: Mapping[str, float]) -> str:
    """Write parameters as text: "INS_ACCOFFS_X 0.012, INS_ACCOFFS_Y 0.5"."""
    return ", ".join(f"{name} {value:.9g}" for name, value in sorted(parameters.items()))


def euler_matrix(roll: float, pitch: float, yaw: float) -> Array:
    """Return the rotation matrix, (3, 3), for angles in °: yaw · pitch · roll."""
    (cr, cp, cy), (sr, sp, sy) = (f(np.radians([roll, pitch, yaw])) for f in (np.cos, np.sin))
    mat_roll = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    mat_pitch = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    mat_yaw = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    matrix = mat_yaw @ mat_pitch @ mat_roll
    # The cosine of a right angle is not exactly zero.
    exact = np.round(matrix)
    return np.where(np.abs(matrix - exact) < 1e-15, exact, matrix)


def rotation_matrix(number: float, parameter: str, source: str) -> Array:
    """Return the rotation for a parameter such as AHRS_ORIENTATION, (3, 3).

    Raises
    ------
    InputError
        The number does not stand for any known rotation.
    """
    if number not in range(len(ROTATIONS)):
        raise InputError(
            f"{source}: {parameter} is {number:g}, an unknown rotation; state corrections = "
            '"keep" to calibrate the corrected readings',
            key="[data] corrections",
            names=(parameter,),
        )
    return euler_matrix(*ROTATIONS[int(number)])


def keeps_corrections(corrections: str, source: str) -> bool:
    """Return whether the corrections option is "keep".

    Raises
    ------
    InputError
        The option is neither "undo" nor "keep".
    """
    if corrections not in ("undo", "keep"):
        raise InputError(
            f'{source}: [data] corrections is {corrections!r}; it is "undo" or "keep"',
            key="[data] corrections",
        )
    return corrections == "keep"
