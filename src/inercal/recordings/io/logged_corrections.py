"""Corrections that a flight controller made before it logged, and how they are undone.

    reading = R ((raw − offset) ∘ scale)        raw = (Rᵀ reading) / scale + offset

R turns sensor axes to axes of the vehicle, yaw · pitch · roll. A calibration by raw readings may
replace that of the controller; one by corrected readings stands on it, and the two must stay
together: then the parameters are recorded (`stated_parameters`).

Sources: PX4, src/lib/sensor_calibration (Accelerometer.hpp, Gyroscope.hpp) and
src/lib/conversion/rotation.h; ArduPilot, libraries/AP_InertialSensor/AP_InertialSensor_Backend.cpp.
The first 39 rotations are the same in both.
"""

from collections.abc import Mapping
from dataclasses import dataclass

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

# roll, pitch, yaw, °, by the number of the parameter.
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
    """What a controller did to the readings of one sensor.

    Parameters
    ----------
    offset : (3,) array
        SI, along the axes of the sensor.
    scale : (3,) array
    rotation : (3, 3) array
        From axes of the sensor to axes of the vehicle.
    """

    offset: Array
    scale: Array
    rotation: Array

    def undo(self, readings: Array) -> Array:
        """Return the readings (n, 3) before the correction."""
        return readings @ self.rotation / self.scale + self.offset


def stated_parameters(parameters: Mapping[str, float]) -> str:
    """Return parameters in words: "INS_ACCOFFS_X 0.012, INS_ACCOFFS_Y 0.5"."""
    return ", ".join(f"{name} {value:.9g}" for name, value in sorted(parameters.items()))


def euler_matrix(roll: float, pitch: float, yaw: float) -> Array:
    """Return the matrix of a rotation, (3, 3): angles in °, yaw · pitch · roll."""
    (cr, cp, cy), (sr, sp, sy) = (f(np.radians([roll, pitch, yaw])) for f in (np.cos, np.sin))
    mat_roll = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    mat_pitch = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    mat_yaw = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    matrix = mat_yaw @ mat_pitch @ mat_roll
    # Of right angles the cosine is not exactly zero.
    exact = np.round(matrix)
    return np.where(np.abs(matrix - exact) < 1e-15, exact, matrix)


def rotation_matrix(number: float, parameter: str, source: str) -> Array:
    """Return the rotation of a parameter such as AHRS_ORIENTATION, (3, 3).

    Raises
    ------
    InputError
        A number without a rotation known here.
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
    """Return whether the option says "keep".

    Raises
    ------
    InputError
        Another word than "undo" and "keep".
    """
    if corrections not in ("undo", "keep"):
        raise InputError(
            f'{source}: [data] corrections is {corrections!r}; it is "undo" or "keep"',
            key="[data] corrections",
        )
    return corrections == "keep"
