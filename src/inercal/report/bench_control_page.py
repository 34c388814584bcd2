"""The page of the control charts of a bench, by the estimates of its own runs."""
# matplotlib's stubs leave **kwargs untyped.
# pyright: reportUnknownMemberType=false

from collections.abc import Sequence
from datetime import datetime

import numpy as np
from markupsafe import Markup

from inercal.laboratory.check_standard.bench_chart_texts import (
    bench_lines,
    day_signals,
    newest_statistics,
)
from inercal.laboratory.check_standard.bench_charts import BenchCharts
from inercal.laboratory.check_standard.chart_texts import day
from inercal.laboratory.store import CalibrationEntry
from inercal.report import drawing
from inercal.report.control_page import LASTING_WORDS, doubtful_rows, draw_dates, draw_points
from inercal.report.drawing import BAND, MUTED, PAPER, WARN, Z, svg
from inercal.report.report_tables import typeset_minus
from inercal.report.templates import render

_HEIGHT, _LABEL_ROOM, _COLUMNS = 1.3, 0.4, 2
_DAY = 86_400.0


def page(found: BenchCharts, doubtful: Sequence[CalibrationEntry] = ()) -> str:
    """Return the whole page, HTML.

    Parameters
    ----------
    found : BenchCharts
    doubtful : sequence of CalibrationEntry
        Calibrations of a register while the bench was doubtful.
    """
    lines = [typeset_minus(f"{one[0].upper()}{one[1:]}.") for one in bench_lines(found)]
    return render(
        "bench_control.html",
        bench=found.bench,
        runs=len(found.runs),
        first=day(found.runs[0].measured),
        last=day(found.runs[-1].measured),
        tone="good" if not found.episodes else "care" if found.in_control else "bad",
        summary=lines[0],
        lines=lines[1:],
        figure=_figure(found),
        lasting=LASTING_WORDS[found.lasting_kind],
        parameters=[tuple(map(typeset_minus, row)) for row in newest_statistics(found)],
        signals=day_signals(found),
        doubtful_rows=doubtful_rows(doubtful),
    )


@drawing.style
def _figure(found: BenchCharts) -> Markup:
    lines = -(-len(found.charts) // _COLUMNS)
    figure, rows = drawing.panels(_HEIGHT, [_LABEL_ROOM] * lines, _COLUMNS)
    panels = [axes for row in rows for axes in row]
    for axes, one in zip(panels, found.charts, strict=False):
        at = np.array([datetime.fromisoformat(time).timestamp() / _DAY for time in one.days])
        m = one.reference_days
        axes.axvspan(at[0], at[m - 1], color=BAND, lw=0)
        axes.plot(at[:m], one.shewhart[:m], "o", ms=2.6, mfc=PAPER, mec=MUTED, mew=0.8)
        axes.plot(at[m:], one.lasting[m:], "-", color=Z, lw=1.1)
        beyond = np.array([bool(one.signals(k)) for k in range(m, len(at))], dtype=bool)
        draw_points(axes, at[m:], one.shewhart[m:], beyond)
        for sign in (-1, 1):
            axes.axhline(sign * one.shewhart_limit, color=WARN, lw=0.9, ls="--")
            axes.axhline(sign * one.lasting_limit, color=Z, lw=0.7, ls=":")
        axes.set_title(f"{one.name}, standard deviations")
        draw_dates(axes)
    for axes in panels[len(found.charts) :]:
        axes.set_axis_off()
    names = ", ".join(one.name for one in found.charts)
    return svg(figure, "parameters", f"Shewhart and {found.lasting_kind} charts of {names}")
