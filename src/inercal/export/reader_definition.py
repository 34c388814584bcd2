"""Declarations of readers for `inercal import`: what a file of another program states."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from inercal.basics.arrays import Array
from inercal.calibration import Frame
from inercal.export.target_definition import TargetOption
from inercal.physics.quantities import Measures
from inercal.physics.sensors import Sensor

REFERENCE = Sensor("", ()).reference_temperature


@dataclass(frozen=True, eq=False)
class StatedTriad:
    """Values that a file states for three axes; a value that is not stated is None.

    Parameters
    ----------
    matrix : (3, 3) array or None
        Matrix from the motion to readings.
    scale : (3,) array or None
        Diagonal of the matrix, if the file states no cross-axis elements.
    bias : (3,) array or None
        Reading without motion, at the reference temperature.
    bias_powers : (k, 3) array
        Coefficients of ΔT, ΔT², … in SI, where ΔT is the temperature difference from the reference.
    sensitivity : (3, 3) array or None
        Acceleration sensitivity of gyros, (rad/s)/(m/s²) or output units per m/s².
    """

    matrix: Array | None = None
    scale: Array | None = None
    bias: Array | None = None
    bias_powers: Array = field(default_factory=lambda: np.zeros((0, 3)))
    sensitivity: Array | None = None


@dataclass(frozen=True, eq=False)
class StatedCalibration:
    """The calibration of a sensor as stated in a file.

    Parameters
    ----------
    triads : mapping of Measures to StatedTriad
        The accelerometers "f", gyros "w" and magnetometers "m" that the file states.
    frame : Frame
        Frame of the misalignments.
    own_frame : bool
        Whether the accelerometers' axes define the frame in this program.
    output : bool
        Whether readings are in the sensor's own output units instead of SI.
    units : tuple of str, or None
        Output units of accelerometers, gyros and magnetometers, if the file states them.
    reference_temperature : float
        Reference temperature, K.
    notes : tuple of str
    """

    triads: Mapping[Measures, StatedTriad]
    frame: Frame = "mount"
    own_frame: bool = False
    output: bool = False
    units: tuple[str, ...] | None = None
    reference_temperature: float = REFERENCE
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class CalibrationReader:
    """The reader for a calibration format of another program.

    Parameters
    ----------
    name, meaning : str
    read : callable
        Function (text, options) -> StatedCalibration.
    options : tuple of TargetOption
    """

    name: str
    meaning: str
    read: Callable[[str, Mapping[str, Any]], StatedCalibration]
    options: tuple[TargetOption, ...] = ()
