"""Control charts for the terminal."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from inercal.cli.calibration_view import print_line
from inercal.cli.tables import add_row, make_table, number_columns
from inercal.cli.terminal import terminal
from inercal.laboratory.check_standard import ControlCharts
from inercal.laboratory.check_standard.chart_texts import control_lines, day, signal_text

if TYPE_CHECKING:
    from inercal.laboratory.store import CalibrationEntry

_NEWEST = 20  # days that the table lists


def print_charts(found: ControlCharts) -> None:
    """Print the newest days with their statistics, and what the charts say."""
    days = len(found.points)
    print_line(
        f"{found.matched.sensor.name}: {len(found.sessions)} sessions of "
        f"{found.reference_days + days} days; the reference is the first {found.reference_days}, "
        f"until {day(found.reference_end)}"
    )
    heads = number_columns(("largest z", f"largest {found.limits.lasting_kind}", "T²", "MEWMA"))
    table = make_table("day", *heads, "signals")
    limits = found.limits
    for t in range(max(days - _NEWEST, 0), days):
        point = found.points[t]
        values = found.values
        cells = (
            f"{values.shewhart[t][np.argmax(np.abs(values.shewhart[t]))]:.2f}",
            f"{values.lasting[t][np.argmax(np.abs(values.lasting[t]))]:.2f}",
            f"{values.t2[t]:.1f}",
            f"{values.mewma[t]:.1f}",
        )
        words = "; ".join(signal_text(kind, names) for kind, names in point.signals.items())
        add_row(table, day(point.last), *cells, words)
    ends = (np.sqrt(limits.shewhart), np.sqrt(limits.lasting))
    largest = [
        f"{one.min():.2f}" if np.ptp(one) < 0.005 else f"{one.min():.2f} to {one.max():.2f}"
        for one in ends
    ]
    add_row(table, "limit", *largest, f"{limits.t2:.1f}", f"{limits.mewma:.1f}", "")
    terminal().print(table)
    if days > _NEWEST:
        print_line(f"the newest {_NEWEST} of {days} days")
    for line in control_lines(found):
        print_line(f"· {line}")


def print_doubtful(entries: "Sequence[CalibrationEntry] | None") -> None:
    """Print the calibrations that a bench out of control makes doubtful."""
    if entries is None:
        return
    if not entries:
        print_line("· no calibration of the register is of a doubtful time")
        return
    table = make_table("doubtful calibration", "sensor", "measured", "method")
    for one in entries:
        add_row(table, f"#{one.id}", one.sensor, day(one.measured), one.method)
    terminal().print(table)


def doubtful_object(entries: "Sequence[CalibrationEntry] | None") -> dict[str, Any]:
    """Return the doubtful calibrations; nothing where no register was asked."""
    if entries is None:
        return {}
    return {
        "doubtful": [
            {"calibration": one.id, "sensor": one.sensor, "measured": one.measured}
            for one in entries
        ]
    }
