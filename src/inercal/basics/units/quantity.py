"""Parse quantities from text such as "0.5 m ± 5 µm (k=2)"."""

import math
import re
import sys
from dataclasses import dataclass, field

from inercal.basics.units.expression import (
    NotationError,
    dimension_text,
    error_context,
    plain_text,
    read_unit,
    require_dimension,
)

_NUMBER = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
LARGEST_NUMBER = 1e30
"""Larger numbers, and the reciprocals of these, are typing errors; their powers would overflow."""

_QUANTITY = re.compile(rf"({_NUMBER}) *(.*)")
_COVERAGE = re.compile(rf"[,(]? *k *= *({_NUMBER}) *\)?$")
_GROUP = re.compile(r"\(([^±]*)±([^±)]*)\)(.*)")  # "(12 ± 3) µg"


@dataclass(frozen=True)
class Measured:
    """A value and its standard uncertainty, both in SI.

    Parameters
    ----------
    value : float
        Value, SI.
    sd : float
        Standard uncertainty (k = 1), SI; 0 means exact.
    assumed : bool
        Whether `sd` comes from the last written digit of the value, because none was stated.
    """

    value: float
    sd: float
    assumed: bool = field(default=False, repr=False)

    def key_if_assumed(self, key: str) -> str:
        """Return the key if `sd` comes from the last digit, or "" if it was stated."""
        return key if self.assumed else ""


def parse_quantity(
    text: str | float, like: str, *, last_digit: bool = False, difference: bool = False
) -> Measured:
    """Return the value and standard uncertainty, in SI, of a quantity given as text.

    Forms: "0.5 m", "0.5 m ± 5 µm", "(12 ± 3) µg", "9.81 m/s² ± 40 ppm" (relative), "0 ± 0.5 %",
    "23 °C ± 0.5 K", and any of these followed by "(k=2)"; "+/-" is read as "±".

    Parameters
    ----------
    text : str or float
        The quantity. A number, or a text without a unit, is allowed only if `like` is "1".
    like : str
        A unit of the expected dimension.
    last_digit : bool
        Whether a value without "±" gets the uncertainty of its last digit: a rectangular
        distribution with a half-width of half a digit (GUM 4.3.7), so u is half a digit divided by
        √3. If false, such a value is exact, like "± 0".
    difference : bool
        Whether the text states a difference of temperatures, so that "0.2 °C" is 0.2 K.

    Raises
    ------
    InputError
        The text is not an unambiguous, finite quantity of that dimension.

    Examples
    --------
    >>> parse_quantity("0.5 m ± 1 mm (k=2)", like="m")
    Measured(value=0.5, sd=0.0005)
    >>> round(parse_quantity("9.81 m/s²", like="m/s²", last_digit=True).sd, 7)
    0.0028868
    """
    with error_context(text):
        body, k = _coverage(_plain_quantity(text, like))
        if group := _GROUP.fullmatch(body):
            body = f"{group[1]} {group[3]}±{group[2]} {group[3]}"
        first, *rest = body.split("±")
        number, unit = _split_number_and_unit(first, like)
        if not rest and k:
            raise NotationError(
                "states k without an uncertainty; write both as in '0.5 m ± 10 µm (k=2)'"
            )
        if not rest:
            value = _value(number, unit, like, difference=difference)
            if not last_digit:
                return Measured(value, 0.0)
            return Measured(
                value, _last_digit_uncertainty(first) * read_unit(unit or "1").size, True
            )
        if len(rest) > 1:
            raise NotationError("states more than one uncertainty; write one")
        sd, sd_unit = _split_number_and_unit(rest[0], like)
        if sd < 0:
            raise NotationError("states a negative uncertainty; write it as 0 or more")
        unit = unit or _shared_unit(number, sd_unit, like)
        value = _value(number, unit, like, difference=difference)
        return Measured(value, _sd(value, unit, sd, sd_unit, like) / (k or 1.0))


def _plain_quantity(text: object, like: str) -> str:
    """Return a quantity as text in plain characters, such as "1.5" for the number 1.5."""
    if isinstance(text, str) and text.strip():
        return re.sub(r"\+ ?/? ?-", "±", plain_text(text))
    if isinstance(text, bool) or not isinstance(text, (int, float)):
        raise NotationError(f"is not a quantity such as {_example_text(1, like)}")
    if not abs(text) <= sys.float_info.max:
        raise NotationError("is not a finite number; write one")
    return repr(float(text))


