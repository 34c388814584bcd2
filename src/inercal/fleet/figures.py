"""Draw the figures for a fleet: histograms, running quantiles and control charts.

The size of the figures does not grow with the number of sensors.
"""
# matplotlib's stubs leave **kwargs untyped.
# pyright: reportUnknownMemberType=false

from collections.abc import Sequence
from datetime import UTC, datetime

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.dates import ConciseDateFormatter
from matplotlib.ticker import MaxNLocator

from inercal.basics.arrays import Array
from inercal.basics.units import format_count
from inercal.fleet.control_chart import ControlChart
from inercal.fleet.statistics import CoefficientStatistics, FleetStatistics
from inercal.report import drawing
from inercal.report.drawing import BAND, FAINT, INK, MUTED, PAPER, WARN, Z, svg

_HEIGHT, _BELOW = 1.25, 0.42  # inches
_BINS, _FEWEST_BINS, _POINTS = 60, 8, 100
_FEW = 500  # largest number of sensors drawn as points
_TAILS = 0.001  # share of sensors outside a histogram's range, on each side
_NEAR = 2.0  # limits within this many widths of the range are shown
_BANDS = (5, 25, 50, 75, 95)  # percent
_LAST_TICK = 0.96  # fraction of the axis; the page would cut off a number farther right
_LEAST_TIME = 0.5  # days


@drawing.style
def distribution_figure(
    found: FleetStatistics, chosen: Sequence[CoefficientStatistics], name: str
) -> Markup:
    """Return a figure with each coefficient's histogram and its quantiles in serial order.

    Parameters
    ----------
    found : FleetStatistics
    chosen : sequence of CoefficientStatistics
        The coefficients; each has one row of the figure.
    name : str
        Name of the figure; each figure on a page needs a different name.
    """
    below = [_BELOW] * len(chosen)
    figure, rows = drawing.panels(_HEIGHT, below, 2)
    population = found.population
    for one, (left, right) in zip(chosen, rows, strict=True):
        k = population.names.index(one.name)
        term = population.terms[k]
        value = population.value[:, k] / term.si
        limits = () if one.limits is None else tuple(limit / term.si for limit in one.limits)
        _draw_histogram(left, value, limits)
        truth = one.components.within.sd, one.components.lots
        sd = float(np.hypot(truth[0], 0.0 if truth[1] is None else truth[1].sd)) / term.si
        _draw_normal(left, value.size, one.components.mean / term.si, sd)
        left.set_title(f"{one.name}, {term.unit}")
        _draw_quantiles(right, value, limits)
        right.set_title(f"{one.name}, {term.unit}, in serial order")
    names = ", ".join(one.name for one in chosen)
    return svg(figure, name, f"Distribution and quantiles in serial order of {names}")


def _draw_histogram(axes: Axes, value: Array, limits: Sequence[float]) -> None:
    low, high = np.quantile(value, (_TAILS, 1 - _TAILS))
    width = high - low or 1.0
    near = [x for x in limits if low - _NEAR * width < x < high + _NEAR * width]
    low, high = min([low, *near]) - 0.03 * width, max([high, *near]) + 0.03 * width
    counts, edges = np.histogram(value, _bins(value.size), (low, high))
    axes.stairs(counts, edges, fill=True, color=FAINT, lw=0)
    for limit in near:
        axes.axvline(limit, color=WARN, lw=1.0, ls="--")
    axes.set_xlim(low, high)
    axes.xaxis.set_major_locator(MaxNLocator(5, prune="both"))
    axes.set_yticks([])


def _bins(n: int) -> int:
    return min(max(round(2 * np.sqrt(n)), _FEWEST_BINS), _BINS)


def _draw_normal(axes: Axes, n: int, mean: float, sd: float) -> None:
    """Draw the normal distribution of the true values over a histogram of n values."""
    low, high = axes.get_xlim()
    if sd <= 0:
        return
    at = np.linspace(low, high, 200)
    density = np.exp(-0.5 * ((at - mean) / sd) ** 2) / (sd * np.sqrt(2 * np.pi))
    axes.plot(at, n * density * (high - low) / _bins(n), color=Z, lw=1.1)
    axes.set_ylim(0, None)


