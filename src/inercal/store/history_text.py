"""Histories and comparisons in words and rounded figures."""

from math import isnan

from inercal.calibration.grade import GRADE_WORDS
from inercal.calibration.verdict import COVERAGE, p_value_text
from inercal.store.changes import JointTest
from inercal.store.comparison import Comparison
from inercal.store.history import CoefficientTrend, SensorHistory
from inercal.units import format_value_and_uncertainty

INDEPENDENCE_NOTE = (
    "errors that calibrations share, such as those of the bench, are treated as independent: E_n "
    "and χ² are then too small, and only larger changes are detected"
)


def grade_text(grade: str) -> str:
    """Return a verdict's grade in words; "unknown" for a file without a grade."""
    return next((words for one, words in GRADE_WORDS.items() if one == grade), "unknown")


def format_en(value: float) -> str:
    """Return E_n, with a star where |E_n| exceeds 1; empty for the first calibration."""
    return "" if isnan(value) else f"{value:+.2f}{' *' if abs(value) > 1 else ''}"


def format_point(trend: CoefficientTrend, k: int) -> tuple[str, str]:
    """Return value and U of one of a trend's points, in its unit."""
    value, std = float(trend.values[k]), float(trend.std[k])
    return format_value_and_uncertainty(value / trend.si, COVERAGE * std / trend.si)


def format_slope(trend: CoefficientTrend) -> tuple[str, str]:
    """Return the drift a year and its U, in the trend's unit; nothing where there is no line."""
    if trend.line is None:
        return "", ""
    return format_value_and_uncertainty(
        trend.line.slope / trend.si, COVERAGE * trend.line.slope_std / trend.si
    )


def drift_text(trend: CoefficientTrend) -> str:
    """Return the drift of a coefficient, and the test of its constancy."""
    text = "a drift needs three calibrations or more"
    if (line := trend.line) is not None:
        text = f"drift {' ± '.join(format_slope(trend))} {trend.unit} a year (k = 2)"
        if line.birge > 1:
            text += f", scaled by {line.birge:.2f} because the points scatter about the line"
    test = trend.constancy
    if test.dof:
        text += f"; as a constant χ² = {test.chi2:.1f} with {test.dof} degrees of freedom, "
        text += f"p {p_value_text(test.p_value)}"
    return text


def joint_test_text(test: JointTest) -> str:
    """Return the test of all coefficients together."""
    text = (
        f"χ² = {test.chi2:.1f} with {test.rank} degrees of freedom, p {p_value_text(test.p_value)}"
    )
    if test.rank < test.size:
        text += f" (rank {test.rank} of {test.size} coefficients)"
    return text


def history_lines(history: SensorHistory) -> list[str]:
    """Return the results of a history, line by line."""
    lines: list[str] = []
    if history.comparison_count:
        lines.append(
            _exceedance_text(
                history.exceedances, history.comparison_count, history.expected_exceedances
            )
        )
    if (test := history.newest_joint_test) is not None:
        lines.append(
            f"the newest calibration against the previous, all {test.size} coefficients "
            f"together: {joint_test_text(test)}"
        )
    if any(one.line is not None for one in history.trends):
        lines.append("without any change, about one coefficient in 13 is not called steady")
    if history.comparison_count:
        lines.append(INDEPENDENCE_NOTE)
    return [*lines, *(f"left out: {one}" for one in history.exclusions)]


def comparison_lines(compared: Comparison) -> list[str]:
    """Return the results of a comparison, line by line."""
    first, second = compared.first.sensor.name, compared.second.sensor.name
    lines = (
        [f"the calibrations are of two sensors: {first} and {second}"] if first != second else []
    )
    if compared.same_recording:
        lines.append(
            "both are of the same recording and share its errors: E_n shows no change of the sensor"
        )
    lines.append(
        _exceedance_text(compared.exceedances, len(compared.names), compared.expected_exceedances)
    )
    if compared.joint_test is not None:
        lines.append(f"all together: {joint_test_text(compared.joint_test)}")
    return [*lines, INDEPENDENCE_NOTE, *(f"left out: {one}" for one in compared.exclusions)]


def _exceedance_text(beyond: int, of: int, by_chance: float) -> str:
    return (
        f"|E_n| > 1 (*) in {beyond} of {of}; without any change chance gives about {by_chance:.2g}"
    )
