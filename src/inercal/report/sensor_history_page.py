"""HTML pages with the history and the noise of a sensor, and the same content as sections."""
# matplotlib's stubs leave **kwargs untyped.
# pyright: reportUnknownMemberType=false

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes

from inercal.basics.arrays import Array
from inercal.basics.keys import CoefficientName
from inercal.calibration.comparison.changes import YEAR, TrendVerdict
from inercal.calibration.comparison.run_to_run import format_en
from inercal.calibration.suspect_text import p_value_text
from inercal.estimation.uncertainty import COVERAGE
from inercal.laboratory.check_standard.chart_texts import day
from inercal.laboratory.store import SensorHistory, history_text
from inercal.laboratory.store.entries import SensorEntry
from inercal.laboratory.store.history import CoefficientTrend
from inercal.laboratory.store.history_text import change_lines, trend_rows
from inercal.laboratory.store.noise_history import NoiseEntry, NoiseTrend, noise_trends
from inercal.laboratory.store.recalibration import Recalibration, recalibration
from inercal.report import drawing
from inercal.report.drawing import BAND, FAINT, INK, MUTED, PAPER, WARN, X, Y, Z, svg
from inercal.report.report_tables import sentence_with_index, typeset_minus
from inercal.report.templates import render

_COLUMNS = 2
_COLOURS = (X, Y, Z, INK, MUTED, WARN)
_SHIFT = 0.006  # offset between channels, as a fraction of the time shown


def noise_history_section(entries: Sequence[NoiseEntry]) -> Markup:
    """Return the section as HTML; it is empty if there are no analyses."""
    if not entries:
        return Markup("")
    trends = noise_trends(tuple(entries))
    return Markup(
        render(
            "noise_history_section.html",
            rows=[tuple(map(typeset_minus, row)) for row in trend_rows(trends)],
            lines=[sentence_with_index(line) for line in change_lines(trends)],
            entries=[
                (str(one.id), day(one.measured), one.source, f"{one.duration:.4g}", one.by)
                for one in entries
            ],
            figure=noise_trend_figure(trends),
        )
    )


def noise_history_page(sensor: SensorEntry, entries: Sequence[NoiseEntry]) -> str:
    """Return the HTML page for a sensor with at least one noise analysis but no calibrations."""
    return render(
        "sensor_noise.html",
        sensor=sensor,
        count=len(entries),
        first=day(entries[0].measured),
        last=day(entries[-1].measured),
        section=noise_history_section(entries),
    )


@drawing.style
def noise_trend_figure(trends: Sequence[NoiseTrend]) -> Markup:
    """Return the figure of the coefficients over time, with a panel for each symbol and unit."""
    groups: dict[tuple[str, str], list[NoiseTrend]] = {}
    for one in trends:
        groups.setdefault((one.symbol, one.unit), []).append(one)
    figure, panels = drawing.grid(1.3, 0.4, len(groups), _COLUMNS)
    for axes, ((symbol, unit), found) in zip(panels, groups.items(), strict=True):
        _draw(axes, found)
        axes.set_title(f"{symbol}, {unit}")
    return svg(figure, "noise-over-time", "Coefficients of the noise over time, with U")


def _draw(axes: Axes, found: Sequence[NoiseTrend]) -> None:
    times = [np.array([drawing.days(entry.measured) for entry in one.entries]) for one in found]
    first, last = min(map(min, times)), max(map(max, times))
    span = max(last - first, 60.0)
    for k, (one, colour) in enumerate(zip(found, _COLOURS * len(found), strict=False)):
        shift = _SHIFT * span * (k - (len(found) - 1) / 2)
        time = times[k]
        size = one.values[0].size
        limit = np.array([value.is_limit for value in one.values])
        value = np.array([v.high if v.is_limit else v.value for v in one.values]) / size
        reach = np.array([COVERAGE * v.u if isfinite(v.u) else 0.0 for v in one.values]) / size
        axes.errorbar(time + shift, value, reach, fmt="none", ecolor=MUTED, elinewidth=0.9)
        axes.plot(time[~limit] + shift, value[~limit], "o", ms=3.6, color=colour, label=one.channel)
        axes.plot(time[limit] + shift, value[limit], "v", ms=4.5, mfc="none", mec=colour)
    axes.set_xlim(first - 0.5 * span, last + 0.5 * span)
    axes.set_ylim(bottom=0)
    axes.grid(axis="y", color=FAINT, lw=0.3)
    drawing.name_dates(axes)
    drawing.add_legend(axes)


