"""Drawing of the plots that a kind of bench gives as data."""
# matplotlib's stubs leave **kwargs untyped.
# pyright: reportUnknownMemberType=false

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes

from inercal.benches.report_data import Plot, Series
from inercal.calibration.verdict import COVERAGE
from inercal.report import drawing
from inercal.report.drawing import AXES, FAINT, MUTED, PAPER, SHAPES, svg

_X_MARGIN = 12.0  # of the ticks' unit, at both ends


@drawing.style
def draw_plot(plot: Plot) -> Markup | None:
    """Return a plot as SVG; None of one without panels."""
    if not plot.panels:
        return None
    several = len(plot.panels) > 1
    figure, (row,) = drawing.panels(1.9 if several else 2.0, [0.45], len(plot.panels))
    reach = 1.15 * max(float(np.abs(one.y).max()) for panel in plot.panels for one in panel.series)
    for k, (axes, panel) in enumerate(zip(row, plot.panels, strict=True)):
        axes.axhline(0, color=FAINT, lw=0.8, zorder=0)
        for j, series in enumerate(panel.series):
            _draw_series(axes, series, k if several else j)
        if several:
            axes.set_ylim(-reach, reach)
        if panel.ticks:
            axes.set_xlim(panel.ticks[0] - _X_MARGIN, panel.ticks[-1] + _X_MARGIN)
            axes.set_xticks(panel.ticks)
        axes.set_title(panel.title)
        axes.set_xlabel(panel.x)
        drawing.add_legend(axes)
    row[0].set_ylabel(plot.y)
    return svg(figure, plot.name, plot.title)


def _draw_series(axes: Axes, series: Series, k: int) -> None:
    if series.hollow:
        axes.plot(series.x, series.y, "o", ms=4.5, mfc="none", mec=MUTED, mew=0.8, ls="none",
                  label=series.name)  # fmt: skip
        return
    error = None if series.sd is None else COVERAGE * series.sd
    axes.errorbar(series.x, series.y, yerr=error, fmt=SHAPES[k % 3], ms=4.5, mfc=AXES[k % 3],
                  mec=PAPER, mew=0.4, ecolor=AXES[k % 3], elinewidth=0.8,
                  label=series.name)  # fmt: skip
