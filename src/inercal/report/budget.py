"""The page of an error budget."""

from dataclasses import dataclass

from inercal.budget import Budget
from inercal.budget.rows import Row, rows, shift_cells, stated_row
from inercal.report.bars import bars
from inercal.report.tables import minus
from inercal.report.templates import render


@dataclass(frozen=True)
class Part:
    """One coefficient of the page: its rows as `inercal.budget.rows` gives them."""

    name: str
    meaning: str
    unit: str
    rows: tuple[Row, ...]
    stated: str
    bias: str
    bias_error: str
    shifts: tuple[str, ...]

    @property
    def total(self) -> Row:
        """The last row."""
        return self.rows[-1]

    @property
    def largest(self) -> Row:
        """The first row, of the largest contribution."""
        return self.rows[0]


def page(budget: Budget, under: str) -> str:
    """Return the whole page, HTML; `under` stands under the sensor's name."""
    sensor = budget.experiment.sensor
    parts = [_part(budget, k, name) for k, name in enumerate(sensor.coefficients)]
    panels = [(f"{part.name}, {part.unit}", part.rows) for part in parts]
    return render(
        "budget.html",
        sensor=sensor,
        under=under,
        budget=budget,
        parts=parts,
        figure=bars(panels),
        relative=f"{100 / (2 * budget.trials) ** 0.5:.2g}",
    )


def _part(budget: Budget, k: int, name: str) -> Part:
    line = budget.experiment.sensor.coefficient(name)
    stated, bias, error = stated_row(budget, k)
    shifts = tuple(minus(cell) for cell in shift_cells(budget, k))
    return Part(
        name,
        line.meaning,
        line.unit,
        tuple(rows(budget, k)),
        stated,
        minus(bias),
        error,
        shifts,
    )
