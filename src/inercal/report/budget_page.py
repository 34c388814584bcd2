"""HTML page for an error budget, with tables and bars for the contributions."""
# matplotlib's stubs leave **kwargs untyped.
# pyright: reportUnknownMemberType=false

from collections.abc import Sequence
from typing import Any

from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from inercal.pipeline.budget import Budget
from inercal.pipeline.budget.contribution_table import (
    BudgetRow,
    contribution_rows,
    shift_cells,
    uncertainty_and_bias_cells,
)
from inercal.report import drawing
from inercal.report.drawing import FAINT, INK, MINUS, MUTED, PAPER
from inercal.report.report_tables import typeset_minus
from inercal.report.templates import render

_COLOURS = {"line": MINUS, "others": FAINT, "total": MUTED}
_WIDTH, _COLUMNS = 9.0, 2
_BAR_HEIGHT, _TITLE_HEIGHT = 0.17, 0.34  # inches
_MIN_SHARE = 1e-4  # smallest share of the variance, a bar of 1/100 of the length
_NAME_WIDTH, _NUMBER_WIDTH = 1.5, 0.55  # inches, margins left and right of the bars


def budget_page(budget: Budget, under: str) -> str:
    """Return the page as HTML, with the text `under` below the sensor's name."""
    sensor = budget.experiment.sensor
    parts = [_coefficient_budget(budget, k, name) for k, name in enumerate(sensor.coefficients)]
    return render(
        "budget.html",
        sensor=sensor,
        under=under,
        budget=budget,
        parts=parts,
        figure=contribution_bars(
            [(f"{part['name']}, {part['unit']}", part["rows"]) for part in parts]
        ),
        relative=f"{100 / (2 * budget.trials) ** 0.5:.2g}",
    )


def _coefficient_budget(budget: Budget, k: int, name: str) -> dict[str, Any]:
    """Return the values to show for one coefficient; the last row of the table is the total."""
    line, rows = budget.experiment.sensor.coefficient(name), contribution_rows(budget, k)
    stated, bias, error = uncertainty_and_bias_cells(budget, k)
    return {
        "name": name,
        "meaning": line.meaning,
        "unit": line.unit,
        "rows": rows,
        "largest": rows[0],
        "total": rows[-1],
        "stated": stated,
        "bias": typeset_minus(bias),
        "bias_error": error,
        "shifts": [typeset_minus(cell) for cell in shift_cells(budget, k)],
    }


@drawing.style
def contribution_bars(panels: Sequence[tuple[str, Sequence[BudgetRow]]]) -> Markup:
    """Return a figure with one panel for each coefficient and one bar for each contribution.

    Bars are Monte Carlo results; dots are first-order contributions.
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
    """Return whether a row gets a bar; the row of small contributions may be negligible."""
    return row.kind != "others" or row.share > _MIN_SHARE


def _draw_panel(axes: Axes, title: str, rows: Sequence[BudgetRow]) -> None:
    places = range(len(rows))
    largest = max(max(row.size, row.linear) for row in rows) or 1.0
    sizes = [row.size / largest for row in rows]
    axes.barh(places, sizes, height=0.7, color=[_COLOURS[row.kind] for row in rows])
    # The edge has the colour of the paper, because a dot inside its bar would otherwise be
    # invisible.
    axes.plot([row.linear / largest for row in rows], places, "o", ms=3.6, mfc=INK, mec=PAPER,
              mew=0.6, clip_on=False, zorder=3)  # fmt: skip
    axes.set(xlim=(0, 1), ylim=(len(rows) - 0.5, -0.5), xticks=[])
    axes.set_yticks(places, [row.name for row in rows])
    axes.tick_params(axis="y", length=0)
    axes.spines["bottom"].set_visible(False)
    for place, row, size in zip(places, rows, sizes, strict=True):
        end = max(size, row.linear / largest)
        axes.text(end + 0.03, place, row.monte_carlo, va="center", color=INK, size=7)
    axes.set_title(title, x=0, pad=4)
