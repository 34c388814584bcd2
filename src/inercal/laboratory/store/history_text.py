"""Describe histories in words and rounded numbers."""

from inercal.basics.units import format_value_and_uncertainty
from inercal.calibration.comparison import comparison_text
from inercal.calibration.comparison.courses import LEAST_FOR_DRIFT, Course
from inercal.calibration.suspect_text import p_value_text
from inercal.estimation.uncertainty.coverage import COVERAGE
from inercal.laboratory.store.history import CoefficientTrend, SensorHistory
from inercal.laboratory.store.run_scatter import newest_run_to_run

_COURSES: dict[Course, str] = {"line": "a straight line", "walk": "a random walk"}


def format_point(trend: CoefficientTrend, k: int) -> tuple[str, str]:
    """Return the value and U of one point of a trend, in the unit of the trend."""
    value, std = float(trend.values[k]), float(trend.std[k])
    return format_value_and_uncertainty(value / trend.si, COVERAGE * std / trend.si)


def format_slope(trend: CoefficientTrend) -> tuple[str, str]:
    """Return the drift per year and its U, in the trend's unit; empty if there is no line."""
    if trend.line is None:
        return "", ""
    slope = trend.line.slope
    return format_value_and_uncertainty(slope.slope / trend.si, slope.expanded / trend.si)


def format_bands(trend: CoefficientTrend) -> tuple[str, str]:
    """Return U of the mean and of the next use, at the newest calibration; empty if unknown."""
    if trend.course is None:
        return "", ""
    at = trend.time[-1:]
    mean, next_use = (
        format_value_and_uncertainty(
            0.0, float(trend.course.expanded(at, next_use=one)[0]) / trend.si
        )[1]
        for one in (False, True)
    )
    return mean, next_use


def drift_text(trend: CoefficientTrend) -> str:
    """Describe the drift of a coefficient and the test of its constancy."""
    text = "a drift cannot be estimated from fewer than three calibrations"
    if (line := trend.line) is not None:
        text = f"drift {' ± '.join(format_slope(trend))} {trend.unit} per year"
        if line.tau > 0:
            size = format_value_and_uncertainty(0.0, line.tau / trend.si)[1]
            text += f", with a scatter of {size} {trend.unit} about the line"
        if line.count < LEAST_FOR_DRIFT:
            text += f"; at least {LEAST_FOR_DRIFT} calibrations are needed to judge it"
    test = trend.constancy
    if test.dof:
        text += f"; fitted as a constant, χ² = {test.chi2:.1f} with {test.dof} degrees of freedom, "
        text += f"p {p_value_text(test.p_value)}"
    if trend.courses is not None and trend.courses.best != "level":
        text += f"; {_COURSES[trend.courses.best]} fits better than a constant value"
    return text


def history_lines(history: SensorHistory) -> list[str]:
    """Return text lines with the results of a history."""
    lines = _date_lines(history)
    if history.comparison_count:
        lines.append(
            comparison_text.exceedance_text(
                history.exceedances, history.comparison_count, history.expected_exceedances
            )
        )
    if (test := history.newest_joint_test) is not None:
        lines.append(
            f"the newest calibration compared with the previous one, all {test.size} coefficients "
            f"together: {comparison_text.joint_test_text(test)}"
        )
    if (ordinary := newest_run_to_run(history)) is not None:
        lines += comparison_text.run_to_run_lines(ordinary)
    elif history.comparison_count:
        lines += comparison_text.repeatability_lines(history.exceedances, history.newest_joint_test)
    if any(one.line is not None for one in history.trends):
        lines.append(
            "about one coefficient in 20 is called drifting or changed although nothing changed"
        )
    if history.comparison_count:
        stated = all(one.shared is not None for one in history.calibrations)
        lines.append(comparison_text.SHARED_NOTE if stated else comparison_text.INDEPENDENCE_NOTE)
    return [*lines, *(f"left out: {one}" for one in history.exclusions)]


def _date_lines(history: SensorHistory) -> list[str]:
    """Return a line on dates that are known only from files, if calibrations are compared."""
    made = [f"#{one.id}" for one in history.entries if one.measured_from == "created"]
    if len(history.entries) < 2 or not made:
        return []
    return [
        f"{', '.join(made)}: the date is that of the calibration file, so every drift is "
        "uncertain; state when it was measured with inercal store import FILE --measured DATE"
    ]
