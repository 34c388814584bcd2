"""HTML pages with control charts of a check standard, or of a bench judged by its own runs."""
# matplotlib's stubs leave **kwargs untyped.
# pyright: reportUnknownMemberType=false

from collections.abc import Sequence
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.keys import CoefficientName
from inercal.estimation.uncertainty.control_charts import KINDS, LastingKind
from inercal.laboratory.check_standard import ControlCharts, chart_texts
from inercal.laboratory.check_standard.bench_charts import BenchCharts
from inercal.laboratory.store import CalibrationEntry
from inercal.report import drawing
from inercal.report.drawing import BAND, FAINT, INK, MUTED, PAPER, WARN, Z, svg
from inercal.report.report_tables import sentence, typeset_minus
from inercal.report.templates import render

_HEIGHT, _LABEL_ROOM, _COLUMNS = 1.3, 0.4, 2
_FORMATS = ["%Y", "%Y-%m", "%m-%d", "%H:%M", "%H:%M", "%S"]
_LASTING_WORDS: dict[LastingKind, tuple[str, str]] = {
    "EWMA": ("EWMA", "their moving mean (EWMA), in its own standard deviations"),
    "CUSUM": ("CUSUM", "the larger of their cumulative sums (CUSUM)"),
}


def charts_page(
    found: ControlCharts | BenchCharts, doubtful: Sequence[CalibrationEntry] | None = None
) -> str:
    """Return the whole page as HTML.

    Parameters
    ----------
    found : ControlCharts or BenchCharts
    doubtful : sequence of CalibrationEntry, optional
        Calibrations in the register that were made while the bench was doubtful.
    """
    if isinstance(found, BenchCharts):
        template, values, lines = (
            "bench_control.html",
            _bench(found),
            chart_texts.bench_lines(found),
        )
    else:
        template, values, lines = "control.html", _standard(found), chart_texts.control_lines(found)
    summary, *more = map(sentence, lines)
    return render(
        template,
        **values,
        tone=_tone(found),
        summary=summary,
        lines=more,
        doubtful=doubtful,
        doubtful_rows=[
            (f"#{one.id}", one.sensor, chart_texts.day(one.measured), one.method)
            for one in doubtful or ()
        ],
    )


def _tone(found: ControlCharts | BenchCharts) -> str:
    if found.in_control is False:
        return "bad"
    shifted = isinstance(found, ControlCharts) and found.reference_shift is not None
    return "care" if found.episodes or shifted or not found.points else "good"


def _standard(found: ControlCharts) -> dict[str, Any]:
    """Return the values for the page of a check standard."""
    return {
        "sensor": found.matched.sensor.name,
        "reference": found.reference_days,
        "until": chart_texts.day(found.reference_end),
        "days": len(found.points),
        "lasting": _LASTING_WORDS[found.limits.lasting_kind],
        "joint": _joint_figure(found) if found.points else "",
        "figures": _axis_figures(found) if found.points else [],
        "signals": [
            (
                chart_texts.day(one.last),
                typeset_minus(f"{found.values.t2[t]:.1f}"),
                typeset_minus(f"{found.values.mewma[t]:.1f}"),
                "; ".join(chart_texts.signal_text(kind, one.signals[kind]) for kind in KINDS
                          if kind in one.signals),
            )
            for t, one in enumerate(found.points)
            if not one.in_control
        ],
    }  # fmt: skip


def _times(found: ControlCharts) -> Array:
    """Return the measurement time of each day, in days since 1970."""
    times = (max(found.sessions[k].measured for k in one) for one in found.days.sessions)
    return np.array([drawing.days(time) for time in times])


@drawing.style
def _joint_figure(found: ControlCharts) -> Markup:
    figure, places = drawing.grid(_HEIGHT, _LABEL_ROOM, 2, _COLUMNS)
    at = _times(found)[found.reference_days :]
    values, limits = found.values, found.limits
    panels = (("T²", values.t2, limits.t2), ("MEWMA", values.mewma, limits.mewma))
    for axes, (name, statistic, limit) in zip(places, panels, strict=True):
        _draw_points(axes, at, statistic, statistic > limit)
        axes.axhline(limit, color=WARN, lw=0.9, ls="--")
        axes.set_ylim(0, 1.1 * max(limit, float(statistic.max())))
        axes.set_title(f"{name}, limit {limit:.1f}")
        drawing.name_dates(axes, _FORMATS, _FORMATS)
    return svg(figure, "joint", "T² and MEWMA over time with their limits")


