"""Describe the most likely cause of large residuals, and its size, in plain words."""

from collections.abc import Mapping, Sequence

import numpy as np

from inercal.basics.keys import PRIOR_OF, ErrorName
from inercal.basics.parameters import Parameter
from inercal.basics.units import (
    format_count,
    format_quantity,
    format_value_and_uncertainty,
    si_factor,
)
from inercal.calibration.best_cause import CHANGE_PREFIX, SuspectedCause
from inercal.calibration.detectability import coefficient_definition
from inercal.calibration.explanation import first_fit
from inercal.calibration.grade import Assessment, row_words, two_digits
from inercal.estimation.scores import (
    HYSTERESIS,
    SIGNIFICANCE_LEVEL,
    CandidateKind,
    ScoreTestSet,
)
from inercal.physics.sensors import Sensor
from inercal.physics.sensors.coefficient_selection import coefficient_words

_MIN_PROBABILITY = 1e-99  # smallest printed probability
_DISPLAY_UNITS = {
    "rad": "″",
    "m/s²": "µg",
    "rad/s": "°/h",
    "m": "mm",
    "s": "ms",
    "1": "ppm",
    "T": "µT",
    "(m/s²)⁻¹": "ppm/g",
}
_PERCENT_THRESHOLD = 0.01  # a larger ratio is shown in %
_MAX_LISTED = 6  # largest number of candidates in a line
_LEAST_SHARE = 0.1  # smallest share of χ² that a partial cause must explain
_SMALL_CHI2 = 100.0  # below this, a decimal is shown
_LASTING = ("step ", HYSTERESIS)  # changes over time that are not linear
_SWITCH_UNITS = ("",)  # of a cause that is true or not, without a size


def p_value_text(p: float) -> str:
    """Return a small probability as text after "p", such as "= 0.003" or "< 1e-99"."""
    return f"= {p:.1g}" if p > _MIN_PROBABILITY else f"< {_MIN_PROBABILITY:.0e}"


def degrees_of_freedom(count: int) -> str:
    """Return a number of degrees of freedom in words: "1 degree of freedom"."""
    return format_count(count, "degree of freedom", "degrees of freedom")


def chi2_text(chi2: float) -> str:
    """Return χ² as text with the relevant digits: "27.8", "567", "4 884"."""
    return f"{chi2:.1f}" if chi2 < _SMALL_CHI2 else f"{chi2:,.0f}".replace(",", " ")


def cause_words(
    name: str,
    kind: CandidateKind,
    components: Sequence[str],
    sensor: Sensor,
    expected: Mapping[str, Parameter],
) -> str:
    """Describe a candidate, with its run-file key in brackets if there is one."""
    if kind == "coefficient":
        return coefficient_words(sensor, name, components)
    if kind == "bench" and name.startswith(PRIOR_OF):
        full, *own = (one.removeprefix(PRIOR_OF) for one in (name, *components))
        return f"the prior of the {coefficient_words(sensor, full, own)}"
    if kind == "bench":
        return bench_words(name, components, expected)
    if name == "warm_up":
        return "a warm-up of the sensor"
    return row_words(name) if kind == "row" else name


def bench_words(name: str, components: Sequence[str], expected: Mapping[str, Parameter]) -> str:
    """Describe bench parameters, such as "radius of the arm (radius)"."""
    meanings = dict.fromkeys(
        one.meaning
        for full, one in expected.items()
        if full in components or ErrorName(full).name in components
    )
    meaning = next(iter(meanings), "")
    if meaning == name:
        return f"{name} of the bench"
    return f"{meaning} ({name})" if meaning else name if " " in name else f"bench parameter {name}"


