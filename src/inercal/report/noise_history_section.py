"""Show the noise of a sensor over time, in its history page or on a separate page."""
# matplotlib's stubs leave **kwargs untyped.
# pyright: reportUnknownMemberType=false

from collections.abc import Sequence
from math import isfinite

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes

from inercal.estimation.uncertainty import COVERAGE
from inercal.laboratory.check_standard.chart_texts import day
from inercal.laboratory.store.entries import SensorEntry
from inercal.laboratory.store.history_text import change_lines, trend_rows
from inercal.laboratory.store.noise_history import NoiseEntry, NoiseTrend, noise_trends
from inercal.report import drawing
from inercal.report.drawing import FAINT, INK, MUTED, WARN, X, Y, Z, svg
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
