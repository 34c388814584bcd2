"""Parse units such as "µg/g²" or "°/√h" into SI size and dimension.

This small grammar rejects invalid text immediately::

    product = factor { ["·" | "*" | "/"] factor }
    factor  = ("√" | "sqrt") factor | (name | "1" | "(" product ")") [power]
    power   = ("^" | "**") exponent | superscripts | a digit directly after the name, as in "m/s2"

The units are defined by prefixes, SI sizes and dimensions. A unit is a size times a
product of powers of other units. To find the size and dimension of a product of units, each unit is
expanded into base units, one for each dimension, in the written order::

    size = Π size_i^power_i,   dimension = Σ power_i dimension_i
"""

import math
import re
from collections import deque
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from difflib import get_close_matches
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

from inercal.basics.errors import InputError

if TYPE_CHECKING:
    from inercal.basics.arrays import Array


class UnitDefinition(NamedTuple):
    """The definition of a unit: its names, allowed prefixes, and size in other units."""

    names: tuple[str, ...]  # in the order in which messages list them; the first is canonical
    prefixes: str
    size: float
    powers: Mapping[str, float]  # power of each other unit, by canonical name
    dimension: str = ""  # dimension of a base unit


def _base(names: str, prefixes: str, dimension: str) -> UnitDefinition:
    return UnitDefinition(tuple(names.split()), prefixes, 1.0, {}, dimension)


def _unit(
    names: str, prefixes: str, size: float, powers: Mapping[str, float] | None = None
) -> UnitDefinition:
    return UnitDefinition(tuple(names.split()), prefixes, size, powers or {})


UNITS = {
    unit.names[0]: unit
    for unit in (
        _base("m meter metre", "nµmck", "length"),
        _base("s sec second", "nµm", "time"),
        _base("rad radian", "nµm", "angle"),
        _base("K kelvin", "µm", "temperature"),
        _base("V volt", "nµmk", "voltage"),
        _base("A ampere", "nµm", "current"),
        _base("T tesla", "nµm", "flux_density"),
        _base("LSB count", "", "count"),
        _base("sample", "", "sample"),
        _unit("min minute", "", 60.0, {"s": 1}),
        _unit("h hr hour", "", 3600.0, {"s": 1}),
        _unit("d day", "", 86400.0, {"s": 1}),
        _unit("Hz hertz", "µmkM", 1.0, {"s": -1}),
        _unit("deg ° degree", "m", math.pi / 180, {"rad": 1}),
        _unit("arcmin ′", "", math.pi / 10800, {"rad": 1}),
        _unit("arcsec ″", "µm", math.pi / 648000, {"rad": 1}),
        _unit("rev r turn", "", 2 * math.pi, {"rad": 1}),
        _unit("rpm", "", 1.0, {"rev": 1, "min": -1}),
        _unit("dps", "m", 1.0, {"deg": 1, "s": -1}),
        _unit("g", "nµm", 9.80665, {"m": 1, "s": -2}),  # CGPM 1901, exact
        _unit("Gal", "µm", 0.01, {"m": 1, "s": -2}),
        _unit("gauss G", "nµm", 1e-4, {"T": 1}),
        _unit("degC °C celsius", "", 1.0, {"K": 1}),
        _unit("degF °F fahrenheit", "", 5 / 9, {"K": 1}),
        _unit("ppm", "", 1e-6),
        _unit("percent %", "", 0.01),
    )
}
PREFIXES = {"n": 1e-9, "µ": 1e-6, "m": 1e-3, "c": 0.01, "k": 1e3, "M": 1e6}
_SPELLINGS = {"": "", **dict(zip(PREFIXES, PREFIXES, strict=True)), "u": "µ"}  # spelling to prefix


_CANONICAL = {name: unit for unit, definition in UNITS.items() for name in definition.names}


def canonical_name(name: str) -> str | None:
    """Return the canonical prefix and name, "µg" for "ug", or None for an unknown unit.

    A plural "s" may follow a name with two or more letters.
    """
    stems = [name]
    if name.endswith("s"):
        stems.append(name[:-1])
    for stem in stems:
        for spelling, prefix in _SPELLINGS.items():
            unit = stem[len(spelling) :] if stem.startswith(spelling) else ""
            if stem is not name and len(unit) == 1:
                continue
            found = _CANONICAL.get(unit)
            if found is not None and (not prefix or prefix in UNITS[found].prefixes):
                return prefix + found
    return None


def size_and_dimension(powers: Mapping[str, float]) -> tuple[float, dict[str, float]]:
    """Return the SI size and dimension of a product of powers of units.

    Units are given by canonical name. A size outside the floating-point range becomes infinite or
    zero.
    """
    factors: dict[float, float] = {}
    dimension: dict[str, float] = {}
    _expand(powers, 1.0, factors, dimension)
    size = 1.0
    try:
        for factor, power in factors.items():
            size *= factor**power
    except OverflowError:
        size = math.inf
    return size, {name: power for name, power in dimension.items() if power}