def recalibration_section(found: Recalibration) -> Markup:
    """Return the table of calibration intervals and the conclusions from it, as HTML."""
    heads, cells = history_text.interval_table(found)
    rows = [
        (one.name, typeset_minus(history_text.limit_text(found, one)), *row)
        for one, row in zip(found.rows, cells, strict=True)
    ]
    lines = [f"{line[0].upper()}{line[1:]}." for line in history_text.recalibration_lines(found)]
    return Markup(render("recalibration.html", heads=heads, rows=rows, lines=lines))


_VERDICT_WORDS: dict[TrendVerdict, str] = {
    "drifts": "drifting",
    "changed": "changed",
    "steady": "steady",
}
_HEIGHT, _LABEL_ROOM = 1.3, 0.4  # inches
_TIME_MARGIN = 0.04  # fraction of the time shown
_LARGEST_MARGIN = 30.0  # days added on both sides of a short time, which keep points apart
# Formats for ticks one year, one month, … apart, and for ticks at the start of a longer unit.
_FORMATS = ["%Y", "%Y-%m", "%d", "%H:%M", "%H:%M", "%S"]
_ZERO_FORMATS = ["", "%Y", "%Y-%m", "%m-%d", "%H:%M", "%H:%M"]
_YEAR = YEAR / 86_400.0  # days


@dataclass(frozen=True)
class AxisHistory:
    """History of one axis: rows for its coefficients, a figure and a table of all calibrations."""

    axis: str
    rows: list[dict[str, str]]
    figure: Markup
    heads: tuple[str, ...]
    cells: tuple[tuple[str, ...], ...]


def sensor_history_page(
    history: SensorHistory, next_one: Recalibration | None = None, noise: Sequence[NoiseEntry] = ()
) -> str:
    """Return the page as HTML; by default, the newest calibration states the limits."""
    groups, lines = _axis_histories(history), summary_lines(history)
    return render(
        "over_time.html",
        history=history,
        first=day(history.entries[0].measured),
        last=day(history.entries[-1].measured),
        tone="good" if set(history.verdicts) <= {"steady", "too few"} else "care",
        summary=lines[0],
        lines=lines[1:],
        section=_render_section(groups),
        groups=groups,
        recalibration=recalibration_section(next_one or recalibration(history)),
        entries=_entry_rows(history),
        noise=noise_history_section(noise),
    )


def history_section(history: SensorHistory) -> Markup:
    """Return the figures and the table of verdicts as HTML."""
    return _render_section(_axis_histories(history))


def summary_lines(history: SensorHistory) -> list[Markup]:
    """Return the conclusions from a history as sentences, beginning with the summary."""
    named = [
        f"{word}: {', '.join(names)}"
        for verdict, word in _VERDICT_WORDS.items()
        if verdict != "steady" and (names := history.verdicts.get(verdict, ()))
    ]
    return [
        sentence_with_index(line)
        for line in (_verdict_counts(history), *named, *history_text.history_lines(history))
    ]


def _render_section(groups: list[AxisHistory]) -> Markup:
    return Markup(
        render("over_time_section.html", groups=groups)
    )  # escaped, because the text goes into a template


def _verdict_counts(history: SensorHistory) -> str:
    counts = [
        f"{len(names)} {word}"
        for verdict, word in _VERDICT_WORDS.items()
        if (names := history.verdicts.get(verdict, ()))
    ]
    return (
        f"coefficients: {', '.join(counts)}"
        if counts
        else ("there is only one calibration, so nothing can be compared")
    )


def _axis_histories(history: SensorHistory) -> list[AxisHistory]:
    by_axis: dict[str, list[CoefficientTrend]] = {}
    for trend in history.trends:
        by_axis.setdefault(CoefficientName(trend.name).axis, []).append(trend)
    return [
        AxisHistory(
            axis,
            [_coefficient_row(one) for one in found],
            trend_figure(history, found, f"axis{k}"),
            tuple(f"{CoefficientName(one.name).term}\n{one.unit}" for one in found),
            tuple(
                (f"#{entry.id}", day(entry.measured), *(_cell(one, place) for one in found))
                for place, entry in enumerate(history.entries)
            ),
        )
        for k, (axis, found) in enumerate(by_axis.items())
    ]


