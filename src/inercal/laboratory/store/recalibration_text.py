"""Describe the date of the next calibration in words and rounded numbers."""

from datetime import datetime
from math import isfinite

from inercal.basics.units import format_count, format_value_and_uncertainty
from inercal.calibration.comparison.changes import YEAR
from inercal.laboratory.store.recalibration import CoefficientInterval, Recalibration

_DAY = 86_400.0


def interval_text(years: float | None) -> str:
    """Return an interval as a text in days; empty if there is no interval."""
    return "" if years is None else f"{years * YEAR / _DAY:.0f}"


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
    apart = [one.name for one in found.rows if one.is_apart]
    if apart:
        lines.append(
            f"{', '.join(apart)}: not pooled, because the sensor's own calibrations scatter "
            "more than those of its type"
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
    lines = [text, *_pool_lines(found)]
    if (reading := found.operating_hours) is not None:
        lines.append(f"or at {reading:.0f} operating hours, if that comes first")
    if (hours := found.hours_in_use) is not None:
        lines.append(f"that is {hours:.0f} hours of use")
    return lines