def _expand(
    powers: Mapping[str, float],
    power: float,
    factors: dict[float, float],
    dimension: dict[str, float],
) -> None:
    """Add up the powers of sizes and dimensions, so equal sizes above and below cancel."""
    for name, own in powers.items():
        total = power * own
        if name in UNITS:
            unit = UNITS[name]
        else:
            unit = UnitDefinition((), "", PREFIXES[name[0]], {name[1:]: 1})
        if unit.dimension:
            dimension[unit.dimension] = dimension.get(unit.dimension, 0.0) + total
        else:
            factors[unit.size] = factors.get(unit.size, 0.0) + total
            _expand(unit.powers, total, factors, dimension)


_KINDS = {
    "1": "a ratio",
    "m": "a length",
    "s": "a time",
    "rad": "an angle",
    "Hz": "a frequency",
    "m/s": "a speed",
    "m/s²": "an acceleration",
    "rad/s": "an angular rate",
    "rad/s²": "an angular acceleration",
    "m/s²/√Hz": "an acceleration noise density",
    "rad/√s": "an angle random walk",
    "K": "a temperature",
    "V": "a voltage",
    "A": "a current",
    "T": "a magnetic flux density",
    "LSB": "a count",
    "sample": "a number of samples",
    **{f"{unit}/(m/s²)": "an accelerometer's scale factor" for unit in ("LSB", "V", "A", "Hz")},
    **{f"{unit}/(rad/s)": "a gyro's scale factor" for unit in ("LSB", "V", "A", "Hz")},
    **{f"{unit}/T": "a magnetometer's scale factor" for unit in ("LSB", "V", "A", "Hz")},
}
ZERO_CELSIUS = 273.15  # K, exact (SI brochure, 9th edition, 2.3.1)
_ZEROS = {"degC": ZERO_CELSIUS, "degF": ZERO_CELSIUS - 32 * 5 / 9}  # K

# Characters that look alike or are not on keyboards; µ and μ are different characters in Unicode.
_LOOK_ALIKE = str.maketrans("μ−–º˚⋅×\u00a0\u2009\u202f\t", "µ--°°··    ")
_SUPERSCRIPT = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")
_LONGEST = 100  # characters; longer text is rejected without spending time on it
_TOKEN = re.compile(
    r" *(?:(?P<name>[A-Za-zµ]*(?:°[CF]|[°′″%])|[A-Za-zµ]+)"
    r"|(?:\^|\*\*) *(?:(?P<power>-?[0-9](?:\.5)?)|\( *(?P<halves>-?[1-9]) */ *2 *\))"
    r"|(?<=[A-Za-zµ])(?P<digit>[2-9]|-[1-9])(?![0-9.])"
    r"|(?P<symbol>[√1·*/()])) *"
)
_NOT_A_UNIT = "is not a unit; units look like 'm/s²', 'µg/g²' or '°/√h'"


class NotationError(Exception):
    """An error in a text; its message is a phrase that follows the quoted text."""


class Unit(NamedTuple):
    """The SI size and dimension of a unit."""

    size: float  # in SI
    dimension: frozenset[tuple[str, float]]  # such as {("length", 1), ("time", -2)}
    offset: float  # SI value of "0 unit"


def si_factor(unit: str, like: str | None = None) -> float:
    """Return the SI size of one `unit` (cached).

    Parameters
    ----------
    unit : str
        Unit, such as "µg/g²".
    like : str, optional
        A unit with the expected dimension.

    Raises
    ------
    InputError
        The text is not a unit, its dimension differs from the dimension of `like`, or it is "°C"
        or "°F", which have an offset (see `to_si`).

    Examples
    --------
    >>> si_factor("mg", like="m/s²")
    0.00980665
    >>> si_factor("mm", like="rad")
    Traceback (most recent call last):
    ...
    inercal.basics.errors.InputError: 'mm' is a length; expected an angle, such as 'rad'
    """
    with error_context(unit):
        read = require_dimension(unit, like)
        if read.offset:
            raise NotationError(f"has its zero at {read.offset:g} K, not at 0 K; use 'K'")
    return read.size


def to_si(values: "Array", unit: str, like: str) -> "Array":
    """Convert values of any shape from a unit to SI, "°C" and "°F" with their offsets to K.

    Raises
    ------
    InputError
        The text is not a unit, or its dimension differs from the dimension of `like`.
    """
    with error_context(unit):
        read = require_dimension(unit, like)
    return values * read.size + read.offset


@contextmanager
def error_context(text: object) -> Generator[None]:
    """Convert a `NotationError` in the block to an `InputError`; its message starts with `text`."""
    try:
        yield
    except NotationError as what:
        names = (text,) if isinstance(text, str) else ()
        raise InputError(f"{_quote(text)} {what}", names=names) from None


