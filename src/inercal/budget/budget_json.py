"""A budget as one documented object, for JSON: SI throughout."""

from typing import Any

from inercal.budget import Budget, BudgetDeviations
from inercal.sensors import SI_UNITS

SCHEMA = "inercal budget 1"


def budget_as_dict(budget: Budget) -> dict[str, Any]:
    """Return the object; numbers of a coefficient are in its `unit`, which is SI."""
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
                {"name": one.name} | _deviations_as_dict(spread, k)
                for one, spread in budget.sorted_contributions(k)
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
            {
                "name": one.name,
                "meaning": one.meaning,
                "stated": one.stated,
                "draws": len(one.draws),
            }
            for one in budget.contributions
        ],
        "effects": [{"name": x.name, "value": x.value} for x in budget.shifts],
        "coefficients": [coefficient(k, name) for k, name in enumerate(sensor.coefficients)],
    }


def _deviations_as_dict(spread: BudgetDeviations, k: int) -> dict[str, float]:
    return {
        "first_order": float(spread.first_order[k]),
        "monte_carlo": float(spread.monte_carlo[k]),
        "monte_carlo_error": float(spread.error[k]),
    }
