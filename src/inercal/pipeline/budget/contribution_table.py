"""Convert an error budget to a JSON object, or to rows of text with sensibly rounded numbers."""

from dataclasses import dataclass
from math import hypot
from typing import Any, Literal

from inercal.basics.units import format_count, format_number, format_value_and_uncertainty
from inercal.physics.sensors import SI_UNITS
from inercal.pipeline.budget import Budget, BudgetDeviations

SCHEMA = "inercal budget 1"
_SHOWN = 1e-4  # fraction of the total; smaller contributions are only rounding errors
_SMALL = 0.01  # fraction of the total; smaller contributions share one row


@dataclass(frozen=True)
class BudgetRow:
    """One row in the budget of a coefficient.

    Parameters
    ----------
    name, stated : str
        Name of the imperfection and its stated deviation.
    first_order, monte_carlo, error : str
        Contribution in the unit of the coefficient; a combined row has no error.
    share : float
        Fraction of the total Monte Carlo variance.
    kind : "line", "others" or "total"
    size, linear : float
        `monte_carlo` and `first_order` as numbers, for plotting.
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
    """Return the budget rows of coefficient k.

    The largest contribution comes first, small contributions are combined, and the total comes
    last. The Monte Carlo total is computed with all imperfections drawn together. To first order,
    the total is the root sum of squares.
    """
    si = budget.unit_size(k)
    total_linear, total, total_error = (x / si for x in budget.total.of(k))
    rows: list[BudgetRow] = []
    small: list[tuple[float, float]] = []

    def share(size: float) -> float:
        return (size / total) ** 2 if total else 0.0

    def cells(linear: float, size: float, error: float) -> tuple[str, str, str]:
        return (
            format_value_and_uncertainty(linear, error)[0],
            *format_value_and_uncertainty(size, error),
        )

    for imperfection, deviations in budget.sorted_contributions(k):
        linear, size, error = (x / si for x in deviations.of(k))
        if max(linear, size) < _SMALL * total:
            small.append((linear, size))
            continue
        shown = imperfection.name, imperfection.stated, *cells(linear, size, error)
        rows.append(BudgetRow(*shown, share(size), "line", size, linear))
    if small:
        linear, size = (hypot(*column) for column in zip(*small, strict=True))
        name = format_count(len(small), "other")
        first, all_ = (format_number(x, 2) if x > _SHOWN * total else "0" for x in (linear, size))
        rows.append(BudgetRow(name, "", first, all_, "", share(size), "others", size, linear))
    shown = cells(total_linear, total, total_error)
    rows.append(BudgetRow("total", "", *shown, 1.0, "total", total, total_linear))
    return rows


def uncertainty_and_bias_cells(budget: Budget, k: int) -> tuple[str, str, str]:
    """Return the stated uncertainty, the Monte Carlo bias, and the standard error of the bias."""
    si = budget.unit_size(k)
    _, total, error = budget.total.of(k)
    bias = format_value_and_uncertainty(float(budget.bias[k]) / si, total / si / budget.trials**0.5)
    return format_value_and_uncertainty(float(budget.stated[k]) / si, error / si)[0], *bias


def shift_cells(budget: Budget, k: int) -> list[str]:
    """Return the shifts of coefficient k in its unit, with three digits; 0 for rounding errors."""
    si = budget.unit_size(k)
    least = _SHOWN * float(budget.total.monte_carlo[k])
    sizes = [float(one.shift[k]) for one in budget.shifts]
    return [f"{'+' * (x > 0)}{format_number(x / si, 3)}" if abs(x) > least else "0" for x in sizes]


def budget_as_dict(budget: Budget) -> dict[str, Any]:
    """Return a budget as a JSON object; numbers are in the SI unit of each coefficient."""
    sensor = budget.experiment.sensor

    def coefficient(k: int, name: str) -> dict[str, Any]:
        return {
            "name": name,
            "unit": SI_UNITS[sensor.coefficient(name).unit],
            "truth": float(budget.experiment.true_values[k]),
            "stated": float(budget.stated[k]),
            "bias": float(budget.bias[k]),
            "total": _deviations_as_dict(budget.total, k),
            "contributions": [
                {"name": one.name} | _deviations_as_dict(deviations, k)
                for one, deviations in budget.sorted_contributions(k)
            ],
            "shifts": [{"name": x.name, "shift": float(x.shift[k])} for x in budget.shifts],
        }

    return {
        "schema": SCHEMA,
        "sensor": sensor.name,
        "plan": [
            {"label": step.label, "what": step.describe(), "seconds": step.seconds}
            for step in budget.experiment.steps
        ],
        "trials": budget.trials,
        "seed": budget.seed,
        "imperfections": [
            {name: getattr(one, name) for name in ("name", "meaning", "stated")}
            | {"draws": len(one.draws)}
            for one in budget.contributions
        ],
        "effects": [{"name": x.name, "value": x.value} for x in budget.shifts],
        "coefficients": [coefficient(k, name) for k, name in enumerate(sensor.coefficients)],
    }


def _deviations_as_dict(deviations: BudgetDeviations, k: int) -> dict[str, float]:
    names = ("first_order", "monte_carlo", "monte_carlo_error")
    return dict(zip(names, deviations.of(k), strict=True))
