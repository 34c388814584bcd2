"""Describe histories of sensors and their noise in words and rounded numbers.

Describe the date of the next calibration in words and rounded numbers.
"""

from collections.abc import Collection, Sequence
from datetime import datetime
from math import floor, isfinite

import numpy as np

from inercal.basics.units import format_count, format_value_and_uncertainty
from inercal.calibration.comparison import build_comparison, run_to_run
from inercal.calibration.comparison.changes import YEAR
from inercal.calibration.comparison.common_scale import common_scale_lines
from inercal.calibration.comparison.courses import LEAST_FOR_DRIFT, Course, fit_course
from inercal.calibration.comparison.run_to_run import (
    RunScatter,
    RunToRun,
    against_scatter,
    format_en,
)
from inercal.calibration.suspect_text import p_value_text
from inercal.estimation.scores import SIGNIFICANCE_LEVEL
from inercal.estimation.uncertainty import COVERAGE
from inercal.laboratory.store.history import CoefficientTrend, SensorHistory
from inercal.laboratory.store.noise_history import NoiseTrend
from inercal.laboratory.store.recalibration import CoefficientInterval, Recalibration
from inercal.noise.texts import coefficient_cells

_NAMED = 3  # largest number of changed coefficients that a line names
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


def newest_change_text(history: SensorHistory) -> str:
    """Say which coefficients changed most since the previous calibration; "" if it may be chance.

    If there are enough other calibrations, their scatter is not a change.
    """
    ordinary, joint = newest_run_to_run(history), history.newest_joint_test
    joint = joint if ordinary is None else ordinary.joint
    found = {one.name: float(one.normalised_errors[-1]) for one in history.trends}
    names = found if ordinary is None else ordinary.beyond
    changed = sorted((one for one in names if abs(found[one]) > 1), key=lambda n: -abs(found[n]))
    if joint is None or joint.p_value >= SIGNIFICANCE_LEVEL or not changed:
        return ""
    before, more = history.entries[-2], len(changed) - _NAMED
    named = ", ".join(f"{one} by {abs(found[one]):.3g} E_n" for one in changed[:_NAMED])
    return (
        f"changed since calibration #{before.id} of {before.measured.partition('T')[0]}: {named}"
        f"{f' and {more} more' if more > 0 else ''}; see inercal store history"
    )


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
        lines += common_scale_lines(build_comparison(*history.calibrations[-2:]))
    if (ordinary := newest_run_to_run(history)) is not None:
        lines += run_to_run.run_to_run_lines(ordinary)
        drifting = set(ordinary.within).intersection(history.verdicts.get("drifts", ()))
        if drifting:
            lines.append(
                f"{', '.join(sorted(drifting))}: the newest change is within that scatter, but all "
                "calibrations together show a drift"
            )
    elif history.comparison_count:
        lines += run_to_run.repeatability_lines(history.exceedances, history.newest_joint_test)
    found = (*history.verdicts.get("drifts", ()), *history.verdicts.get("changed", ()))
    if len(history.entries) > 2 and found:
        lines.append("by chance, about 1 of 20 coefficients is called drifting or changed")
    if history.comparison_count and any(one.shared is None for one in history.calibrations):
        lines.append(run_to_run.INDEPENDENCE_NOTE)
    return [*lines, *(f"left out: {one}" for one in history.exclusions)]


def _date_lines(history: SensorHistory) -> list[str]:
    """Return a line on dates that are known only from files, if calibrations are compared."""
    made = [f"#{one.id}" for one in history.entries if one.measured_from == "created"]
    if len(history.entries) < 2 or not made:
        return []
    if len(made) > 6:
        made[3:] = [f"and {len(made) - 3} others"]
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


_DAY = 86_400.0


def interval_text(years: float | None) -> str:
    """Return an interval as a text in days; empty if there is no interval."""
    return "" if years is None else f"{floor(years * YEAR / _DAY)}"


def limit_text(found: Recalibration, one: CoefficientInterval) -> str:
    """Return a limit in the unit of its coefficient as text."""
    trend = found.history.trend(one.name)
    limit = one.limit
    if isfinite(limit.expanded):
        return f"U ≤ {limit.expanded / trend.si:.6g} {trend.unit}"
    ends = [f"{x / trend.si:.6g}" if isfinite(x) else "" for x in (limit.lower, limit.upper)]
    return f"{' to '.join(ends).strip()} {trend.unit}"


