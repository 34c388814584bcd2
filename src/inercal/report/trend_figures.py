"""Coefficients over time: values with ±U, the straight line through them, and what stands out."""
# matplotlib's stubs leave **kwargs untyped.
# pyright: reportUnknownMemberType=false

from collections.abc import Sequence
from datetime import datetime

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter

from inercal.arrays import Array
from inercal.calibration.verdict import COVERAGE
from inercal.report import drawing
from inercal.report.drawing import BAND, FAINT, INK, MUTED, PAPER, WARN, Z, svg
from inercal.store import SensorHistory
from inercal.store.changes import YEAR
from inercal.store.history import CoefficientTrend

_HEIGHT, _LABEL_ROOM = 1.3, 0.4  # inches
_COLUMNS = 2
_TIME_MARGIN = 0.04  # of the time that is shown
_MIN_MARGIN = 30.0  # days to both sides
# Of ticks a year, a month, … apart, and of those at the begin of a longer such time.
_FORMATS = ["%Y", "%Y-%m", "%d", "%H:%M", "%H:%M", "%S"]
_ZERO_FORMATS = ["", "%Y", "%Y-%m", "%m-%d", "%H:%M", "%H:%M"]
_DAY = 86_400.0  # s; times of a figure are in days since 1970
_YEAR = YEAR / _DAY


@drawing.style
def trend_figure(history: SensorHistory, found: Sequence[CoefficientTrend], name: str) -> Markup:
    """Return the courses of one axis, one panel each.

    Parameters
    ----------
    history : SensorHistory
    found : sequence of CoefficientTrend
    name : str
        Of the figure; another one of the page has another name.
    """
    lines = -(-len(found) // _COLUMNS)
    figure, rows = drawing.panels(_HEIGHT, [_LABEL_ROOM] * lines, _COLUMNS)
    panels = [axes for row in rows for axes in row]
    times = (datetime.fromisoformat(history.entries[k].measured) for k in (0, -1))
    first, last = (time.timestamp() / _DAY for time in times)
    margin = max(_TIME_MARGIN * (last - first), _MIN_MARGIN)
    for axes, course in zip(panels, found, strict=False):
        _draw_trend(axes, course, first)
        axes.set_xlim(first - margin, last + margin)
        locator = AutoDateLocator(minticks=3, maxticks=6)
        axes.xaxis.set_major_locator(locator)
        formatter = ConciseDateFormatter(
            locator, formats=_FORMATS, zero_formats=_ZERO_FORMATS, show_offset=False
        )
        axes.xaxis.set_major_formatter(formatter)
    for axes in panels[len(found) :]:
        axes.set_axis_off()
    text = "; ".join(f"{one.name} {one.verdict}" for one in found)
    return svg(figure, name, f"Coefficients over time with expanded uncertainties: {text}")


def _draw_trend(axes: Axes, course: CoefficientTrend, first: float) -> None:
    time = first + course.time * _YEAR
    value, reach = course.values / course.si, COVERAGE * course.std / course.si
    if (line := course.line) is not None:
        at: Array = np.linspace(float(course.time[0]), float(course.time[-1]), 50)
        middle, std = (one / course.si for one in line.evaluate(at))
        days = first + at * _YEAR
        axes.fill_between(days, middle - COVERAGE * std, middle + COVERAGE * std, color=BAND, lw=0)
        axes.plot(days, middle, "-" if line.drifts else "--", color=Z, lw=1.1)
    axes.errorbar(time, value, reach, fmt="none", ecolor=MUTED, elinewidth=0.9, capsize=2.2)
    beyond = np.abs(course.normalised_errors) > 1
    axes.plot(time[~beyond], value[~beyond], "o", ms=3.6, mfc=INK, mec=INK, mew=0)
    # Another shape, open and larger: to be told without colour too.
    axes.plot(time[beyond], value[beyond], "D", ms=6.0, mfc=PAPER, mec=WARN, mew=1.5, zorder=3)
    axes.grid(axis="y", color=FAINT, lw=0.3)
    axes.set_axisbelow(True)
    axes.set_title(f"{course.name}, {course.unit}: {course.verdict}")
