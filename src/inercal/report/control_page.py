"""The page of the control charts of a check standard."""
# matplotlib's stubs leave **kwargs untyped.
# pyright: reportUnknownMemberType=false

from collections.abc import Sequence
from datetime import datetime
from typing import NamedTuple

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.dates import ConciseDateFormatter
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.keys import CoefficientName
from inercal.estimation.uncertainty.control_charts import KINDS, LastingKind
from inercal.laboratory.check_standard import ControlCharts
from inercal.laboratory.check_standard.chart_texts import control_lines, day, signal_text
from inercal.laboratory.store import CalibrationEntry
from inercal.report import drawing
from inercal.report.drawing import BAND, FAINT, INK, MUTED, PAPER, WARN, Z, svg
from inercal.report.report_tables import typeset_minus
from inercal.report.templates import render

_HEIGHT, _LABEL_ROOM, _COLUMNS = 1.3, 0.4, 2
_DAY = 86_400.0
_FORMATS = ["%Y", "%Y-%m", "%m-%d", "%H:%M", "%H:%M", "%S"]


LASTING_WORDS: dict[LastingKind, tuple[str, str]] = {
    "EWMA": ("EWMA", "its moving mean, the EWMA, in its own"),
    "CUSUM": ("CUSUM", "the larger of its sums, the CUSUM"),
}


class _ChartFigure(NamedTuple):
    title: str
    figure: Markup


def page(found: ControlCharts, doubtful: Sequence[CalibrationEntry] | None = None) -> str:
    """Return the whole page, HTML.

    Parameters
    ----------
    found : ControlCharts
    doubtful : sequence of CalibrationEntry, optional
        Calibrations of a register while the bench was doubtful.
    """
    lines = [_sentence(line) for line in control_lines(found)]
    return render(
        "control.html",
        sensor=found.matched.sensor.name,
        reference=found.reference_days,
        until=day(found.reference_end),
        days=len(found.points),
        lasting=LASTING_WORDS[found.limits.lasting_kind],
        tone="good" if not found.episodes else "care" if found.in_control else "bad",
        summary=lines[0],
        lines=lines[1:],
        joint=_joint_figure(found) if found.points else "",
        figures=_axis_figures(found) if found.points else [],
        signals=[
            (
                day(one.last),
                typeset_minus(f"{found.values.t2[t]:.1f}"),
                typeset_minus(f"{found.values.mewma[t]:.1f}"),
                "; ".join(signal_text(kind, one.signals[kind]) for kind in KINDS
                          if kind in one.signals),
            )
            for t, one in enumerate(found.points)
            if not one.in_control
        ],
        doubtful=doubtful,
        doubtful_rows=doubtful_rows(doubtful or ()),
    )  # fmt: skip


def doubtful_rows(entries: Sequence[CalibrationEntry]) -> list[tuple[str, str, str, str]]:
    """Return the rows of the section of doubtful calibrations."""
    return [(f"#{one.id}", one.sensor, day(one.measured), one.method) for one in entries]


def _sentence(line: str) -> str:
    return typeset_minus(f"{line[0].upper()}{line[1:]}.")


def _times(found: ControlCharts) -> Array:
    """Return when each day was measured, in days since 1970."""
    times = (max(found.sessions[k].measured for k in one) for one in found.days.sessions)
    return np.array([datetime.fromisoformat(time).timestamp() / _DAY for time in times])


@drawing.style
def _joint_figure(found: ControlCharts) -> Markup:
    figure, rows = drawing.panels(_HEIGHT, [_LABEL_ROOM], _COLUMNS)
    at = _times(found)[found.reference_days :]
    values, limits = found.values, found.limits
    panels = (("T²", values.t2, limits.t2), ("MEWMA", values.mewma, limits.mewma))
    for axes, (name, statistic, limit) in zip(rows[0], panels, strict=True):
        draw_points(axes, at, statistic, statistic > limit)
        axes.axhline(limit, color=WARN, lw=0.9, ls="--")
        axes.set_ylim(0, 1.1 * max(limit, float(statistic.max())))
        axes.set_title(f"{name}, limit {limit:.1f}")
        draw_dates(axes)
    return svg(figure, "joint", "T² and MEWMA over time with their limits")


def _axis_figures(found: ControlCharts) -> list[_ChartFigure]:
    groups: dict[str, list[int]] = {}
    for k, name in enumerate(found.names):
        groups.setdefault(CoefficientName(name).axis, []).append(k)
    return [
        _ChartFigure(axis, _axis_figure(found, places, f"axis{n}"))
        for n, (axis, places) in enumerate(groups.items())
    ]


@drawing.style
def _axis_figure(found: ControlCharts, places: list[int], name: str) -> Markup:
    figure, rows = drawing.panels(_HEIGHT, [_LABEL_ROOM] * -(-len(places) // _COLUMNS), _COLUMNS)
    panels = [axes for row in rows for axes in row]
    times, m = _times(found), found.reference_days
    for axes, k in zip(panels, places, strict=False):
        of_days = found.days
        variance = of_days.point[:, k, k] + of_days.reference[:, k, k]
        first = (of_days.difference[:, k] / np.sqrt(variance))[:m]
        z, lasting = found.values.shewhart[:, k], found.values.lasting[:, k]
        limit, of_lasting = found.limits.shewhart[k] ** 0.5, found.limits.lasting[k] ** 0.5
        axes.axvspan(times[0], times[m - 1], color=BAND, lw=0)
        axes.plot(times[:m], first, "o", ms=2.6, mfc=PAPER, mec=MUTED, mew=0.8)
        axes.plot(times[m:], lasting, "-", color=Z, lw=1.1)
        draw_points(axes, times[m:], z, (np.abs(z) > limit) | (np.abs(lasting) > of_lasting))
        for sign in (-1, 1):
            axes.axhline(sign * limit, color=WARN, lw=0.9, ls="--")
            axes.axhline(sign * of_lasting, color=Z, lw=0.7, ls=":")
        axes.set_title(f"{found.names[k]}, standard deviations")
        draw_dates(axes)
    for axes in panels[len(places) :]:
        axes.set_axis_off()
    names = ", ".join(found.names[k] for k in places)
    return svg(figure, name, f"Shewhart and {found.limits.lasting_kind} charts of {names}")


def draw_points(axes: Axes, at: Array, values: Array, beyond: NDArray[np.bool_]) -> None:
    """Draw the points of a chart; those beyond a limit as diamonds."""
    axes.plot(at[~beyond], values[~beyond], "o", ms=3.0, mfc=INK, mec=INK, mew=0)
    # Another shape, open and larger: to be told without colour too.
    axes.plot(at[beyond], values[beyond], "D", ms=5.0, mfc=PAPER, mec=WARN, mew=1.4, zorder=3)
    axes.grid(axis="y", color=FAINT, lw=0.3)
    axes.set_axisbelow(True)


def draw_dates(axes: Axes) -> None:
    """Give the axis of time, in days since 1970, its dates."""
    locator = drawing.date_ticks()
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(
        ConciseDateFormatter(locator, formats=_FORMATS, zero_formats=_FORMATS, show_offset=False)
    )
