"""Describe histories of sensors and their noise in words and rounded numbers."""

from collections.abc import Collection, Sequence

import numpy as np

from inercal.basics.units import format_value_and_uncertainty
from inercal.calibration.comparison import build_comparison, run_to_run
from inercal.calibration.comparison.courses import LEAST_FOR_DRIFT, Course, fit_course
from inercal.calibration.comparison.run_to_run import (
    RunScatter,
    RunToRun,
    against_scatter,
    format_en,
)
from inercal.calibration.suspect_text import p_value_text
from inercal.estimation.uncertainty.coverage import COVERAGE
from inercal.laboratory.store.history import CoefficientTrend, SensorHistory
from inercal.laboratory.store.noise_history import NoiseTrend
from inercal.noise.texts import coefficient_cells

LEAST = 3
"""Least number of other calibrations that the scatter of a coefficient is estimated from."""


def run_scatter(history: SensorHistory, without: Collection[int]) -> RunScatter | None:
    """Return the scatter τ of each coefficient; None if there are too few calibrations.

    Parameters
    ----------
    history : SensorHistory
    without : collection of int
        Numbers of the calibrations that are being compared and are therefore excluded.
    """
    kept = {k for k, one in enumerate(history.entries) if one.id not in without}
    names: list[str] = []
    found: list[tuple[float, float]] = []
    for trend in history.trends:
        scatter = _scatter(trend, kept)
        if scatter is not None:
            names.append(trend.name)
            found.append(scatter)
    if not names:
        return None
    variance, dof = np.array(found).T
    source = f"{len(kept)} other calibrations in the register"
    return RunScatter(source, tuple(names), np.diag(variance), dof)


def newest_run_to_run(history: SensorHistory) -> RunToRun | None:
    """Compare the newest calibration with the previous one; earlier ones give the scatter."""
    if len(history.entries) < LEAST + 2:
        return None
    scatter = run_scatter(history, [one.id for one in history.entries[-2:]])
    if scatter is None:
        return None
    return against_scatter(build_comparison(*history.calibrations[-2:]), scatter)


def _scatter(trend: CoefficientTrend, kept: Collection[int]) -> tuple[float, float] | None:
    """Return τ² and its degrees of freedom; None if there are too few calibrations."""
    first = len(trend.points) - len(trend.shared)
    places = [k for k in range(first, len(trend.points)) if trend.points[k] in kept]
    if len(places) < LEAST:
        return None
    at = [k - first for k in places]
    time = trend.time[places]
    drifts = trend.courses is not None and trend.courses.drifts and np.ptp(time) > 0
    course = fit_course(
        time,
        trend.values[places],
        trend.independent_variance[at],
        trend.shared[np.ix_(at, at)],
        slope=bool(drifts),
    )
    return course.tau**2, float(course.dof)


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
            run_to_run.exceedance_text(
                history.exceedances, history.comparison_count, history.expected_exceedances
            )
        )
    if (test := history.newest_joint_test) is not None:
        lines.append(
            f"the newest calibration compared with the previous one, all {test.size} coefficients "
            f"together: {run_to_run.joint_test_text(test)}"
        )
    if (ordinary := newest_run_to_run(history)) is not None:
        lines += run_to_run.run_to_run_lines(ordinary)
    elif history.comparison_count:
        lines += run_to_run.repeatability_lines(history.exceedances, history.newest_joint_test)
    if any(one.line is not None for one in history.trends):
        lines.append(
            "about one coefficient in 20 is called drifting or changed although nothing changed"
        )
    if history.comparison_count:
        stated = all(one.shared is not None for one in history.calibrations)
        lines.append(run_to_run.SHARED_NOTE if stated else run_to_run.INDEPENDENCE_NOTE)
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


NEWEST_HEADS = ("channel", "term", "value", "U (k = 2)", "unit", "measured", "analysis")
HEADS = ("channel", "term", "number", "first", "newest", "U (k = 2)", "unit", "E_n")


def trend_rows(trends: Sequence[NoiseTrend]) -> list[tuple[str, ...]]:
    """Return a row for each coefficient: first value, newest value, and E_n of the newest value."""
    rows: list[tuple[str, ...]] = []
    for one in trends:
        _, first, *_ = coefficient_cells(one.values[0])
        _, newest, spread, *_ = coefficient_cells(one.values[-1])
        en = one.normalised_errors[-1]
        shown = "" if en is None else format_en(en)
        count = str(len(one.values))
        rows.append((one.channel, one.symbol, count, first, newest, spread, one.unit, shown))
    return rows


def newest_rows(trends: Sequence[NoiseTrend]) -> list[tuple[str, ...]]:
    """Return a row for each coefficient with its newest value and the date of measurement."""
    rows: list[tuple[str, ...]] = []
    for one in trends:
        _, value, spread, *_ = coefficient_cells(one.values[-1])
        entry = one.entries[-1]
        date = entry.measured.partition("T")[0]
        if entry.measured_from == "entered":
            date = f"{date} (entered)"
        rows.append((one.channel, one.symbol, value, spread, one.unit, date, str(entry.id)))
    return rows


def change_lines(trends: Sequence[NoiseTrend]) -> list[str]:
    """Return a line on the coefficients that changed since the previous analysis."""
    changed = [f"{one.channel} {one.symbol}" for one in trends if one.changed]
    compared = [one for one in trends if one.normalised_errors[-1] is not None]
    if not compared:
        return []
    if not changed:
        return ["no noise coefficient changed since the previous analysis (E_n ≤ 1)"]
    return [f"changed since the previous analysis (E_n > 1): {', '.join(changed)}"]
