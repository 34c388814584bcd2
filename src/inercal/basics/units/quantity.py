"""Parse quantities from text such as "0.5 m ± 5 µm (k=2)", and format numbers for people.

If a quantity has an uncertainty, the uncertainty determines the number of digits. If the number
would need an exponent, or more zeros than it has digits, the unit gets a different prefix. An
exponent is used only if no prefix fits.
"""

import math
import re
import sys
from dataclasses import dataclass, field
from math import isfinite

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
        The quantity. A number other than 0, or a text with one and without a unit, is allowed only
        if `like` is "1": for `like` "%" or "ppm", "5" could mean 5 %.
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
        raise NotationError(f"is not a quantity such as {_example(1, like)!r}")
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
            f"is not a finite number with its unit, such as {_example(0.5, like)!r}"
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
    if not unit and (read_unit(like).dimension or (number and like != "1")):
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
    if not unit and not sd_unit and sd and like != "1":
        raise NotationError(f"has no unit; write '± {sd:g} %', or another unit such as ppm")
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


def _example(number: float, like: str) -> str:
    """Return a number with a usual unit, in which T is far too large for a field."""
    return f"{number:g}" if like == "1" else f"{number:g} {'µT' if like == 'T' else like}"


_PREFIXED = tuple(
    tuple(names.split())
    for names in (
        "nm µm mm m",
        "ns µs ms s",
        "nrad µrad mrad rad",
        "µK mK K",
        "µV mV V kV",
        "nA µA mA A",
        "mHz Hz kHz MHz",
        "ng µg mg g",
        "nT µT mT T",
        "ppm %",
    )
)
"""Lists of units that can replace each other as the first factor of a unit, ordered by size."""
_WHOLE = (("nm", "µm", "mm", "m", "km"), ("″", "°"), ("°/h", "°/s"))
_FIRST_FACTOR = re.compile("°[CF]|[A-Za-zµ]+|%")
_PLAIN_FROM, _PLAIN_TO = -4, 7  # powers of ten for which a number has no exponent
_SMALL, _LARGE_ENOUGH = 0.01, 0.1  # smaller numbers are printed in another unit
_DURATIONS = ((86400.0, "d"), (3600.0, "h"), (60.0, "min"))  # s


def format_quantity(value: float, sd: float, unit: str, digits: int = 7) -> str:
    """Return a quantity as text, rounded to two significant digits of the uncertainty.

    Parameters
    ----------
    value, sd : float
        Value and standard uncertainty, SI. An `sd` of 0 is not printed. If `sd` is not finite, the
        value is printed unrounded.
    unit : str
        The unit to print; "1" prints none. Its prefix changes if the number would be too large or
        too small.
    digits : int
        Significant digits of a value whose `sd` is 0.

    Examples
    --------
    >>> format_quantity(1.2346e-4, 4.03e-6, "µg")
    '12.59 ± 0.41 µg'
    >>> format_quantity(3.04e-3, 0.0, "µg", 2), format_quantity(4.2e-5, 1e-6, "m")
    ('0.31 mg', '42.0 ± 1.0 µm')
    """
    unit = _fitting_unit(value, sd, unit, digits)
    read = read_unit(unit)
    value, sd = (value - read.offset) / read.size, sd / read.size
    after = "" if unit == "1" else f" {unit}"
    if sd == 0 or not isfinite(value):
        return f"{format_number(value, digits)}{after}"
    if not isfinite(sd):
        return f"{format_number(value, digits)} ± {sd:g}{after}"
    last = _power(sd, 2) - 1  # decimal place of the second digit of the sd
    first = _power(max(abs(value), sd), 16)
    power = 0 if _PLAIN_FROM <= first < _PLAIN_TO else first
    tail = f"e{power}" if power else ""
    value, sd = (round(x, -last) / 10.0**power + 0.0 for x in (value, sd))  # + 0.0: no "-0.0"
    places = max(power - last, 0)
    return f"{value:.{places}f}{tail} ± {sd:.{places}f}{tail}{after}"


