"""Reader for [specification] in a run file: converts the limits from text to SI units."""

import re
from collections.abc import Mapping
from math import inf, isfinite
from pathlib import Path
from typing import TYPE_CHECKING

from inercal.basics.errors import InputError, error_location
from inercal.basics.keys import CoefficientName
from inercal.basics.units import Measured, parse_quantity
from inercal.physics.section_settings import key_error
from inercal.physics.sensors import Sensor
from inercal.physics.sensors.coefficient_selection import select_coefficients
from inercal.runfile.schema import SpecificationSection

if TYPE_CHECKING:
    from inercal.calibration.specification import NextUseScatter, Specification

_KEY = "[specification.limits]"
_SIGNS = re.compile(r"\s*(±|\+ ?/? ?-)")
_NEGATIVE = re.compile(_SIGNS.pattern + r"\s*[-−]")
_COVERAGE = re.compile(r"k *=")
_Limits = tuple[float, float]


def stated_specification(
    section: SpecificationSection | None, sensor: Sensor, frame: str, folder: Path
) -> "Specification | None":
    """Return the specification stated in a run file, or None if the section is missing.

    If several keys name a coefficient, the most specific one is used: "ax.k0" before "ax.bias"
    before "k0" before "bias". Limits for a group apply to the coefficients with a suitable unit, so
    `bias = "± 20 mg"` applies only to accelerometers.

    Parameters
    ----------
    section : SpecificationSection or None
    sensor : Sensor
        The sensor with the coefficients to estimate.
    frame : str
        Body frame of the result.
    folder : Path
        Folder of the run file.

    Raises
    ------
    InputError
        A key names no estimated coefficient, a text is not a limit, or a rule is not possible.
    """
    if section is None:
        return None
    # Imported here because it loads SciPy, which a run file without limits does not need.
    from inercal.calibration.specification import Specification
    from inercal.estimation.uncertainty.conformity import NO_GUARD_BAND, DecisionRule

    if not section.limits:
        raise key_error(_KEY, 'the section is empty; state a limit, such as bias = "± 20 mg"')
    if section.rule == "simple" and "factor" in section.model_fields_set:
        raise key_error("[specification] factor", NO_GUARD_BAND)
    try:
        rule = DecisionRule(section.rule, section.factor)
    except InputError as error:
        raise key_error("[specification] factor", str(error).removeprefix("factor ")) from None
    owners = _owners(section.limits, sensor)
    limits = {name: owners[name][1] for name in sensor.coefficients if name in owners}
    return Specification(
        limits, rule, _stated_next_use(section, (frame, sensor.form), tuple(limits), folder)
    )


def _stated_next_use(
    section: SpecificationSection, terms: tuple[str, str], names: tuple[str, ...], folder: Path
) -> "NextUseScatter | None":
    """Return the scatter between uses from the repeatability file, if the run file names one."""
    from inercal.calibration.specification import load_next_use

    file, key = section.repeatability, "[specification] repeatability"
    if section.uncertainty == "session":
        if file is not None:
            raise key_error(key, "only uncertainty = 'next_use' uses this file; state that, or "
                                 "remove repeatability")  # fmt: skip
        return None
    if file is None:
        raise key_error(key, "uncertainty 'next_use' needs a file written by inercal repeat")
    with error_location(key, key=key):
        found = load_next_use(folder / file)
        if (found.frame, found.form) != terms:
            raise InputError(
                f"{file}: its frame is {found.frame} and its form {found.form}, but this run "
                f"uses {terms[0]} and {terms[1]}; repeat such sessions"
            )
        found.of(names)
    return found


def _owners(
    stated: Mapping[str, str | tuple[str, str]], sensor: Sensor
) -> dict[str, tuple[str, _Limits]]:
    """Return the limits for each coefficient, and the key that states them."""
    owners: dict[str, tuple[str, _Limits]] = {}
    for word, text in stated.items():
        for name, limits in _limits_of_word(word, text, sensor).items():
            other = owners.get(name)
            if other is None or _rank(word, name) > _rank(other[0], name):
                owners[name] = word, limits
            elif _rank(word, name) == _rank(other[0], name):
                text = f"{other[0]} also limits {name}; keep only one of them"
                raise key_error(f"{_KEY} {word}", text, None, (name,))
    used = {word for word, _ in owners.values()}
    for word in stated:
        if word not in used:
            raise key_error(
                f"{_KEY} {word}", "keys for single coefficients override it everywhere; remove it"
            )
    return owners


def _rank(word: str, name: str) -> tuple[bool, bool]:
    axis, term = CoefficientName(word).parts
    return bool(axis), term == CoefficientName(name).term


def _limits_of_word(word: str, text: str | tuple[str, str], sensor: Sensor) -> dict[str, _Limits]:
    """Return the limits for all coefficients that a key names and that have a suitable unit."""
    key = f"{_KEY} {word}"
    with error_location(key, key=key):
        named = select_coefficients(sensor.axes, [word])
    names = [name for name in named if name in sensor.coefficients]
    if not names:
        text = f"the method does not estimate it; it estimates {', '.join(sensor.coefficients)}"
        raise key_error(key, text, names=(word,))
    found: dict[str, _Limits] = {}
    errors: list[InputError] = []
    for name in names:
        try:
            found[name] = _parse_limits(text, sensor.coefficient(name).unit)
        except InputError as error:
            errors.append(error)
    if not found:
        raise errors[0].located(key, key=key)
    return found


def _parse_limits(text: str | tuple[str, str], unit: str) -> _Limits:
    """Return the lower and the upper limit in SI units.

    Raises
    ------
    InputError
        The unit or the notation is wrong, or the lower limit is not below the upper one.
    """
    if not isinstance(text, str):
        lower, upper = (_exact(one, unit) for one in text)
    elif text.lstrip().startswith("≤"):
        lower, upper = -inf, _exact(text.lstrip()[1:], unit)
    elif text.lstrip().startswith("≥"):
        lower, upper = _exact(text.lstrip()[1:], unit), inf
    else:
        if _COVERAGE.search(text):
            raise InputError(f"{text!r}: a limit does not need k; remove it")
        if _NEGATIVE.match(text):
            raise InputError(f"{text!r}: a limit after ± must be positive; remove the sign")
        signs = _SIGNS.match(text)
        around = Measured(0.0, _exact(text[signs.end() :], unit)) if signs else None
        middle = around or parse_quantity(text, unit)
        if not middle.sd:
            raise InputError(
                f'{text!r} is not a limit; write "± …", "≤ …", "≥ …" or ["lower", "upper"]'
            )
        lower, upper = middle.value - middle.sd, middle.value + middle.sd
    if not lower < upper or not (isfinite(lower) or isfinite(upper)):
        stated = repr(text) if isinstance(text, str) else " to ".join(text)
        raise InputError(f"{stated}: the lower limit must be below the upper one")
    return lower, upper


def _exact(text: str, unit: str) -> float:
    value = parse_quantity(text.strip(), unit)
    if value.sd:
        raise InputError(f"{text!r}: a limit cannot have an uncertainty; remove it")
    return value.value
