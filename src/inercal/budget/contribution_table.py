"""A budget as text: rows of one coefficient in its table's unit, rounded to what is known."""

from dataclasses import dataclass
from math import hypot, log10
from typing import Literal

from inercal.budget import Budget
from inercal.units import format_value_and_uncertainty

_SMALL = 0.01  # of the total: less is not worth a row


@dataclass(frozen=True)
class BudgetRow:
    """One row of a coefficient.

    Parameters
    ----------
    name, stated : str
        The imperfection and its deviation as stated.
    first_order, monte_carlo, error : str
        What it contributes, in the coefficient's unit; of rows put together, no error.
    share : float
        Its part of the total variance by Monte Carlo.
    kind : "line", "others" or "total"
    size, linear : float
        `monte_carlo` and `first_order` as numbers, for a figure.
    """

    name: str
    stated: str
    first_order: str
    monte_carlo: str
    error: str
    share: float
    kind: Literal["line", "others", "total"]
    size: float
    linear: float


def contribution_rows(budget: Budget, k: int) -> list[BudgetRow]:
    """Return the contributions to coefficient k, largest first; what is small together; the total.

    The total is of all imperfections drawn together; to first order it is the root of the sum of
    squares.
    """
    sensor = budget.experiment.sensor
    si = sensor.coefficient(sensor.coefficients[k]).si
    total = float(budget.total.monte_carlo[k]) / si
    found: list[BudgetRow] = []
    small: list[tuple[float, float]] = []
    for one, spread in budget.sorted_contributions(k):
        linear, size, error = (
            float(x[k]) / si for x in (spread.first_order, spread.monte_carlo, spread.error)
        )
        if max(linear, size) < _SMALL * total:
            small.append((linear, size))
            continue
        shown, after = format_value_and_uncertainty(size, error)
        share = (size / total) ** 2 if total else 0.0
        found.append(
            BudgetRow(
                one.name, one.stated, format_value_and_uncertainty(linear, error)[0], shown, after,
                share, "line", size, linear,
            )
        )  # fmt: skip
    if small:
        linear, size = hypot(*(x for x, _ in small)), hypot(*(x for _, x in small))
        name = f"{len(small)} other" + "s" * (len(small) > 1)
        share = (size / total) ** 2 if total else 0.0
        found.append(
            BudgetRow(name, "", f"{linear:.2g}", f"{size:.2g}", "", share, "others", size, linear)
        )
    linear, error = (float(x[k]) / si for x in (budget.total.first_order, budget.total.error))
    shown, after = format_value_and_uncertainty(total, error)
    found.append(
        BudgetRow(
            "total",
            "",
            format_value_and_uncertainty(linear, error)[0],
            shown,
            after,
            1.0,
            "total",
            total,
            linear,
        )
    )
    return found


def uncertainty_and_bias_cells(budget: Budget, k: int) -> tuple[str, str, str]:
    """Return what the estimator states itself, the bias by Monte Carlo, and its standard error."""
    sensor = budget.experiment.sensor
    si = sensor.coefficient(sensor.coefficients[k]).si
    total, error = float(budget.total.monte_carlo[k]), float(budget.total.error[k])
    bias = format_value_and_uncertainty(float(budget.bias[k]) / si, total / si / budget.trials**0.5)
    return format_value_and_uncertainty(float(budget.stated[k]) / si, error / si)[0], *bias


def shift_cells(budget: Budget, k: int) -> list[str]:
    """Return the shifts of coefficient k in its unit, three digits; 0 where it is rounding."""
    sensor = budget.experiment.sensor
    si = sensor.coefficient(sensor.coefficients[k]).si
    least = 1e-4 * float(budget.total.monte_carlo[k])
    sizes = [float(one.shift[k]) for one in budget.shifts]
    return [_three_digits(x / si) if abs(x) > least else "0" for x in sizes]


def _three_digits(x: float) -> str:
    return f"{x:+.3g}" if abs(x) < 999.5 else f"{round(x, 2 - int(log10(abs(x)))):+.0f}"
