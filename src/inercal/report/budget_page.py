"""HTML pages of predicted uncertainties: an error budget, and operating points of a calibration.

The page of a budget has tables and bars for the contributions. In the page of operating points, one
part of the point varies; the page shows raw errors, and U after correction.
"""
# matplotlib's stubs leave **kwargs untyped.
# pyright: reportUnknownMemberType=false

from collections.abc import Sequence
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from inercal.basics.arrays import Array
from inercal.calibration import Calibration
from inercal.calibration.display import title
from inercal.calibration.prediction import Prediction
from inercal.physics.quantities import QUANTITIES
from inercal.pipeline.budget import Budget
from inercal.pipeline.budget.contribution_table import (
    BudgetRow,
    contribution_rows,
    shift_cells,
    uncertainty_and_bias_cells,
)
from inercal.pipeline.operating_points import fitting_unit, point_text, quantity_cells, swept_values
from inercal.report import drawing
from inercal.report.drawing import AXES, FAINT, INK, MINUS, MUTED, PAPER, WARN
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
    drawn = [(heading, [row for row in rows if _is_visible(row)]) for heading, rows in panels]
    lines = [drawn[k : k + _COLUMNS] for k in range(0, len(drawn), _COLUMNS)]
    heights = [_BAR_HEIGHT * max(len(rows) for _, rows in line) for line in lines]
    total = sum(heights) + _TITLE_HEIGHT * len(lines)
    figure = Figure(figsize=(_WIDTH, total))
    each, foot = _WIDTH / _COLUMNS, total
    for line, height in zip(lines, heights, strict=True):
        foot -= _TITLE_HEIGHT + height
        for column, (heading, rows) in enumerate(line):
            own = _BAR_HEIGHT * len(rows)
            left, width = column * each + _NAME_WIDTH, each - _NAME_WIDTH - _NUMBER_WIDTH
            box = (left / _WIDTH, (foot + height - own) / total, width / _WIDTH, own / total)
            _draw_panel(figure.add_axes(box), heading, rows)
    return drawing.svg(figure, "contributions", "Contributions to each coefficient, largest first")


def _is_visible(row: BudgetRow) -> bool:
    """Return whether a row gets a bar; the row of small contributions may be negligible."""
    return row.kind != "others" or row.share > _MIN_SHARE


def _draw_panel(axes: Axes, heading: str, rows: Sequence[BudgetRow]) -> None:
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
    axes.set_title(heading, x=0, pad=4)


_ROWS = 5  # points in the table
_ROUNDING = 1e-9
_LEAST_SHARE = 0.05  # smallest share of the variance that is named
_LINES = ("-", "--", ":")  # for readers who cannot distinguish the colours


def prediction_page(calibration: Calibration, found: Prediction, name: str) -> str:
    """Return the page as HTML; `name` is the quantity that varies, such as the temperature."""
    x, unit = swept_values(name, found)
    varying = np.ptp(found.raw_error, axis=0) > _ROUNDING * np.abs(found.raw_error).max(axis=0)
    kinds = dict.fromkeys(
        one for one, own in zip(found.measures, varying.tolist(), strict=True) if own
    )
    kinds = kinds or found.measures[:1]
    chosen: list[int] = np.linspace(0, x.size - 1, _ROWS).round().astype(int).tolist()
    return render(
        "prediction.html",
        title=title(calibration),
        name=name,
        ends=(point_text(found, 0), point_text(found, -1)),
        figures=[_figure(found, kind, x, f"{name} [{unit}]") for kind in kinds],
        rows=[
            (typeset_minus(f"{x[j]:.5g} {unit}"), bool(found.outside[j]), found.names[k],
             *quantity_cells(found, j, k)[1:], _largest_shares(found, j, k))
            for j in chosen for k, kind in enumerate(found.measures) if kind in kinds
        ],
        outside=sum(map(bool, found.outside)),
        count=x.size,
        extrapolated=", ".join(found.effects),
        remarks=found.remarks,
    )  # fmt: skip


def _largest_shares(found: Prediction, j: int, k: int) -> str:
    causes = {**found.groups, **found.effects}
    shares = sorted(((float(one[j, k]), cause) for cause, one in causes.items()), reverse=True)
    named = (f"{cause} {100 * x:.0f} %" for x, cause in shares[:2] if x >= _LEAST_SHARE)
    return ", ".join(named)


@drawing.style
def _figure(found: Prediction, kind: str, x: Array, label: str) -> Markup:
    """Return two panels for a kind of sensor: raw errors, and bands of ± U after correction."""
    at = [k for k, own in enumerate(found.measures) if own == kind]
    names = [found.names[k] for k in at]
    raw, u = found.raw_error[:, at], found.expanded[:, at]
    sensors = QUANTITIES[kind].sensors
    panels = {
        f"{sensors.capitalize()}: raw error": (raw, raw - u, raw + u),
        f"{sensors.capitalize()}: ± U after correction": (np.zeros_like(u), -u, u),
    }
    outside = np.array([bool(one) for one in found.outside])
    figures: list[Markup] = []
    for heading, (middle, low, high) in panels.items():
        figure, ((axes,),) = drawing.panels(1.9, [0.5], half=True)
        unit, si = fitting_unit(kind, np.maximum(np.abs(low), np.abs(high)))
        for k, name in enumerate(names):
            look: dict[str, Any] = {"color": AXES[k % 3], "ls": _LINES[k % 3], "lw": 1.2}
            for line in (middle,) if middle.any() else (low, high):
                shown = name if line is not low else None
                axes.plot(x, line[:, k] / si, label=shown, **look)
            axes.fill_between(x, low[:, k] / si, high[:, k] / si, color=AXES[k % 3], alpha=0.12,
                              lw=0)  # fmt: skip
        axes.axhline(0, color=FAINT, lw=0.8, zorder=0)
        axes.margins(x=0.04)
        if outside.any():
            axes.fill_between(x, 0, 1, where=outside, transform=axes.get_xaxis_transform(),
                              color=WARN, alpha=0.15, lw=0, zorder=0)  # fmt: skip
        axes.set_title(heading)
        axes.set_xlabel(label)
        axes.set_ylabel(unit)
        drawing.add_legend(axes)
        figures.append(drawing.svg(figure, f"prediction_{kind}_{len(figures)}", heading))
    return drawing.halves(figures)
