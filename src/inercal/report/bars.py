"""The contributions to each coefficient, drawn as bars."""
# matplotlib's stubs leave **kwargs untyped.
# pyright: reportUnknownMemberType=false

from collections.abc import Sequence

from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from inercal.budget.contribution_table import BudgetRow
from inercal.report import drawing
from inercal.report.drawing import FAINT, INK, MINUS, MUTED, PAPER

_COLOURS = {"line": MINUS, "others": FAINT, "total": MUTED}
_WIDTH, _COLUMNS = 9.0, 2
_BAR_HEIGHT, _TITLE_HEIGHT = 0.17, 0.34  # inches
_MIN_SHARE = 1e-4  # of the variance: a hundredth of the length
_NAME_WIDTH, _NUMBER_WIDTH = 1.5, 0.55  # inches, left and right of the bars


@drawing.style
def contribution_bars(panels: Sequence[tuple[str, Sequence[BudgetRow]]]) -> Markup:
    """Return one panel a coefficient: its title, and bars in the order of its rows.

    Bars are by Monte Carlo; a dot is the contribution to first order.
    """
    drawn = [(title, [row for row in rows if _is_visible(row)]) for title, rows in panels]
    lines = [drawn[k : k + _COLUMNS] for k in range(0, len(drawn), _COLUMNS)]
    heights = [_BAR_HEIGHT * max(len(rows) for _, rows in line) for line in lines]
    total = sum(heights) + _TITLE_HEIGHT * len(lines)
    figure = Figure(figsize=(_WIDTH, total))
    each, foot = _WIDTH / _COLUMNS, total
    for line, height in zip(lines, heights, strict=True):
        foot -= _TITLE_HEIGHT + height
        for column, (title, rows) in enumerate(line):
            own = _BAR_HEIGHT * len(rows)
            left, width = column * each + _NAME_WIDTH, each - _NAME_WIDTH - _NUMBER_WIDTH
            box = (left / _WIDTH, (foot + height - own) / total, width / _WIDTH, own / total)
            _draw_panel(figure.add_axes(box), title, rows)
    return drawing.svg(figure, "contributions", "Contributions to each coefficient, largest first")


def _is_visible(row: BudgetRow) -> bool:
    """Whether a row is worth a bar: what is small together may be nothing at all."""
    return row.kind != "others" or row.share > _MIN_SHARE


def _draw_panel(axes: Axes, title: str, rows: Sequence[BudgetRow]) -> None:
    places = range(len(rows))
    largest = max(max(row.size, row.linear) for row in rows) or 1.0
    sizes = [row.size / largest for row in rows]
    axes.barh(places, sizes, height=0.7, color=[_COLOURS[row.kind] for row in rows])
    # On paper's colour, so that a dot within its bar is seen.
    axes.plot([row.linear / largest for row in rows], places, "o", ms=3.6, mfc=INK, mec=PAPER,
              mew=0.6, clip_on=False, zorder=3)  # fmt: skip
    axes.set_xlim(0, 1)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_xticks([])
    axes.set_yticks(places, [row.name for row in rows])
    axes.tick_params(axis="y", length=0)
    axes.spines["bottom"].set_visible(False)
    for place, row, size in zip(places, rows, sizes, strict=True):
        end = max(size, row.linear / largest)
        axes.text(end + 0.03, place, row.monte_carlo, va="center", color=INK, size=7)
    axes.set_title(title, x=0, pad=4)