def format_value_and_uncertainty(value: float, uncertainty: float) -> tuple[str, str]:
    """Return both numbers as text, rounded to two significant digits of the uncertainty.

    This function is for columns with a common unit; `format_quantity` chooses the unit itself.

    Examples
    --------
    >>> format_value_and_uncertainty(-0.123456, 0.00123)
    ('-0.1235', '0.0012')
    >>> format_value_and_uncertainty(54321.2, 1234.0)
    ('54300', '1200')
    """
    if not (isfinite(uncertainty) and uncertainty > 0):
        return f"{value:.7g}", f"{uncertainty:g}"
    places = 1 - _power(uncertainty, 2)
    rounded = (round(x, places) + 0.0 for x in (value, uncertainty))  # + 0.0: no "-0"
    shown = max(places, 0)
    first, second = (f"{x:.{shown}f}" for x in rounded)
    return first, second


def format_interval(value: float, low: float, high: float) -> str:
    """Return both ends of an interval, with enough digits to differ from the value inside.

    Examples
    --------
    >>> format_interval(109.933, 109.9214, 109.9446), format_interval(0.5, 0.0, 1.24)
    ('109.921 … 109.945', '0.00 … 1.24')
    """
    gaps = [abs(end - value) for end in (low, high) if isfinite(end) and end != value]
    if not gaps:
        return f"{low:.3g} … {high:.3g}"
    return " … ".join(
        format_value_and_uncertainty(end, min(gaps))[0] if isfinite(end) else f"{end:g}"
        for end in (low, high)
    )


def format_number(value: float, digits: int) -> str:
    """Return a number with some significant digits, like format "g", but "310" for "3.1e+02".

    Examples
    --------
    >>> [format_number(x, 2) for x in (310, 0.50, 0.000123, 4.56e-9)]
    ['310', '0.5', '0.00012', '4.6e-9']
    """
    mantissa, _, power = f"{value + 0.0:.{digits - 1}e}".partition("e")  # + 0.0: no "-0"
    if not power or _PLAIN_FROM <= int(power) < _PLAIN_TO:
        tail = ""
        mantissa = f"{float(f'{value:.{digits}g}') + 0.0:.{max(digits - 1 - int(power or 0), 0)}f}"
    else:
        tail = f"e{int(power)}"
    return (mantissa.rstrip("0").rstrip(".") if "." in mantissa else mantissa) + tail


def format_duration(seconds: float, digits: int = 3) -> str:
    """Return a duration in days, hours, minutes or seconds, to `digits` significant digits.

    Examples
    --------
    >>> [format_duration(t) for t in (4.25, 107, 11520, 21600, 9e6)]
    ['4.25 s', '107 s', '3.2 h', '6 h', '104 d']
    """
    size, unit = next((one for one in _DURATIONS if seconds >= 2 * one[0]), (1.0, "s"))
    return f"{format_number(seconds / size, digits if seconds < 100 * size else 3)} {unit}"


def format_count(count: int, noun: str, plural: str = "") -> str:
    """Return a count with its noun in the singular or plural; the plural is noun + "s" by default.

    Examples
    --------
    >>> format_count(1, "outlier"), format_count(0, "rest"), format_count(2, "pass", "passes")
    ('1 outlier', '0 rests', '2 passes')
    """
    return f"{count} {noun if count == 1 else plural or f'{noun}s'}"


def _fitting_unit(value: float, sd: float, unit: str, digits: int) -> str:
    """Return the unit in which a quantity needs neither an exponent nor padding zeros."""
    units, k = _ladder(unit)
    largest = max((abs(x) for x in (value, sd) if isfinite(x)), default=0.0)
    if not largest:
        return unit
    sizes = [read_unit(one).size for one in units]
    if largest / sizes[k] < _SMALL:
        k = max((j for j in range(k) if largest / sizes[j] >= 1), default=0)
    while k + 1 < len(units) and largest / sizes[k + 1] >= _LARGE_ENOUGH:
        last = (
            _power(sd / sizes[k], 2) - 1 if sd else _power(largest / sizes[k], digits) + 1 - digits
        )
        if last <= 0:
            break
        k += 1
    return units[k]


def _ladder(unit: str) -> tuple[tuple[str, ...], int]:
    """Return the units that may replace a unit, ordered by size, and the index of this unit."""
    for whole in _WHOLE:
        if unit in whole:
            return whole, whole.index(unit)
    found = _FIRST_FACTOR.match(unit)
    for first in _PREFIXED:
        if found and found[0] in first:
            return tuple(one + unit[found.end() :] for one in first), first.index(found[0])
    return (unit,), 0


def _power(x: float, digits: int) -> int:
    """Return the power of ten of a number after rounding to significant digits."""
    return int(f"{x:.{digits - 1}e}".partition("e")[2])
