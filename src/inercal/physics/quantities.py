"""Define the quantities that an axis can measure: their words, units and coefficient names."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

Measures = Literal["f", "w", "m"]
KINDS: tuple[Measures, ...] = ("f", "w", "m")
INERTIAL: tuple[Measures, ...] = ("f", "w")
"""The kinds of axes that sense motion."""
SensorKind = Literal["accelerometer", "gyro", "magnetometer"]
"""The words for the kinds of sensor."""


@dataclass(frozen=True)
class Quantity:
    """A measured quantity.

    Parameters
    ----------
    symbol : "f", "w" or "m"
        The letter used in `Axis.measures`, such as "f".
    name : str
        Name of the quantity, such as "specific force".
    sensor, sensors : str
        The word for a sensor of this quantity, which is also the name of its section in a run file,
        and its plural.
    unit, ascii_unit : str
        The SI unit, and its ASCII form for exported files.
    reading_unit, bias_unit, noise_unit : str
        Units of readings, of biases and of white noise in messages and reports.
    fine_unit, integral_unit : str
        Units of the bias instability and of the quantisation, which is an error of the integral.
    bias, scale : str
        Short names of the bias and the scale factor in the coefficient table.
    """

    symbol: Measures
    name: str
    sensor: SensorKind
    sensors: str
    unit: str
    ascii_unit: str
    reading_unit: str
    bias_unit: str
    noise_unit: str
    fine_unit: str
    integral_unit: str
    bias: str
    scale: str

    @property
    def letter(self) -> str:
        """The first letter of the names of axes, such as "a" of "ax"."""
        return self.sensor[0]


SPECIFIC_FORCE = Quantity(
    symbol="f",
    name="specific force",
    sensor="accelerometer",
    sensors="accelerometers",
    unit="m/s²",
    ascii_unit="m/s^2",
    reading_unit="g",
    bias_unit="µg",
    noise_unit="µg/√Hz",
    fine_unit="µg",
    integral_unit="m/s",
    bias="k0",
    scale="k1",
)
ANGULAR_RATE = Quantity(
    symbol="w",
    name="angular rate",
    sensor="gyro",
    sensors="gyros",
    unit="rad/s",
    ascii_unit="rad/s",
    reading_unit="°/s",
    bias_unit="°/h",
    noise_unit="°/√h",
    fine_unit="°/h",
    integral_unit="″",
    bias="bias",
    scale="scale",
)
MAGNETIC_FLUX_DENSITY = Quantity(
    symbol="m",
    name="magnetic flux density",
    sensor="magnetometer",
    sensors="magnetometers",
    unit="T",
    ascii_unit="T",
    reading_unit="µT",
    bias_unit="µT",
    noise_unit="nT/√Hz",
    fine_unit="nT",
    integral_unit="nT·s",
    bias="bias",
    scale="scale",
)
QUANTITIES: Mapping[str, Quantity] = {
    one.symbol: one for one in (SPECIFIC_FORCE, ANGULAR_RATE, MAGNETIC_FLUX_DENSITY)
}
