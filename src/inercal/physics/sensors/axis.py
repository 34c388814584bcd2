"""A measuring axis: its name, directions, readout and noise."""

from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units import si_factor
from inercal.physics.quantities import Measures
from inercal.physics.sensors.noise import Noise

_OUTPUT_UNITS = ("LSB", "V", "A", "Hz")


def output_unit(unit: str) -> str | None:
    """Return the SI unit of an output that needs a scale factor, "V" for "mV"; None for others."""
    for one in _OUTPUT_UNITS:
        with suppress(InputError):
            si_factor(unit, one)
            return one
    return None


@dataclass(frozen=True)
class Readout:
    """The readout of an axis: output = offset + scale · (reading in SI units).

    Parameters
    ----------
    scale : float
        Nominal scale factor, output units per m/s², per rad/s or per T.
    offset : float
        Output at zero reading, in output units.
    unit : str
        Name of the output unit.
    full_scale : float or None
        Largest magnitude of output − offset within the measuring range, in output units.
    """

    scale: float = 1.0
    offset: float = 0.0
    unit: str = "SI"
    full_scale: float | None = None

    def __post_init__(self) -> None:
        if not (np.isfinite(self.scale) and self.scale != 0 and np.isfinite(self.offset)):
            raise InputError(
                f"readout: scale {self.scale} and offset {self.offset}: both must be finite, and "
                "the scale not zero",
                names=("scale", "offset"),
            )


@dataclass(frozen=True)
class Axis:
    """One measuring axis.

    Parameters
    ----------
    name : str
        Name of the axis, such as "x" or "gz".
    measures : "f", "w" or "m"
        Specific force (an accelerometer), angular rate (a gyro) or magnetic flux density (a
        magnetometer).
    i, p : tuple of 3 floats
        Nominal input and pendulous axes, orthogonal unit vectors in the sensor's frame; O = I × P.
    readout, noise
        Conversion from reading to output, and noise of the reading.
    """

    name: str
    measures: Measures
    i: tuple[float, float, float]
    p: tuple[float, float, float]
    readout: Readout = Readout()
    noise: Noise = Noise()

    def __post_init__(self) -> None:
        frame = self.frame
        if not np.allclose(frame @ frame.T, np.eye(3), atol=1e-9):
            raise InputError(
                f"axis {self.name}: input axis i {self.i} and pendulous axis p {self.p} must be "
                "orthogonal unit vectors",
                names=(self.name,),
            )

    @cached_property
    def frame(self) -> Array:
        """The directions I, P and O in the sensor's frame, as rows, (3, 3)."""
        return np.array([self.i, self.p, np.cross(self.i, self.p)])