def _quote(text: object) -> str:
    """Return `text` in quotation marks, on one line and with at most 60 characters."""
    # repr() fails for integers beyond sys.get_int_max_str_digits().
    shown = "a huge integer" if isinstance(text, int) and abs(text) > 1e300 else repr(text)
    return shown if len(shown) <= 60 else f"{shown[:56]}…{shown[-1]}"


def plain_text(text: str) -> str:
    """Return `text` with look-alikes and superscripts replaced by plain characters."""
    if len(text) > _LONGEST:
        raise NotationError(f"is longer than {_LONGEST} characters; shorten it")
    text = text.translate(_LOOK_ALIKE).replace("℃", "°C").replace("℉", "°F")
    return re.sub("[⁰¹²³⁴-⁹⁻]+", lambda m: "^" + m[0].translate(_SUPERSCRIPT), text).strip()


def require_dimension(unit: str, like: str | None) -> Unit:
    """Read a unit; raise an error if it does not have the dimension of `like`."""
    read = read_unit(unit)
    if like is not None and read.dimension != read_unit(like).dimension:
        raise NotationError(f"is {_dimension_name(read)}; expected {dimension_text(like, like)}")
    return read


def dimension_text(like: str, example: str) -> str:
    """Return the name of the dimension of `like`, such as "an angle", with an example."""
    return f"{_dimension_name(read_unit(like))}, such as {example!r}"


def _dimension_name(unit: Unit) -> str:
    for known, kind in _KINDS.items():
        if read_unit(known).dimension == unit.dimension:
            return kind
    powers = [n if p == 1 else f"{n}^{p:g}" for n, p in sorted(unit.dimension)]
    return f"a quantity in {'·'.join(powers)}"


@lru_cache(maxsize=1024)
def read_unit(unit: str) -> Unit:
    """Return the SI size and dimension of a unit; raise an error if the text is not a unit."""
    with error_context(unit):
        powers = _powers(plain_text(unit))
        size, dimension = size_and_dimension(powers)
        if not 0 < size < math.inf:
            raise NotationError(_NOT_A_UNIT)
    zero = _ZEROS.get(next(iter(powers), ""), 0.0) if list(powers.values()) == [1] else 0.0
    return Unit(size, frozenset(dimension.items()), zero)


def _powers(plain: str) -> dict[str, float]:
    """Return the power of each unit by name, parsed with the grammar of the module docstring."""
    tokens, end = deque[str | float](), 0  # a float is a power
    while end < len(plain):
        if not (found := _TOKEN.match(plain, end)):
            raise NotationError(_NOT_A_UNIT)
        if halves := found["halves"]:
            tokens.append(float(halves) / 2)
        elif power := found["power"] or found["digit"]:
            tokens.append(float(power))
        else:
            tokens.append(found["name"] or found["symbol"])
        end = found.end()
    powers = _parse_product(tokens)
    if tokens or any(abs(power) > 9 for power in powers.values()):
        raise NotationError(_NOT_A_UNIT)
    return {name: power for name, power in powers.items() if power}


def _parse_product(tokens: deque[str | float]) -> dict[str, float]:
    total = _parse_factor(tokens)
    while tokens and tokens[0] != ")":
        sign = -1.0 if tokens[0] == "/" else 1.0
        if tokens[0] in ("·", "*", "/"):
            tokens.popleft()
        for name, power in _parse_factor(tokens).items():
            total[name] = total.get(name, 0.0) + sign * power
    return total


def _parse_factor(tokens: deque[str | float]) -> dict[str, float]:
    token = tokens.popleft() if tokens else ""
    if token in ("√", "sqrt"):
        return {name: power / 2 for name, power in _parse_factor(tokens).items()}
    if token == "(":
        powers = _parse_product(tokens)
        if not tokens or tokens.popleft() != ")":
            raise NotationError(_NOT_A_UNIT)
    elif token == "1":
        powers = {}
    elif isinstance(token, str) and token[:1] not in ("", "·", "*", "/", ")"):
        powers = {_canonical_unit(token): 1.0}
    else:
        raise NotationError(_NOT_A_UNIT)
    if tokens and isinstance(exponent := tokens[0], float):
        tokens.popleft()
        powers = {name: power * exponent for name, power in powers.items()}
    return powers


def _canonical_unit(name: str) -> str:
    """Return the canonical name of a unit, or raise an error that suggests similar names.

    A prefix is allowed, and a plural "s" after names with two or more letters.
    """
    if (found := canonical_name(name)) is not None:
        return found
    known = [name for unit in UNITS.values() for name in unit.names]
    known += [prefix + unit for unit, one in UNITS.items() for prefix in one.prefixes]
    near = [n for n in known if n.lower() == name.lower()] or get_close_matches(name, known)
    advice = f"did you mean {' or '.join(map(repr, near))}?"
    if not near:
        advice = f"known are {', '.join(UNITS)}"
    raise InputError(f"unknown unit {_quote(name)}; {advice}", names=(name,))
