"""Describe control charts in words and rounded numbers, and in a file `*.control.json`."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from inercal.basics.documents import attributes, origin, record_object
from inercal.basics.units import format_count, format_number
from inercal.calibration.check_standard import SCHEMA
from inercal.estimation.uncertainty.control_charts import EWMA_WEIGHT, MEWMA_WEIGHT, ChartKind
from inercal.laboratory.check_standard.bench_charts import BenchCharts
from inercal.laboratory.check_standard.charts import ControlCharts, Episode
from inercal.laboratory.repeatability.session_findings import outlier_sessions
from inercal.physics.sensors import SI_UNITS


def day(time: str) -> str:
    """Return the day of a time in ISO 8601."""
    return time.partition("T")[0]


def signal_text(kind: ChartKind, names: tuple[str, ...]) -> str:
    """Describe a signal: the name of the chart and the coefficients."""
    return f"{kind} of {', '.join(names)}" if names else kind


def episode_text(one: Episode) -> str:
    """Describe the period in which the bench is doubtful."""
    until = "now" if one.until is None else day(one.until)
    return f"from {day(one.since)} to {until}"


def doubtful_text(one: Episode) -> str:
    """Return a sentence that explains what an episode means."""
    return (
        f"the bench is doubtful {episode_text(one)}, and so are all sensors calibrated on it in "
        "that time"
    )


def opening_line(days: Sequence[tuple[str, bool]]) -> str:
    """Describe the charts in one line, from the time of each day and whether it is in control."""
    if not days:
        return "no day has been charted yet, because all days so far belong to the reference"
    out, count = sum(not good for _, good in days), format_count(len(days), "day")
    if not out:
        return f"in control: no signal on {count}"
    newest, good = days[-1]
    word = "in control" if good else "out of control"
    return f"{word} on {day(newest)}; {out} of {count} gave a signal"


def control_lines(found: ControlCharts) -> list[str]:
    """Return text lines with the results of the charts; the most serious result comes first."""
    lines = [opening_line([(one.last, one.in_control) for one in found.points])]
    lines += [doubtful_text(one) for one in found.episodes]
    if (shift := found.reference_shift) is not None:
        unit = found.matched.sensor.coefficient(shift.name)
        lines.append(
            f"the reference is not homogeneous: {shift.name} changed by "
            f"{format_number(shift.shift / unit.si, 3)} {unit.unit} ({shift.ratio:.2g} σ, p = "
            f"{shift.probability:.1g}) between {day(shift.since)} and {day(shift.until)}; find the "
            "cause, or begin the reference after it with --since"
        )
    lines += [
        f"{label} is an outlier in the reference (p = {p:.1g}); leave it out if you know the cause"
        for label, p in outlier_sessions(found.fit, "bench").items()
    ]
    limits = found.limits
    lines.append(
        "while the bench is in control, a false alarm from any of the charts is expected once "
        f"in {limits.run_length:.0f} days or more (T² and MEWMA: once in "
        f"{limits.joint_run_length:.0f} days each; each chart of one coefficient: once in "
        f"{limits.single_run_length:.0f} days)"
    )
    if found.matched.unstated:
        lines.append(
            f"{format_count(len(found.matched.unstated), 'session does', 'sessions do')} not state "
            "which errors calibrations share, so all of their uncertainty is treated as shared"
        )
    if found.matched.left_out:
        lines.append(
            "not charted, because not all sessions estimated them: "
            f"{', '.join(found.matched.left_out)}"
        )
    return lines


def control_charts_object(found: ControlCharts) -> dict[str, Any]:
    """Return the charts as a JSON object; values are in SI, and statistics have no unit."""
    matched, limits, values = found.matched, found.limits, found.values
    scatter = np.sqrt(np.diagonal(found.days.point[-1])) * found.fit.unit
    kind = limits.lasting_kind.lower()
    single = zip(np.sqrt(limits.shewhart), np.sqrt(limits.lasting), strict=True)
    return {
        "schema": SCHEMA,
        "sensor": {"name": matched.sensor.name},
        "frame": matched.frame,
        "form": matched.sensor.form,
        "in_control": found.in_control,
        "run_length": {
            "all": limits.run_length,
            "joint": limits.joint_run_length,
            "single": limits.single_run_length,
        },
        "weights": {"EWMA": EWMA_WEIGHT, "MEWMA": MEWMA_WEIGHT},
        "lasting": limits.lasting_kind,
        "reference": {
            "days": found.reference_days,
            "until": found.reference_end,
            "shift": record_object(found.reference_shift),
        },
        "coefficients": [
            {
                "name": name,
                "unit": SI_UNITS[matched.sensor.coefficient(name).unit],
                "reference": float(found.fit.mean[k] * found.fit.unit[k]),
                "sd": float(scatter[k]),
                "dof": float(found.dof[k]),
                "shewhart_limit": float(shewhart),
                f"{kind}_limit": float(lasting),
            }
            for k, (name, (shewhart, lasting)) in enumerate(zip(found.names, single, strict=True))
        ],
        "limits": {"T²": limits.t2, "MEWMA": limits.mewma, "dof": found.joint_dof},
        "points": [
            {
                "first": point.first,
                "last": point.last,
                "sessions": list(point.labels),
                "in_control": point.in_control,
                "signals": {kind: list(names) for kind, names in point.signals.items()},
                "T²": float(values.t2[t]),
                "MEWMA": float(values.mewma[t]),
                "shewhart": values.shewhart[t].tolist(),
                kind: values.lasting[t].tolist(),
            }
            for t, point in enumerate(found.points)
        ],
        "episodes": record_object(found.episodes),
    } | origin()


BENCH_SCHEMA = "inercal/control/bench/1"


def bench_lines(found: BenchCharts) -> list[str]:
    """Return text lines with the results of the charts; the most serious result comes first."""
    lines = [opening_line([(one.measured, one.in_control) for one in found.points])]
    lines += [doubtful_text(one) for one in found.episodes]
    lines.append(
        "while the bench is in control, a false alarm from any of the charts is expected once "
        f"in {found.run_length:.0f} days or more (for each of the {2 * len(found.charts)} "
        f"charts, once in {found.single_run_length:.0f} days)"
    )
    if found.too_few:
        named = ", ".join(
            f"{name} ({format_count(count, 'day')})" for name, count in found.too_few.items()
        )
        lines.append(f"not charted, because they have fewer days than the reference: {named}")
    return lines


def day_signals(found: BenchCharts) -> list[tuple[str, str]]:
    """Return the days that are out of control, and the charts that give a signal on each day."""
    return [
        (day(one.measured), "; ".join(signal_text(*part) for part in one.signals.items()))
        for one in found.points
        if not one.in_control
    ]


def bench_charts_object(found: BenchCharts) -> dict[str, Any]:
    """Return the charts as a JSON object; values are in SI units, and statistics have no unit."""
    kind = found.lasting_kind.lower()
    return {
        "schema": BENCH_SCHEMA,
        "bench": found.bench,
        "in_control": found.in_control,
        "run_length": {"all": found.run_length, "single": found.single_run_length},
        "weights": {"EWMA": EWMA_WEIGHT},
        "lasting": found.lasting_kind,
        "parameters": [
            {
                **attributes(one, "name unit meaning"),
                "reference": one.mean,
                "reference_std": one.mean_std,
                **attributes(one, "reference_days scatter shewhart_limit"),
                f"{kind}_limit": one.lasting_limit,
                "points": [
                    {
                        "measured": time,
                        "value": float(one.values[k]),
                        "own_std": float(one.std[k]),
                        "shewhart": float(one.shewhart[k]),
                        kind: None if k < one.reference_days else float(one.lasting[k]),
                        "signals": list(one.signals(k)),
                    }
                    for k, time in enumerate(one.days)
                ],
            }
            for one in found.charts
        ],
        "too_few": found.too_few,
        "episodes": record_object(found.episodes),
    } | origin()


def newest_statistics(found: BenchCharts) -> list[tuple[str, ...]]:
    """Return the largest |z| and EWMA or CUSUM for each parameter, with their limits."""
    rows: list[tuple[str, ...]] = []
    for one in found.charts:
        later = slice(one.reference_days, None)
        z, lasting = one.shewhart[later], one.lasting[later]
        largest = [
            f"{values[np.argmax(np.abs(values))]:.2f}" if values.size else ""
            for values in (z, lasting)
        ]
        limits = f"{one.shewhart_limit:.2f}", f"{one.lasting_limit:.2f}"
        rows.append((one.name, one.meaning, largest[0], limits[0], largest[1], limits[1]))
    return rows
