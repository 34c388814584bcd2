"""What an axis measures, as records: words, units, and the names of bias and scale factor."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

Measures = Literal["f", "w"]
SensorKind = Literal["accelerometer", "gyro"]
"""The symbol of a quantity in `QUANTITIES`."""


@dataclass(frozen=True)
class Quantity:
    """A measured quantity.

    Parameters
    ----------
    symbol : "f" or "w"
        The letter in `Axis.measures`, "f".
    name : str
        "specific force".
    sensor, sensors : str
        The word for what measures it, which also names its section of a run file; its plural.
    unit, ascii_unit : str
        The SI unit, and the same in ASCII for exported files.
    reading_unit, bias_unit, noise_unit : str
        Units of readings, of biases and of white noise in messages and reports.
    bias, scale : str
        Short names of its bias and scale factor in the table of coefficients.
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
    bias: str
    scale: str


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
    bias="bias",
    scale="scale",
)
QUANTITIES: Mapping[str, Quantity] = {one.symbol: one for one in (SPECIFIC_FORCE, ANGULAR_RATE)}
