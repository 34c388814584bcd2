"""How a search went, generation by generation: the sum of squares, and the error with its goal."""
# matplotlib's stubs leave **kwargs untyped.
# pyright: reportUnknownMemberType=false

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter

from inercal.methods.ship_multi_angle.global_search import SearchHistory
from inercal.report import drawing
from inercal.report.drawing import INK, MUTED, PAPER, WARN, Y, svg


@drawing.style
def search_figure(search: SearchHistory) -> Markup:
    """Return the best member after each generation, as in Fig. 6 of the source of the search."""
    number = np.array([g.number for g in search.generations])
    cost = np.array([g.cost for g in search.generations])
    worst = 100 * np.array([g.worst for g in search.generations])
    figure, rows = drawing.panels(1.9, [0.45], 2)
    left, right = rows[0]
    mark = "." if number.size == 1 else ""  # time may end a search at once
    left.plot(number, cost, marker=mark, color=INK, lw=1.1)
    left.set_ylabel("sum of squares, g⁴")
    right.plot(number, worst, marker=mark, color=INK, lw=1.1)
    right.set_ylabel("largest error of a norm, %")
    right.axhline(100 * search.goal, color=WARN, lw=0.9, ls="--",
                  label=f"goal {100 * search.goal:.3g} %")  # fmt: skip
    if search.goal_generation is not None:
        right.plot(search.goal_generation, worst[search.goal_generation - 1], "o", ms=6,
                   mfc=Y, mec=PAPER, mew=0.6, ls="none",
                   label=f"met at generation {search.goal_generation}")  # fmt: skip
    for axes in (left, right):
        _set_logarithmic_axis(axes)
        axes.set_xlabel("generation")
    drawing.add_legend(right)
    return svg(figure, "history", "Sum of squares and largest error of a norm by generation")


def _set_logarithmic_axis(axes: Axes) -> None:
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=8))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.grid(axis="y", color=MUTED, lw=0.2)
    axes.set_axisbelow(True)
