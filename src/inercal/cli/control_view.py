"""Terminal output of control charts, for a check standard or a bench."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from inercal.basics.units import format_count
from inercal.cli.console import print_line, print_lines, print_table
from inercal.laboratory.check_standard import ControlCharts, chart_texts
from inercal.laboratory.check_standard.bench_charts import BenchCharts

if TYPE_CHECKING:
    from inercal.laboratory.store import CalibrationEntry

_NEWEST = 20  # number of days listed in the table


def print_charts(found: ControlCharts | BenchCharts) -> None:
    """Print the newest statistics of control charts, and the conclusions from them."""
    if isinstance(found, BenchCharts):
        _print_bench_charts(found)
    else:
        _print_control_charts(found)


def _print_control_charts(found: ControlCharts) -> None:
    """Print the statistics for the newest days, and the conclusions from the charts."""
    days, limits, values = len(found.points), found.limits, found.values
    print_line(
        f"{found.matched.sensor.name}: {format_count(len(found.sessions), 'session')} of "
        f"{found.reference_days + days} days; the reference is the first {found.reference_days}, "
        f"until {chart_texts.day(found.reference_end)}"
    )
    rows: list[tuple[str, ...]] = []
    for t in range(max(days - _NEWEST, 0), days):
        point = found.points[t]
        largest = (
            f"{one[t][np.argmax(np.abs(one[t]))]:.2f}" for one in (values.shewhart, values.lasting)
        )
        words = "; ".join(
            chart_texts.signal_text(kind, names) for kind, names in point.signals.items()
        )
        joint = f"{values.t2[t]:.1f}", f"{values.mewma[t]:.1f}"
        rows.append((chart_texts.day(point.last), *largest, *joint, words))
    ends = (
        f"{one.min():.2f}" if np.ptp(one) < 0.005 else f"{one.min():.2f} to {one.max():.2f}"
        for one in (np.sqrt(limits.shewhart), np.sqrt(limits.lasting))
    )
    rows.append(("limit", *ends, f"{limits.t2:.1f}", f"{limits.mewma:.1f}", ""))
    numbers = (">largest z", f">largest {limits.lasting_kind}", ">T²", ">MEWMA")
    print_table(("day", *numbers, "signals"), rows)
    if days > _NEWEST:
        print_line(f"the newest {_NEWEST} of {days} days")
    print_lines(chart_texts.control_lines(found), "· ")


def _print_bench_charts(found: BenchCharts) -> None:
    """Print the newest statistics for each bench parameter, and the days with signals."""
    first, last = (chart_texts.day(found.runs[k].measured) for k in (0, -1))
    print_line(
        f"bench {found.bench}: {format_count(len(found.runs), 'calibration')}, {first} to {last}"
    )
    numbers = (">largest z", ">limit", f">largest {found.lasting_kind}", ">limit")
    print_table(("parameter", "meaning", *numbers), chart_texts.newest_statistics(found))
    if signals := chart_texts.day_signals(found):
        print_table(("day", "signals"), signals)
    print_lines(chart_texts.bench_lines(found), "· ")


def print_doubtful(entries: "Sequence[CalibrationEntry] | None") -> None:
    """Print the calibrations that are doubtful because the bench was out of control."""
    if entries:
        rows = [
            (f"#{one.id}", one.sensor, chart_texts.day(one.measured), one.method) for one in entries
        ]
        print_table(("doubtful calibration", "sensor", "measured", "method"), rows)
    elif entries is not None:
        print_line("· no calibration of another sensor in the register is from a doubtful period")


def doubtful_object(entries: "Sequence[CalibrationEntry] | None") -> dict[str, Any]:
    """Return the doubtful calibrations for JSON; empty if no register was used."""
    if entries is None:
        return {}
    return {
        "doubtful": [
            {"calibration": one.id, "sensor": one.sensor, "measured": one.measured}
            for one in entries
        ]
    }
