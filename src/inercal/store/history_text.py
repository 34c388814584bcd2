"""What a history or a comparison says, in words and rounded figures."""

from math import isnan

from inercal.calibration.grade import GRADE_WORDS
from inercal.calibration.verdict import COVERAGE, p_value_text
from inercal.store.changes import JointTest
from inercal.store.comparison import Comparison
from inercal.store.history import CoefficientTrend, SensorHistory
from inercal.units import format_value_and_uncertainty

INDEPENDENCE_NOTE = (
    "errors that calibrations share, as of one bench, are counted as if they were independent: E_n "
    "and χ² come out too small then, and a change must be larger to be seen"
)


def grade_text(grade: str) -> str:
    """Return a verdict's grade in words, "unknown" for that of an older file."""
    return next((words for one, words in GRADE_WORDS.items() if one == grade), "unknown")


def format_en(value: float) -> str:
    """Return E_n, with a star where it exceeds 1 to either side; nothing of the first."""
    return "" if isnan(value) else f"{value:+.2f}{' *' if abs(value) > 1 else ''}"


def format_point(course: CoefficientTrend, k: int) -> tuple[str, str]:
    """Return value and U of one of a course's points, in its unit."""
    value, std = float(course.values[k]), float(course.std[k])
    return format_value_and_uncertainty(value / course.si, COVERAGE * std / course.si)


def format_slope(course: CoefficientTrend) -> tuple[str, str]:
    """Return the drift a year and its U, in the course's unit; nothing where there is no line."""
    if course.line is None:
        return "", ""
    return format_value_and_uncertainty(
        course.line.slope / course.si, COVERAGE * course.line.slope_std / course.si
    )


def drift_text(course: CoefficientTrend) -> str:
    """Return how a coefficient drifts, and how well it is a constant."""
    text = "no drift is told of fewer than three calibrations"
    if (line := course.line) is not None:
        text = f"drift {' ± '.join(format_slope(course))} {course.unit} a year (k = 2)"
        if line.birge > 1:
            text += f", scaled by {line.birge:.2f} since the points scatter about the line"
    test = course.constancy
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
    """Return what a history says as a whole, line by line."""
    lines: list[str] = []
    if history.comparison_count:
        lines.append(
            _exceedance_text(
                history.exceedances, history.comparison_count, history.expected_exceedances
            )
        )
    if (test := history.newest_joint_test) is not None:
        lines.append(
            f"the newest calibration against the one before, all {test.size} coefficients "
            f"together: {joint_test_text(test)}"
        )
    if any(one.line is not None for one in history.trends):
        lines.append("where nothing changes about one coefficient in 13 is not called steady")
    if history.comparison_count:
        lines.append(INDEPENDENCE_NOTE)
    return [*lines, *(f"left out: {one}" for one in history.exclusions)]


def comparison_lines(compared: Comparison) -> list[str]:
    """Return what a comparison says as a whole, line by line."""
    first, second = compared.first.sensor.name, compared.second.sensor.name
    lines = [f"they are of two sensors: {first} and {second}"] if first != second else []
    if compared.same_recording:
        lines.append(
            "both are of one recording: they share its errors, and E_n says nothing of a change"
        )
    lines.append(
        _exceedance_text(compared.exceedances, len(compared.names), compared.expected_exceedances)
    )
    if compared.joint_test is not None:
        lines.append(f"all together: {joint_test_text(compared.joint_test)}")
    return [*lines, INDEPENDENCE_NOTE, *(f"left out: {one}" for one in compared.exclusions)]


def _exceedance_text(beyond: int, of: int, by_chance: float) -> str:
    return (
        f"|E_n| > 1 (*) in {beyond} of {of}; where nothing changes chance gives about "
        f"{by_chance:.2g}"
    )
