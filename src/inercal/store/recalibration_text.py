"""The next calibration in words and rounded figures."""

from math import isfinite

from inercal.comparison.changes import YEAR
from inercal.store.recalibration import CoefficientInterval, Recalibration

_DAY = 86_400.0


def interval_text(years: float | None) -> str:
    """Return an interval in days; empty where there is none."""
    return "" if years is None else f"{years * YEAR / _DAY:.0f}"


def limit_text(found: Recalibration, one: CoefficientInterval) -> str:
    """Return a limit in the unit of its coefficient."""
    trend = found.history.trend(one.name)
    limit = one.limit
    if isfinite(limit.expanded):
        return f"U ≤ {limit.expanded / trend.si:.6g} {trend.unit}"
    ends = [f"{x / trend.si:.6g}" if isfinite(x) else "" for x in (limit.lower, limit.upper)]
    return f"{' to '.join(ends).strip()} {trend.unit}"


def recalibration_lines(found: Recalibration) -> list[str]:
    """Return what follows for the next calibration."""
    if not found.rows:
        return [
            "no date of the next calibration: no limits are known; state [specification.limits] "
            "in the run file, or the largest U by --limit"
        ]
    if found.years is None:
        return ["no date of the next calibration: a prediction takes three calibrations or more"]
    by = found.decided_by
    reason = (
        "never more than twice the longest interval that was seen"
        if by == "house rule"
        else f"by the prediction of {by}"
    )
    text = f"next calibration by {found.date}, after {interval_text(found.years)} days: {reason}"
    if found.years == 0:
        text = f"next calibration now: {by} exceeds its limit by the prediction"
    lines = [text]
    if (hours := found.hours_in_use) is not None:
        lines.append(f"that is {hours:.0f} hours of use")
    return lines