def interval_table(found: Recalibration) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return the headings and cells of a table of intervals, one row for each coefficient."""
    heads = ["predicted U now", "prediction, days", "chart", "staircase"]
    columns = [
        [expanded_text(found, one) for one in found.rows],
        [interval_text(one.prediction) for one in found.rows],
        [interval_text(one.chart) for one in found.rows],
        [interval_text(one.staircase) for one in found.rows],
    ]
    if any(one.hours is not None for one in found.rows):
        heads.append("time in use, hours")
        columns.append(["" if one.hours is None else f"{one.hours:.0f}" for one in found.rows])
    if found.pool is not None:
        heads.append("pooled sensors")
        columns.append([str(one.sensors or "") for one in found.rows])
    return tuple(heads), list(zip(*columns, strict=True))


def expanded_text(found: Recalibration, one: CoefficientInterval) -> str:
    """Return U for a use just after the newest calibration; empty if there is no prediction."""
    if one.expanded is None:
        return ""
    trend = found.history.trend(one.name)
    expanded = format_value_and_uncertainty(0.0, one.expanded / trend.si)[1]
    return f"{expanded} {trend.unit}"


def _exceedance_text(found: Recalibration) -> str:
    """Describe a limit that is already exceeded."""
    one = next(row for row in found.rows if row.name == found.decided_by)
    trend = found.history.trend(one.name)
    limit, expanded = limit_text(found, one), expanded_text(found, one)
    if isfinite(one.limit.expanded):
        text = (
            f"the predicted U {expanded} already exceeds the limit {limit} on the day of the newest"
        )
        text += " calibration (it includes the scatter of that calibration and of the use)"
    else:
        value = format_value_and_uncertainty(
            float(trend.values[-1]) / trend.si, (one.expanded or 0.0) / trend.si
        )[0]
        text = (
            f"{value} with the predicted U {expanded} is within {limit} with a probability below "
            "95 %"
        )
    return f"calibrate now: {one.name}: {text}"


def _too_few_text(found: Recalibration) -> str:
    """Return the reason why no date is predicted."""
    entries = found.history.entries
    count = len(entries)
    first, last = (datetime.fromisoformat(entries[k].measured) for k in (0, -1))
    days = (last - first).total_seconds() / _DAY
    apart = f" {format_count(round(days), 'day')} apart" if count == 2 else ""
    have = (
        f"{format_count(count, 'calibration')}{apart} {'are' if count > 1 else 'is'} too few to "
        "predict; " if count < 3 else ""
    )  # fmt: skip
    return (
        f"the date of the next calibration cannot be predicted: {have}a prediction needs three "
        "calibrations of this sensor, or two each of sensors of the same type; state [job] "
        "model, or name such sensors with --like"
    )


def _pool_lines(found: Recalibration) -> list[str]:
    """Return lines on predictions that use several sensors of the type."""
    lines: list[str] = []
    if found.pool is not None:
        count = len(found.history.entries)
        of_type = f" of type {found.pool.type_name}" if found.pool.type_name else ""
        lines.append(
            f"pooled over {format_count(len(found.pool.sensors), 'sensor')}"
            f"{of_type}: "
            f"{', '.join(found.pool.sensors)}; the sensor itself has "
            f"{format_count(count, 'calibration')}"
        )
        rows = [one.name for one in found.rows if one.sensors]
        for others in dict.fromkeys(found.pool.changes[one].apart for one in rows):
            names = [one for one in rows if found.pool.changes[one].apart == others]
            lines += [
                f"{', '.join(names)}: not pooled with {', '.join(others)}, because they scatter or "
                "drift more than the others"
            ] * bool(others)
    apart = [one.name for one in found.rows if one.is_apart]
    if apart:
        lines.append(
            f"{', '.join(apart)}: not pooled, because the sensor's own calibrations scatter or "
            "drift more than those of its type"
        )
    return lines


def recalibration_lines(found: Recalibration) -> list[str]:
    """Return lines with the date of the next calibration and the reason for it."""
    if not found.rows:
        return [
            "the date of the next calibration cannot be predicted, because no limits are "
            "known; state [specification.limits] in the run file, or the largest acceptable U "
            "with --limit"
        ]
    if found.years is None:
        return [_too_few_text(found), *_pool_lines(found)]
    by = found.decided_by
    reason = (
        "an interval is never more than twice the longest one so far"
        if by == "house rule"
        else f"{by} is predicted to reach its limit then"
    )
    text = f"next calibration by {found.date}, after {interval_text(found.years)} days: {reason}"
    if found.years == 0:
        text = _exceedance_text(found)
    lines, hours = [text], found.hours_in_use
    if hours is not None:
        lines.append(f"the date is {hours:.0f} hours of use after the newest calibration")
    if (reading := found.operating_hours) is not None and found.years > 0:
        left = reading - (found.history.operating_hours[-1] or 0.0)
        at = f"at {reading:.0f} operating hours, {left:.0f} hours after the newest calibration"
        if hours is not None and left < hours:
            lines = [f"next calibration {at}, which comes before the date:", *lines]
        else:
            lines.append(f"or {at}, if that comes first")
    return [*lines, *_pool_lines(found)]
