"""Control charts in words and rounded figures."""

from inercal.estimation.uncertainty.control_charts import ChartKind
from inercal.laboratory.check_standard.charts import ControlCharts, Episode
from inercal.laboratory.repeatability.session_findings import outlier_sessions


def day(time: str) -> str:
    """Return the day of a time in ISO 8601."""
    return time.partition("T")[0]


def signal_text(kind: ChartKind, names: tuple[str, ...]) -> str:
    """Return a chart that signals, with its coefficients."""
    return f"{kind} of {', '.join(names)}" if names else kind


def episode_text(one: Episode) -> str:
    """Return the time in which the bench is doubtful."""
    until = "now" if one.until is None else day(one.until)
    return f"from {day(one.since)} to {until}"


def doubtful_text(one: Episode) -> str:
    """Return what an episode means."""
    return f"the bench is doubtful {episode_text(one)}: all sensors that were calibrated on it then"


def control_lines(found: ControlCharts) -> list[str]:
    """Return what the charts say, the gravest first."""
    out = sum(not one.in_control for one in found.points)
    lines: list[str] = []
    if not found.points:
        lines.append("no day after the reference: nothing is charted yet")
    elif out:
        word = "in control" if found.in_control else "out of control"
        lines.append(
            f"{word} on {day(found.points[-1].last)}; {out} of {len(found.points)} days signal"
        )
    else:
        lines.append(f"in control: none of {len(found.points)} days signals")
    lines += [doubtful_text(one) for one in found.episodes]
    lines += [
        f"{label} lies apart from the rest of the reference (p = {p:.1g}): leave it out, if its "
        "cause is known"
        for label, p in outlier_sessions(found.fit, "bench").items()
    ]
    limits = found.limits
    lines.append(
        f"in control all charts together signal falsely once in {limits.run_length:.0f} days or "
        f"more: T² and MEWMA in {limits.joint_run_length:.0f} each, the charts of a coefficient in "
        f"{limits.single_run_length:.0f} each"
    )
    if found.matched.unstated:
        lines.append(
            f"{len(found.matched.unstated)} sessions do not state what calibrations share: all of "
            "their uncertainty is taken as shared"
        )
    if found.matched.left_out:
        lines.append(f"not in all sessions, or fixed: {', '.join(found.matched.left_out)}")
    return lines
