"""Units of magnetic flux density that fit the field of the Earth."""

from inercal.basics.units import si_factor

EARTH_FIELD = (22e-6, 67e-6)  # T, over all places on Earth (World Magnetic Model 2025)
POSSIBLE_FIELD = (10e-6, 200e-6)  # T; indoors, iron changes the field of the Earth
_UNITS = ("T", "mT", "µT", "nT", "gauss", "mG")


def unit_of_earth_field(strength: float) -> str | None:
    """Return the unit in which a number is the strength of the Earth's field; None if none is.

    The ranges of the units do not overlap, because they differ by factors of 10 at least.

    >>> [unit_of_earth_field(x) for x in (48.6, 0.486, 486.0, 48600.0, 5.0)]
    ['µT', 'gauss', 'mG', 'nT', None]
    """
    low, high = EARTH_FIELD
    return next((unit for unit in _UNITS if low <= strength * si_factor(unit) <= high), None)


def unit_hint(strength: float) -> str:
    """Return a hint to the unit that fits a number, such as "; 486 fits in mG"; may be empty."""
    unit = unit_of_earth_field(strength)
    return "" if unit is None else f", and {strength:.4g} fits if the unit is {unit}"
