"""The magnetic field at a bench, as [bench] states it: strength, dip and hemisphere."""

import re
from math import pi

from inercal.basics.units import Measured
from inercal.physics.magnetic_units import EARTH_FIELD, POSSIBLE_FIELD, unit_hint
from inercal.physics.section_settings import key_error, measured_constant

_NUMBER = re.compile(r"\s*[+-]?\d+(\.\d*)?([eE][+-]?\d+)?")
_MOST = 0.2  # largest relative uncertainty; a less certain strength is of no use
_CLEAR = 3.0  # standard uncertainties


def stated_field(text: str | None) -> Measured | None:
    """Return the strength of the field, T; None if it is not stated.

    Raises
    ------
    InputError
        The text is no flux density, or one that the Earth does not have anywhere.
    """
    if text is None:
        return None
    key = "[bench] field"
    field = measured_constant(text, "T", key)
    low, high = (f"{1e6 * end:.0f}" for end in EARTH_FIELD)
    if not POSSIBLE_FIELD[0] <= field.value <= POSSIBLE_FIELD[1]:
        number = _NUMBER.match(text)
        hint = unit_hint(abs(float(number[0]))) if number else ""
        raise key_error(
            key, f"{text!r} is not possible; the Earth's field is {low} to {high} µT{hint}"
        )
    if field.sd > _MOST * field.value:
        raise key_error(
            key, f"{text!r} is too uncertain to be of use; remove it, and the field is estimated"
        )
    return field


def stated_dip(text: str | None, hemisphere: str | None) -> Measured | None:
    """Return the dip of the field, rad; None if it is not stated.

    Raises
    ------
    InputError
        The text is no angle up to 90°, or it contradicts the hemisphere.
    """
    if text is None:
        return None
    key = "[bench] dip"
    dip = measured_constant(text, "°", key)
    if abs(dip.value) > pi / 2:
        raise key_error(key, f"{text!r} is not possible; give an angle from −90° to 90°")
    down = dip.value > 0
    if (
        hemisphere is not None
        and abs(dip.value) > _CLEAR * dip.sd
        and down != (hemisphere == "north")
    ):
        raise key_error(
            key,
            f'{text!r} contradicts hemisphere = "{hemisphere}"; the dip is positive where the '
            "field points downwards, as in the north",
        )
    return dip
