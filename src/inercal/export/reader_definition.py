"""What a file of another program states of a sensor."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.calibration import Frame
from inercal.export.target_definition import TargetOption
from inercal.physics.sensors.sensor import Sensor

REFERENCE = Sensor("", ()).reference_temperature


@dataclass(frozen=True, eq=False)
class StatedTriad:
    """What a file states of three axes; None if it states nothing.

    Parameters
    ----------
    matrix : (3, 3) array or None
        Readings by the motion.
    scale : (3,) array or None
        The same on the axes, where nothing is stated across them.
    bias : (3,) array or None
        Reading without motion, at the reference temperature.
    bias_powers : (k, 3) array
        Coefficients of the temperature from the reference, its square, …, SI.
    sensitivity : (3, 3) array or None
        Of gyros, (rad/s)/(m/s²) or output units per m/s².
    """

    matrix: Array | None = None
    scale: Array | None = None
    bias: Array | None = None
    bias_powers: Array = field(default_factory=lambda: np.zeros((0, 3)))
    sensitivity: Array | None = None


@dataclass(frozen=True, eq=False)
class StatedCalibration:
    """What a file states of a sensor.

    Parameters
    ----------
    accelerometer, gyro : StatedTriad or None
    frame : Frame
        Of the misalignments.
    own_frame : bool
        Whether the frame is one that the program chose by the accelerometers' axes.
    output : bool
        Whether readings are the sensor's own output, not SI.
    units : (str, str) or None
        Units of the output of accelerometers and gyros, where the file states them.
    reference_temperature : float
        K.
    notes : tuple of str
    """

    accelerometer: StatedTriad | None
    gyro: StatedTriad | None
    frame: Frame = "mount"
    own_frame: bool = False
    output: bool = False
    units: tuple[str, str] | None = None
    reference_temperature: float = REFERENCE
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class CalibrationReader:
    """A format of calibrations of another program.

    Parameters
    ----------
    name, meaning : str
    read : callable
        (text, options) -> StatedCalibration.
    options : tuple of TargetOption
    """

    name: str
    meaning: str
    read: Callable[[str, Mapping[str, Any]], StatedCalibration]
    options: tuple[TargetOption, ...] = ()


def parameter_calibration(
    program: str, triads: Mapping[str, StatedTriad], references: set[float], parameter: str
) -> StatedCalibration:
    """Return the calibration that the parameters of a flight controller state.

    Parameters
    ----------
    program : str
        Its name, for the note.
    triads : mapping of "f" or "w" to StatedTriad
    references : set of float
        Reference temperatures of the triads that have one, K.
    parameter : str
        Name of the parameter of the reference temperature.

    Raises
    ------
    InputError
        The reference temperatures differ.
    """
    if len(references) > 1:
        raise InputError(
            f"{parameter} of accelerometers and gyros differ, but a sensor of inercal has only "
            "one reference temperature; import a file with only one of the two kinds"
        )
    return StatedCalibration(
        triads.get("f"),
        triads.get("w"),
        reference_temperature=next(iter(references), REFERENCE),
        notes=(f"{program} states no misalignment and no scale factor of gyros",),
    )
