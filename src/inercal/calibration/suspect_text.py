"""The suspect of a verdict in plain words: what explains the residuals best, its size, a remedy."""

from collections.abc import Mapping

import numpy as np

from inercal.basics.parameters import Parameter
from inercal.basics.run_file_advice import Advice
from inercal.basics.units import format_quantity, format_value_and_uncertainty
from inercal.calibration.advising import CHANGE_PREFIX, changes_text
from inercal.calibration.best_cause import SuspectedCause
from inercal.calibration.detectability import coefficient_definition
from inercal.estimation.scores import CandidateKind
from inercal.physics.sensors import Sensor

_MIN_PROBABILITY = 1e-99  # smallest printed probability
_DISPLAY_UNITS = {"rad": "″", "m/s²": "µg", "rad/s": "°/h", "m": "mm", "s": "ms", "1": "ppm"}
_PERCENT_THRESHOLD = 0.01  # above, a ratio is shown in %
_MAX_LISTED = 6  # candidates that a line lists
_PRIOR_PREFIX = "prior of "  # and the coefficient


def p_value_text(p: float) -> str:
    """Return a small probability as text to follow a "p": "= 0.003", "< 1e-99"."""
    return f"= {p:.1g}" if p > _MIN_PROBABILITY else f"< {_MIN_PROBABILITY:.0e}"


def suspect_lines(
    one: SuspectedCause,
    sensor: Sensor,
    expected: Mapping[str, Parameter],
    given: Advice,
) -> list[str]:
    """Return lines on the candidate that explains the residuals best: its size and a remedy."""
    fall = f"χ² would fall by {one.chi2:.1f} to {one.remaining_chi2:.1f}"
    shift = (
        f"it shifts {one.shifted_coefficient} by {one.shift:.2g} U"
        if one.shift > 0
        else "it shifts nothing"
    )
    if one.kind == "coefficient":
        lines = _coefficient_suspect_text(one, sensor)
    elif one.kind == "bench":
        lines = _bench_suspect_text(one, sensor, expected)
    elif one.kind == "row":
        lines = f"suspect: the readings of {one.name}"
    else:
        parts = ", ".join(
            _format_quantity(size, sd, unit)
            for size, sd, unit in zip(one.sizes, one.sds, one.units, strict=True)
        )
        within = one.name.startswith(CHANGE_PREFIX)
        how = "from its first half to its second" if within else "from the first row to the last"
        lines = f"suspect: {one.name}, {parts}" + (f" {how}" if not one.changes else "")
    text = (
        f"{lines}; {fall} (p {p_value_text(one.adjusted)} among all candidates), and {shift}; "
        f"{advice_text(one.kind, given)}"
    )
    result = [text]
    if one.indistinguishable:
        listed = ", ".join(one.indistinguishable[:_MAX_LISTED])
        more = len(one.indistinguishable) - _MAX_LISTED
        listed += f" and {more} more" if more > 0 else ""
        result.append(f"these data cannot distinguish {one.name} from: {listed}")
    return result


def advice_text(kind: CandidateKind, given: Advice) -> str:
    """Return advice on a cause in words."""
    if not given.changes:
        return given.action
    verb = "measure it again, or state" if kind == "bench" else "estimate it:"
    return f"{verb} {changes_text(given.changes)}"


def best_cause_lines(one: SuspectedCause) -> list[str]:
    """Return lines on the best of the causes tested, where it does not explain the residuals."""
    return [
        "no single cause explains the residuals: something changes that the model does not "
        "contain, several things are wrong, or the noise is larger than stated",
        f"the best of the causes tested is {one.name}: χ² would drop by {one.chi2:.1f}, but "
        f"{one.remaining_chi2:.1f} with {one.remaining_dof} degrees of freedom would remain "
        f"unexplained, p {p_value_text(one.remaining_p_value)}",
    ]


def _bench_suspect_text(
    one: SuspectedCause, sensor: Sensor, expected: Mapping[str, Parameter]
) -> str:
    """Return the text on a suspected statement of the run file."""
    # The most significant component of a vector, such as the angles of a mounting.
    k = int(np.argmax(np.nan_to_num(np.abs(one.sizes) / np.asarray(one.sds))))
    name, size, sd = one.components[k], one.sizes[k], one.sds[k]
    if name.startswith(_PRIOR_PREFIX):
        full = name.removeprefix(_PRIOR_PREFIX)
        departure = format_component(sensor, "coefficient", full, size, sd, one.units[k])
        return f"suspect: the {name}; the data depart from it by {departure}"
    stated, of_rows = expected.get(name), ""
    if stated is None:  # a common error of all rows, in place of an error of each row
        rows = [one for full, one in expected.items() if full.startswith(f"{name}[")]
        stated, of_rows = rows[0] if rows else None, f", equal in all {len(rows)} rows"
        of_rows = of_rows if rows else ""
    meaning = "" if stated is None or not stated.meaning else f" ({stated.meaning})"
    known = "as exact" if stated is None or not stated.sd else ""
    known = known or f"± {_format_quantity(stated.sd if stated else 0.0, 0.0, one.units[k])}"
    return (
        f"suspect: bench parameter {name}{meaning}{of_rows}; it departs by "
        f"{_format_quantity(size, sd, one.units[k])} from its stated value, which is stated "
        f"{known}"
    )


def _coefficient_suspect_text(one: SuspectedCause, sensor: Sensor) -> str:
    """Return the suspected coefficients with their sizes, in the units of reports."""
    lines = {
        line.name: line
        for line in (coefficient_definition(sensor, name) for name in one.components)
    }
    first = next(iter(lines.values()))
    meaning = first.meaning if len(lines) == 1 else ", ".join(lines)
    parts = [
        f"{name} {format_component(sensor, one.kind, name, size, sd, unit)}"
        for name, size, sd, unit in zip(one.components, one.sizes, one.sds, one.units, strict=True)
        if np.isfinite(size)
    ]
    sizes = f", about {', '.join(parts)} (k = 1)" if parts else ""
    return f"suspect: {one.name} ({meaning}), which is not estimated{sizes}"


def format_component(
    sensor: Sensor, kind: CandidateKind, name: str, size: float, sd: float, unit: str
) -> str:
    """Return the size of a candidate's component with its deviation, in the units of reports.

    Parameters
    ----------
    sensor : Sensor
    kind, name : str
        CandidateKind of the candidate, and name of the component.
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
    """Return a quantity in the usual unit of its size."""
    if not np.isfinite(value):
        return "an unknown amount"
    unit = _DISPLAY_UNITS.get(unit, unit)
    if unit == "ppm" and abs(value) > _PERCENT_THRESHOLD:
        unit = "%"
    if unit.startswith("("):
        return f"{value:.2g} {unit}" if sd == 0 else f"{value:.2g} ± {sd:.2g} {unit}"
    return format_quantity(value, sd, unit)