def size_words(one: SuspectedCause, sensor: Sensor) -> str:
    """Return the size of a cause (its largest component) as text; empty if unknown."""
    sizes = np.abs(one.sizes)
    if one.kind == "row" or one.units == _SWITCH_UNITS or not np.isfinite(sizes).any():
        return ""
    k = int(np.nanargmax(sizes))
    full = one.components[k].removeprefix(PRIOR_OF)
    kind = "coefficient" if one.components[k].startswith(PRIOR_OF) else one.kind
    size = format_component(sensor, kind, full, one.sizes[k], one.sds[k], one.units[k])
    return size if len(sizes) == 1 else f"up to {_without_deviation(size)}"


def _without_deviation(size: str) -> str:
    value, _, deviation = size.removeprefix("-").partition(" ± ")
    return f"{value} {deviation.partition(' ')[2]}" if deviation else value


def cause_line(assessment: Assessment, sensor: Sensor, expected: Mapping[str, Parameter]) -> str:
    """Return a short line with the most likely cause and its size; empty if there is none.

    A cause that explains only a small part of large residuals is not stated.
    """
    one = assessment.best
    if one is None:
        return ""
    words = cause_words(one.place, one.kind, one.components, sensor, expected)
    off = "off by " * (one.kind == "bench")
    size = f", {off}{text}" if (text := size_words(one, sensor)) else ""
    if assessment.suspect is not None:
        brief = words if one.kind in ("row", "time") else f"{one.name}{size}"
        return first_fit(*(f"Most likely cause: {text}." for text in (words + size, words, brief)))
    if one.chi2 < _LEAST_SHARE * (one.chi2 + one.remaining_chi2):
        return ""
    drop = f"; χ² {_chi2_drop(one)}"
    return first_fit(*(f"Partial cause: {words}{text}." for text in (size + drop, drop, size, "")))


def alternatives(
    one: SuspectedCause, scores: ScoreTestSet, sensor: Sensor, expected: Mapping[str, Parameter]
) -> list[str]:
    """Describe the causes that explain the residuals as well as the best cause does."""
    # "g" names local gravity and the sensitivity to g: the one that explains as much is meant.
    apart = sorted(scores.scores, key=lambda score: -abs(score.chi2 - one.chi2))
    found = {score.name: score for score in apart}
    return [
        cause_words(name, found[name].kind, found[name].components, sensor, expected)
        for name in one.indistinguishable
        if name not in one.other_rows
        # A step of the magnetic field at a neighbouring time is the same cause.
        and not (one.units[0] == "T" and name.partition(" at ")[0] == one.name.partition(" at ")[0])
    ]


def suspect_lines(
    one: SuspectedCause, scores: ScoreTestSet, sensor: Sensor, expected: Mapping[str, Parameter]
) -> list[str]:
    """Return lines about the candidate that explains the residuals best, and about its size."""
    words = cause_words(one.place, one.kind, one.components, sensor, expected)
    first = f"{words[0].upper()}{words[1:]}"
    how = ""
    if one.kind == "time" and not one.changes and not one.name.startswith(_LASTING):
        within = one.name.startswith(CHANGE_PREFIX)
        how = " from its first half to its second" if within else " from the first row to the last"
    alone = len(one.components) == 1
    parts = [
        ("" if alone else f"{name.removeprefix(f'{one.name}, ')} ")
        + f"{format_component(sensor, one.kind, name, size, sd, unit)}{how}"
        for name, size, sd, unit in zip(one.components, one.sizes, one.sds, one.units, strict=True)
        if np.isfinite(size) and unit and one.kind != "row" and not name.startswith(PRIOR_OF)
    ]
    lines = [
        f"{first} would explain the residuals (p {p_value_text(one.adjusted)}, corrected for the "
        "number of causes tested)."
    ]
    if one.kind == "bench" and one.units != _SWITCH_UNITS:
        lines.append(_stated_text(one, expected))
    if one.name.startswith(PRIOR_OF):
        lines.append(f"The data depart from it by {size_words(one, sensor)}.")
    if parts:
        lines.append(f"Its size would be {'; '.join(parts)} (k = 1).")
    lines.append(f"χ² would drop {_chi2_drop(one)}.")
    if one.remaining_p_value < SIGNIFICANCE_LEVEL:
        lines.append(
            f"The rest is larger than the noise (p {p_value_text(one.remaining_p_value)}). It may "
            "be due to the inaccuracy with which so large an effect is estimated, but there may "
            "also be another cause."
        )
    if one.shift > 0:
        shifted = coefficient_words(sensor, one.shifted_coefficient)
        lines.append(f"Leaving it out shifts the {shifted} by {two_digits(one.shift)} U.")
    else:
        lines.append("Leaving it out shifts no coefficient.")
    return lines + _alternatives_lines(one, scores, sensor, expected)


