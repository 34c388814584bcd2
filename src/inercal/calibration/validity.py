"""The ranges of rate, force, temperature and magnetic field that a calibration's data cover."""

from dataclasses import dataclass
from math import isfinite

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError

Range = tuple[float, float]
READING_MARGIN = 0.01  # fraction of a range by which readings may be outside, because they scatter


def distance_outside(limits: Range, values: Array, margin: float) -> Array:
    """Return how far values are outside a range, in their unit; 0 up to the margin."""
    low, high = limits
    away = np.maximum(low - values, values - high)
    return np.where(away > margin, away, 0.0)


@dataclass(frozen=True)
class Validity:
    """Smallest and largest values of any axis in the data that were used; None if unknown.

    Parameters
    ----------
    rate : (float, float) or None
        Angular rate in rad/s, from the nominal readout of the gyros.
    force : (float, float) or None
        Specific force in m/s², from the nominal readout of the accelerometers.
    temperature : (float, float) or None
        Temperature in K.
    field : (float, float) or None
        Magnetic flux density in T, from the nominal readout of the magnetometers.

    Raises
    ------
    InputError
        If a range is not finite, or its upper limit is below its lower limit.
    """

    rate: Range | None = None
    force: Range | None = None
    temperature: Range | None = None
    field: Range | None = None

    def __post_init__(self) -> None:
        for name, (least, largest) in self.ranges.items():
            if not (isfinite(least) and isfinite(largest) and least <= largest):
                raise InputError(
                    f"validity: {name} is {least} to {largest}; give finite limits, the lower "
                    "first",
                    names=(name,),
                )

    @property
    def ranges(self) -> dict[str, Range]:
        """The ranges that are known, by name."""
        return {name: value for name, value in vars(self).items() if value is not None}
