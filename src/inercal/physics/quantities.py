"""What an axis measures, as records: words, units, and the coefficients of bias and scale factor.

A further quantity is one more record here, with its table of coefficients.
"""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Quantity:
    """A measured quantity.

    Parameters
    ----------
    symbol : str
        Of the field, as in `Axis.measures`: "f".
    name : str
        "specific force".
    sensor, sensors : str
        What measures it, which is also its section of a run file, and the plural.
    unit, ascii_unit : str
        SI, and as files of programs write it.
    reading_unit, bias_unit, noise_unit : str
        Units of readings, of biases and of white noise in messages and reports.
    bias, scale : str
        Short names of its bias and scale factor in the table of coefficients.
    """

    symbol: str
    name: str
    sensor: str
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
