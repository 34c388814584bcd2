"""Define the units: prefixes, SI sizes and dimensions.

A unit is a size times a product of powers of other units. To find the size and dimension of a
product of units, each unit is expanded into base units, one for each dimension, in the written
order::

    size = Π size_i^power_i,   dimension = Σ power_i dimension_i
"""

import math
from collections.abc import Mapping
from typing import NamedTuple


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
