"""The ranges over which a calibration was made."""

from dataclasses import dataclass, fields
from math import isfinite

from inercal.errors import InputError

Range = tuple[float, float]


@dataclass(frozen=True)
class Validity:
    """Least and largest value over the data that were used, of any axis; None is not known.

    Parameters
    ----------
    rate : (float, float) or None
        Angular rate as the gyros' nominal readout states it, rad/s.
    force : (float, float) or None
        Specific force as the accelerometers' nominal readout states it, m/s².
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
        for name, found in self.ranges.items():
            least, largest = found
            if not (isfinite(least) and isfinite(largest) and least <= largest):
                raise InputError(f"validity: {name} from {least} to {largest} is not a range")

    @property
    def ranges(self) -> dict[str, Range]:
        """The ranges that are known, by name."""
        found = {one.name: getattr(self, one.name) for one in fields(self)}
        return {name: known for name, known in found.items() if known is not None}