def _alternatives_lines(
    one: SuspectedCause, scores: ScoreTestSet, sensor: Sensor, expected: Mapping[str, Parameter]
) -> list[str]:
    alike = alternatives(one, scores, sensor, expected)
    more = f" and {len(alike) - _MAX_LISTED} more" if len(alike) > _MAX_LISTED else ""
    listed = "; ".join(alike[:_MAX_LISTED])
    return [f"The data cannot distinguish it from {listed}{more}."] if alike else []


def best_cause_lines(
    one: SuspectedCause, scores: ScoreTestSet, sensor: Sensor, expected: Mapping[str, Parameter]
) -> list[str]:
    """Return lines about the best tested cause if it does not explain the residuals."""
    words = cause_words(one.place, one.kind, one.components, sensor, expected)
    return [
        "No single cause explains the residuals: either something changed that the model does not "
        "include, or several things are wrong, or the noise is larger than stated.",
        f"The best of the tested causes is {words}: χ² would drop {_chi2_drop(one)} with "
        f"{degrees_of_freedom(one.remaining_dof)}, which is still too large "
        f"(p {p_value_text(one.remaining_p_value)}).",
        *_alternatives_lines(one, scores, sensor, expected),
    ]


def _chi2_drop(one: SuspectedCause) -> str:
    """Return χ² without and with the cause as text, such as "from 4 884 to 567"."""
    before = one.chi2 + one.remaining_chi2
    return f"from {chi2_text(before)} to {chi2_text(one.remaining_chi2)}"


def _stated_text(one: SuspectedCause, expected: Mapping[str, Parameter]) -> str:
    """Describe how the suspected parameter was stated."""
    stated, of_rows = expected.get(one.components[0]), ""
    if stated is None:  # a common error of all rows, which replaces an error of each row
        rows = [q for full, q in expected.items() if full.startswith(f"{one.components[0]}[")]
        if rows:
            stated, of_rows = rows[0], f"; it would be equal in all {len(rows)} rows"
    if stated is None or not stated.sd:
        return f"It is stated as exact{of_rows}."
    return f"It is stated as ± {_format_quantity(stated.sd, 0.0, one.units[0])}{of_rows}."


def format_component(
    sensor: Sensor, kind: CandidateKind, name: str, size: float, sd: float, unit: str
) -> str:
    """Return the size and standard deviation of a candidate's component, in report units.

    Parameters
    ----------
    sensor : Sensor
    kind, name : str
        Kind of the candidate, and name of the component.
    size, sd : float
        SI.
    unit : str
        SI.
    """
    if kind != "coefficient" or not np.isfinite(size):
        return _format_quantity(size, sd, unit)
    line = coefficient_definition(sensor, name)
    value, spread = format_value_and_uncertainty(size / line.si, sd / line.si)
    return f"{value} ± {spread} {line.unit}"


def _format_quantity(value: float, sd: float, unit: str) -> str:
    """Return a quantity as text, in a unit that suits its size."""
    if not np.isfinite(value):
        return "an unknown amount"
    unit = _DISPLAY_UNITS.get(unit, unit) or "1"  # the sense of a rotation has no unit
    if unit == "ppm" and abs(value) > _PERCENT_THRESHOLD:
        unit = "%"
    if sd == 0:
        return f"{'-' * (value < 0)}{two_digits(abs(value) / si_factor(unit))} {unit}"
    return format_quantity(value, sd, unit)
