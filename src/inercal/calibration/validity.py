"""The ranges of the data of a calibration."""

from dataclasses import dataclass
from math import isfinite

from inercal.basics.errors import InputError

Range = tuple[float, float]


@dataclass(frozen=True)
class Validity:
    """Least and largest value of any axis over the used data; None where not known.

    Parameters
    ----------
    rate : (float, float) or None
        Angular rate by the nominal readout of the gyros, rad/s.
    force : (float, float) or None
        Specific force by the nominal readout of the accelerometers, m/s².
    temperature : (float, float) or None
        K.

    Raises
    ------
    InputError
        A range that is not finite, or that ends before it begins.
    """

    rate: Range | None = None
    force: Range | None = None
    temperature: Range | None = None

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
        """The known ranges, by name."""
        return {name: value for name, value in vars(self).items() if value is not None}