def _coefficient_row(trend: CoefficientTrend) -> dict[str, str]:
    """Return the table cells for one coefficient: newest value, E_n, U, drift and verdict."""
    value, expanded = history_text.format_point(trend, -1)
    mean_expanded, next_use_expanded = history_text.format_bands(trend)
    slope, slope_expanded = history_text.format_slope(trend)
    return {
        "name": trend.name,
        "meaning": trend.meaning,
        "value": typeset_minus(value),
        "expanded": expanded,
        "unit": trend.unit,
        "en": typeset_minus(format_en(float(trend.normalised_errors[-1]))),
        "mean_expanded": mean_expanded,
        "next_use_expanded": next_use_expanded,
        "slope": typeset_minus(slope),
        "slope_expanded": slope_expanded,
        "verdict": trend.verdict,
        "words": typeset_minus(history_text.drift_text(trend)),
    }


def _cell(trend: CoefficientTrend, place: int) -> str:
    if place not in trend.points:
        return ""
    k = trend.points.index(place)
    star = " *" if abs(trend.normalised_errors[k]) > 1 else ""
    return typeset_minus(" ± ".join(history_text.format_point(trend, k))) + star


def _entry_rows(history: SensorHistory) -> list[tuple[str, ...]]:
    """Return the table rows for the entries: number, date, method, bench, run, person, p-value."""
    return [
        (
            f"#{entry.id}",
            day(entry.measured),
            f"{entry.method}, {entry.estimator}",
            f"{entry.bench} ({entry.kind})" if entry.bench and entry.kind else entry.kind,
            "" if entry.run is None else str(entry.run),
            entry.by,
            "" if joint is None else p_value_text(joint.p_value).removeprefix("= "),
        )
        for entry, joint in zip(history.entries, history.joint_test, strict=True)
    ]


@drawing.style
def trend_figure(history: SensorHistory, found: Sequence[CoefficientTrend], name: str) -> Markup:
    """Return the figure of one axis's trends, with one panel for each coefficient.

    Parameters
    ----------
    history : SensorHistory
    found : sequence of CoefficientTrend
    name : str
        Name of the figure; each figure on a page needs a different name.
    """
    figure, panels = drawing.grid(_HEIGHT, _LABEL_ROOM, len(found), _COLUMNS)
    first, last = (drawing.days(history.entries[k].measured) for k in (0, -1))
    span = last - first
    margin = max(_TIME_MARGIN * span, min(span, _LARGEST_MARGIN)) if span else _LARGEST_MARGIN
    for axes, trend in zip(panels, found, strict=True):
        _draw_trend(axes, trend, first)
        axes.set_xlim(first - margin, last + margin)
        drawing.name_dates(axes, _FORMATS, _ZERO_FORMATS)
    text = "; ".join(f"{one.name} {one.verdict}" for one in found)
    return svg(figure, name, f"Coefficients over time with expanded uncertainties: {text}")


def _draw_trend(axes: Axes, trend: CoefficientTrend, first: float) -> None:
    time = first + trend.time * _YEAR
    value, reach = trend.values / trend.si, COVERAGE * trend.std / trend.si
    if (course := trend.course) is not None:
        at: Array = np.linspace(float(trend.time[0]), float(trend.time[-1]), 50)
        days, middle = first + at * _YEAR, course.evaluate(at) / trend.si
        for next_use, shade in ((True, BAND), (False, FAINT)):
            u = course.expanded(at, next_use=next_use) / trend.si
            axes.fill_between(days, middle - u, middle + u, color=shade, lw=0)
        axes.plot(days, middle, "-" if len(course.beta) > 1 else "--", color=Z, lw=1.1)
    axes.errorbar(time, value, reach, fmt="none", ecolor=MUTED, elinewidth=0.9, capsize=2.2)
    beyond = np.abs(trend.normalised_errors) > 1
    axes.plot(time[~beyond], value[~beyond], "o", ms=4.2, mfc=INK, mec=PAPER, mew=0.6)
    # This mark is open, larger and of a different shape, so it can be recognised without colour.
    axes.plot(time[beyond], value[beyond], "D", ms=6.0, mfc=PAPER, mec=WARN, mew=1.5, zorder=3)
    axes.grid(axis="y", color=FAINT, lw=0.3)
    axes.set_axisbelow(True)
    axes.set_title(f"{trend.name}, {trend.unit}: {trend.verdict}")