def _draw_quantiles(axes: Axes, value: Array, limits: Sequence[float]) -> None:
    if value.size <= _FEW:
        axes.plot(np.arange(value.size) + 1, value, "o", ms=2.6, mfc=INK, mec=INK, mew=0)
    parts = np.array_split(np.arange(value.size), min(_POINTS, max(value.size // 5, 1)))
    at = [float(part.mean()) + 1 for part in parts]
    table = np.array([np.percentile(value[part], _BANDS) for part in parts]).T
    axes.fill_between(at, table[0], table[4], color=BAND, lw=0)
    axes.fill_between(at, table[1], table[3], color=FAINT, lw=0)
    axes.plot(at, table[2], color=INK, lw=1.0)
    # A point dominated by outliers would compress the scale for all other points.
    low, high = np.percentile(table[0], 2), np.percentile(table[4], 98)
    width = float(high - low) or 1.0
    near = [x for x in limits if low - _NEAR * width < x < high + _NEAR * width]
    for limit in near:
        axes.axhline(limit, color=WARN, lw=1.0, ls="--")
    axes.set_ylim(min([low, *near]) - 0.15 * width, max([high, *near]) + 0.15 * width)
    axes.set_xlim(0.5, value.size + 0.5)
    ticks = MaxNLocator(5, integer=True).tick_values(1, value.size)
    shown = [int(tick) for tick in ticks if 0 < tick < _LAST_TICK * value.size]
    axes.set_xticks(shown, [str(tick) for tick in shown])


@drawing.style
def control_figure(centre: float, charts: Sequence[ControlChart], name: str, timed: bool) -> Markup:
    """Return the figure of the control charts, with one panel for each station.

    Parameters
    ----------
    centre : float
    charts : sequence of ControlChart
    name : str
    timed : bool
        Whether the points have times, in days since 1970. If not, they have serial numbers.
    """
    lines = -(-len(charts) // 2)
    figure, rows = drawing.panels(_HEIGHT, [_BELOW] * lines, 2)
    panels = [axes for row in rows for axes in row]
    for axes, chart in zip(panels, charts, strict=False):
        _draw_chart(axes, centre, chart)
        if timed:
            locator = drawing.date_ticks()
            axes.xaxis.set_major_locator(locator)
            axes.xaxis.set_major_formatter(ConciseDateFormatter(locator, show_offset=False))
    for axes in panels[len(charts) :]:
        axes.set_axis_off()
    return svg(figure, name, "χ²/ν of the residuals over time, one panel for each station")


def _draw_chart(axes: Axes, centre: float, chart: ControlChart) -> None:
    axes.fill_between(chart.at, chart.low, chart.high, color=BAND, lw=0, step="mid")
    axes.axhline(centre, color=MUTED, lw=0.8)
    beyond = (chart.ratio < chart.low) | (chart.ratio > chart.high)
    axes.plot(chart.at, chart.ratio, "-", color=FAINT, lw=0.6)
    axes.plot(chart.at[~beyond], chart.ratio[~beyond], "o", ms=2.6, mfc=INK, mec=INK, mew=0)
    axes.plot(chart.at[beyond], chart.ratio[beyond], "D", ms=5.0, mfc=PAPER, mec=WARN, mew=1.3)
    first, last = float(chart.at[0]), float(chart.at[-1])
    margin = max(0.03 * (last - first), _LEAST_TIME)
    axes.set_xlim(first - margin, last + margin)
    title = chart.station or "all stations"
    axes.set_title(
        f"{title}: {chart.beyond} of {format_count(len(chart.ratio), 'point')} beyond the limits"
    )


def date_text(days: float) -> str:
    """Return a time in days since 1970 as a date."""
    return datetime.fromtimestamp(days * 86_400, UTC).date().isoformat()
