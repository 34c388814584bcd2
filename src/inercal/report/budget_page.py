"""The page of an error budget."""

from dataclasses import dataclass

from inercal.budget import Budget
from inercal.budget.contribution_table import (
    BudgetRow,
    contribution_rows,
    shift_cells,
    uncertainty_and_bias_cells,
)
from inercal.report.bars import contribution_bars
from inercal.report.report_tables import typeset_minus
from inercal.report.templates import render


@dataclass(frozen=True)
class CoefficientBudget:
    """One coefficient of the page: its rows as `inercal.budget.contribution_table` gives them."""

    name: str
    meaning: str
    unit: str
    rows: tuple[BudgetRow, ...]
    stated: str
    bias: str
    bias_error: str
    shifts: tuple[str, ...]

    @property
    def total(self) -> BudgetRow:
        """The last row."""
        return self.rows[-1]

    @property
    def largest(self) -> BudgetRow:
        """The first row, of the largest contribution."""
        return self.rows[0]


def page(budget: Budget, under: str) -> str:
    """Return the whole page, HTML; `under` stands under the sensor's name."""
    sensor = budget.experiment.sensor
    parts = [_coefficient_budget(budget, k, name) for k, name in enumerate(sensor.coefficients)]
    panels = [(f"{part.name}, {part.unit}", part.rows) for part in parts]
    return render(
        "budget.html",
        sensor=sensor,
        under=under,
        budget=budget,
        parts=parts,
        figure=contribution_bars(panels),
        relative=f"{100 / (2 * budget.trials) ** 0.5:.2g}",
    )


def _coefficient_budget(budget: Budget, k: int, name: str) -> CoefficientBudget:
    line = budget.experiment.sensor.coefficient(name)
    stated, bias, error = uncertainty_and_bias_cells(budget, k)
    shifts = tuple(typeset_minus(cell) for cell in shift_cells(budget, k))
    return CoefficientBudget(
        name,
        line.meaning,
        line.unit,
        tuple(contribution_rows(budget, k)),
        stated,
        typeset_minus(bias),
        error,
        shifts,
    )