def _coverage(body: str) -> tuple[str, float | None]:
    """Split off a coverage factor such as "(k=2)"."""
    found = _COVERAGE.search(body)
    if not found:
        return body, None
    k = float(found[1])
    if not 0 < k < math.inf:
        raise NotationError(
            "states a coverage factor k that is not possible; write a finite k above 0"
        )
    return body[: found.start()].strip(), k


def _split_number_and_unit(text: str, like: str) -> tuple[float, str]:
    """Split "-12 mg" into number and unit."""
    if "," in text:
        raise NotationError("has a comma; write decimals with a point")
    found = _QUANTITY.fullmatch(text.strip())
    if not found or not math.isfinite(float(found[1])):
        if like == "1":
            raise NotationError("is not a finite number, such as '0.5' or '50 %'")
        raise NotationError(
            f"is not a finite number with its unit, such as {_example_text(0.5, like)}"
        )
    number = float(found[1])
    if number and not 1 / LARGEST_NUMBER <= abs(number) <= LARGEST_NUMBER:
        raise NotationError(
            f"is not a possible size; write 0 or a number from {1 / LARGEST_NUMBER:.0e} to "
            f"{LARGEST_NUMBER:.0e}"
        )
    return number, found[2].strip()


def _last_digit_uncertainty(text: str) -> float:
    """Return half a unit of the last digit divided by √3, in the unit of the leading number."""
    found = _QUANTITY.fullmatch(text.strip())
    assert found is not None  # the caller has already parsed this text
    mantissa, _, power = found[1].lower().partition("e")
    decimals = len(mantissa.partition(".")[2])
    return 0.5 * 10.0 ** (int(power or 0) - decimals) / math.sqrt(3)


def _shared_unit(number: float, sd_unit: str, like: str) -> str:
    """Return the unit of a value without a unit, as in "12 ± 3 µg", from its uncertainty."""
    if read_unit(sd_unit or "1").dimension:
        return sd_unit
    # The value in "1 ± 40 ppm" may be 1 or 1 ppm. The two meanings only agree if the value is 0.
    if sd_unit and number and not read_unit(like).dimension:
        raise NotationError(
            f"can mean {number:g} or {number:g} {sd_unit}; write both as in '(5 ± 3) {sd_unit}'"
        )
    return ""


def _value(number: float, unit: str, like: str, *, difference: bool) -> float:
    if not unit and read_unit(like).dimension:
        raise NotationError(f"has no unit; expected {dimension_text(like, _example(number, like))}")
    read = require_dimension(unit or "1", like)
    value = number * read.size + (0.0 if difference else read.offset)
    if not abs(value) < LARGEST_NUMBER:
        raise NotationError("is too large; write a smaller number")
    return value


def _sd(value: float, unit: str, sd: float, sd_unit: str, like: str) -> float:
    """Return the standard uncertainty in SI, before division by k."""
    if unit and not sd_unit and sd == 0:
        return 0.0  # "9.81 m/s² ± 0": the value is exact, whatever the unit
    if unit and not sd_unit:
        raise NotationError(f"states an uncertainty without a unit; write '± {sd:g} {unit}'")
    unit, sd_unit = unit or "1", sd_unit or "1"
    plain = not read_unit(like).dimension
    if plain and value and unit != sd_unit:
        raise NotationError(f"is ambiguous; state the uncertainty in {unit!r} too")
    if plain or read_unit(sd_unit).dimension:
        with error_context(f"± {sd:g} {sd_unit}"):
            sd *= require_dimension(sd_unit, like).size
    elif value == 0 or read_unit(unit).offset:
        raise NotationError(f"states a relative uncertainty, undefined here; state it in {like!r}")
    else:
        sd *= read_unit(sd_unit).size * abs(value)
    if not sd < LARGEST_NUMBER:
        raise NotationError("states an uncertainty that is too large; write a smaller one")
    return sd


def _example_text(number: float, like: str) -> str:
    return repr(_example(number, like))


def _example(number: float, like: str) -> str:
    """Return a number with a usual unit, in which T is far too large for a field."""
    return f"{number:g}" if like == "1" else f"{number:g} {'µT' if like == 'T' else like}"
