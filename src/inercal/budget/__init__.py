"""The error budget: what each imperfection contributes to each coefficient.

A budget is of an estimator as it is configured, on a bench as it is stated: one that carries an
error as an unknown with a prior takes a part of it out, or spreads it over other coefficients.
"""

from dataclasses import dataclass

from inercal.arrays import Array
from inercal.budget.contributions import (
    ALL_IMPERFECTIONS,
    ProgressCallback,
    first_order_contributions,
    monte_carlo_estimates,
    root_sum_of_squares,
    sample_deviation,
)
from inercal.budget.effect_shifts import Shift, effect_shifts
from inercal.budget.imperfections import Imperfection
from inercal.budget.virtual_experiment import Experiment
from inercal.errors import InputError


@dataclass(frozen=True, eq=False)
class BudgetDeviations:
    """Standard deviations of the estimates, (p,) SI each.

    Parameters
    ----------
    first_order : (p,) array
        By derivatives; of a total, the root of the sum of squares.
    monte_carlo : (p,) array
        By drawing.
    error : (p,) array
        Standard error of `monte_carlo`.
    """

    first_order: Array
    monte_carlo: Array
    error: Array


@dataclass(frozen=True, eq=False)
class Budget:
    """What everything contributes to p coefficients.

    Parameters
    ----------
    experiment : Experiment
    trials, seed : int
        Of the Monte Carlo.
    contributions : dict of Imperfection to BudgetDeviations
        Each imperfection alone.
    total : BudgetDeviations
        All together.
    bias : (p,) array
        Mean of the estimates with all together, minus the truth, SI.
    stated : (p,) array
        Standard uncertainties that the estimator states itself, SI.
    shifts : tuple of Shift
        Known effects, if they are left uncorrected.
    """

    experiment: Experiment
    trials: int
    seed: int
    contributions: dict[Imperfection, BudgetDeviations]
    total: BudgetDeviations
    bias: Array
    stated: Array
    shifts: tuple[Shift, ...]

    def sorted_contributions(self, coefficient: int) -> list[tuple[Imperfection, BudgetDeviations]]:
        """Return the lines by what they contribute to one coefficient, largest first."""
        return sorted(
            self.contributions.items(), key=lambda line: -float(line[1].monte_carlo[coefficient])
        )


def budget(
    experiment: Experiment,
    trials: int = 1000,
    seed: int = 0,
    progress: ProgressCallback | None = None,
) -> Budget:
    """Work out the budget of an experiment.

    Parameters
    ----------
    experiment : Experiment
    trials : int
        Of the Monte Carlo, for each imperfection alone and for all together; the deviations found
        have a relative standard error of 1/√(2 trials).
    seed : int
        Equal seeds give equal budgets.
    progress : callable, optional
        Told the trials done and those in all.

    Raises
    ------
    InercalError
        Fewer than two trials, an estimator that refuses the plan or does not converge.
    """
    if trials < 2:
        raise InputError(f"{trials} trials have no spread: take 2 or more, such as 1000")
    linear = first_order_contributions(experiment)
    found = monte_carlo_estimates(experiment, trials, seed, progress)
    lines = {
        one: BudgetDeviations(linear[one.name], *sample_deviation(found[one.name]))
        for one in experiment.imperfections
    }
    together = found[ALL_IMPERFECTIONS]
    return Budget(
        experiment,
        trials,
        seed,
        lines,
        BudgetDeviations(root_sum_of_squares(list(linear.values())), *sample_deviation(together)),
        together.mean(axis=0) - experiment.true_values,
        experiment.stated(),
        effect_shifts(experiment),
    )


__all__ = ["Budget", "BudgetDeviations", "Experiment", "Imperfection", "Shift", "budget"]
