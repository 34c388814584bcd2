"""Format numbers for people: quantities, intervals, durations and counts.

If a quantity has an uncertainty, the uncertainty determines the number of digits. If the number
would need an exponent, or more zeros than it has digits, the unit gets a different prefix. An
exponent is used only if no prefix fits.
"""

import re
from math import isfinite

from inercal.basics.units.expression import read_unit

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