def _axis_figures(found: ControlCharts) -> list[Markup]:
    groups: dict[str, list[int]] = {}
    for k, name in enumerate(found.names):
        groups.setdefault(CoefficientName(name).axis, []).append(k)
    return [_axis_figure(found, places, f"axis{n}") for n, places in enumerate(groups.values())]


@drawing.style
def _axis_figure(found: ControlCharts, places: list[int], name: str) -> Markup:
    figure, panels = drawing.grid(_HEIGHT, _LABEL_ROOM, len(places), _COLUMNS)
    times, of_days, values, limits = _times(found), found.days, found.values, found.limits
    for axes, k in zip(panels, places, strict=True):
        variance = of_days.point[:, k, k] + of_days.reference[:, k, k]
        first = (of_days.difference[:, k] / np.sqrt(variance))[: found.reference_days]
        z, lasting = values.shewhart[:, k], values.lasting[:, k]
        limit, of_lasting = limits.shewhart[k] ** 0.5, limits.lasting[k] ** 0.5
        beyond = (np.abs(z) > limit) | (np.abs(lasting) > of_lasting)
        _draw_chart(axes, times, (first, z, lasting), beyond, (limit, of_lasting))
        axes.set_title(f"{found.names[k]}, standard deviations")
    names = ", ".join(found.names[k] for k in places)
    return svg(figure, name, f"Shewhart and {found.limits.lasting_kind} charts of {names}")


def _bench(found: BenchCharts) -> dict[str, Any]:
    """Return the values for the page of a bench."""
    return {
        "bench": found.bench,
        "runs": len(found.runs),
        "first": chart_texts.day(found.runs[0].measured),
        "last": chart_texts.day(found.runs[-1].measured),
        "figure": _bench_figure(found),
        "lasting": _LASTING_WORDS[found.lasting_kind],
        "parameters": [
            tuple(map(typeset_minus, row)) for row in chart_texts.newest_statistics(found)
        ],
        "signals": chart_texts.day_signals(found),
    }


@drawing.style
def _bench_figure(found: BenchCharts) -> Markup:
    figure, panels = drawing.grid(_HEIGHT, _LABEL_ROOM, len(found.charts), _COLUMNS)
    for axes, one in zip(panels, found.charts, strict=True):
        at, m = np.array([drawing.days(time) for time in one.days]), one.reference_days
        beyond = np.array([bool(one.signals(k)) for k in range(m, len(at))], dtype=bool)
        values = one.shewhart[:m], one.shewhart[m:], one.lasting[m:]
        _draw_chart(axes, at, values, beyond, (one.shewhart_limit, one.lasting_limit))
        axes.set_title(f"{one.name}, standard deviations")
    names = ", ".join(one.name for one in found.charts)
    return svg(figure, "parameters", f"Shewhart and {found.lasting_kind} charts of {names}")


def _draw_chart(
    axes: Axes,
    times: Array,
    values: tuple[Array, Array, Array],
    beyond: NDArray[np.bool_],
    limits: tuple[float, float],
) -> None:
    """Draw the control chart for one quantity.

    Parameters
    ----------
    axes : Axes
    times : (n,) array
        Days since 1970.
    values : three arrays
        Values on the reference days, values on the other days, and the statistic that detects a
        lasting change.
    beyond : array of bool
        Whether each day has a signal.
    limits : (float, float)
        Limits for a single day and for a lasting change.
    """
    first, z, lasting = values
    m = len(first)
    axes.axvspan(times[0], times[m - 1], color=BAND, lw=0)
    axes.plot(times[:m], first, "o", ms=2.6, mfc=PAPER, mec=MUTED, mew=0.8)
    axes.plot(times[m:], lasting, "-", color=Z, lw=1.1)
    _draw_points(axes, times[m:], z, beyond)
    for sign in (-1, 1):
        axes.axhline(sign * limits[0], color=WARN, lw=0.9, ls="--")
        axes.axhline(sign * limits[1], color=Z, lw=0.7, ls=":")
    drawing.name_dates(axes, _FORMATS, _FORMATS)


def _draw_points(axes: Axes, at: Array, values: Array, beyond: NDArray[np.bool_]) -> None:
    """Draw the points of a chart; points beyond a limit are diamonds."""
    axes.plot(at[~beyond], values[~beyond], "o", ms=3.0, mfc=INK, mec=INK, mew=0)
    # These points are open and larger diamonds, which can be recognised without colour.
    axes.plot(at[beyond], values[beyond], "D", ms=5.0, mfc=PAPER, mec=WARN, mew=1.4, zorder=3)
    axes.grid(axis="y", color=FAINT, lw=0.3)
    axes.set_axisbelow(True)
