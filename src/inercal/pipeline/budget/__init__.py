"""The error budget: the contribution of each imperfection to each coefficient.

A budget is for an estimator as configured, on a bench as stated: an estimator that estimates an
error with a prior removes a part of it, or spreads it over other coefficients.
"""

from dataclasses import dataclass

from inercal.basics.arrays import Array
from inercal.basics.blas_threads import with_one_thread
from inercal.basics.errors import InputError
from inercal.basics.parallel import Executor
from inercal.pipeline.budget.contributions import (
    ALL_IMPERFECTIONS,
    ProgressCallback,
    Shift,
    effect_shifts,
    first_order_contributions,
    monte_carlo_estimates,
    root_sum_of_squares,
    sample_deviation,
)
from inercal.pipeline.budget.imperfections import Imperfection
from inercal.pipeline.budget.virtual_experiment import Experiment


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
    """The contributions of all imperfections to p coefficients.

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
        By known effects that are left uncorrected.
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
        """Return the imperfections with their contribution to one coefficient, largest first."""
        return sorted(
            self.contributions.items(), key=lambda line: -float(line[1].monte_carlo[coefficient])
        )


@with_one_thread
def budget(
    experiment: Experiment,
    trials: int = 1000,
    seed: int = 0,
    progress: ProgressCallback | None = None,
    executor: Executor | None = None,
) -> Budget:
    """Compute the budget of an experiment.

    Parameters
    ----------
    experiment : Experiment
    trials : int
        Of the Monte Carlo, for each imperfection alone and for all together; the deviations
        have a relative standard error of 1/√(2 trials).
    seed : int
        Equal seeds give equal budgets.
    progress : callable, optional
        Called with the number of trials done, and of all trials.
    executor : Executor, optional
        Where trials are computed; by default in this process. The budget is the same.

    Raises
    ------
    InercalError
        Fewer than two trials, an estimator that refuses the plan or does not converge.
    """
    if trials < 2:
        raise InputError(
            f"{trials} trials have no standard deviation: use 2 trials or more, such as 1000",
            key="trials",
        )
    linear = first_order_contributions(experiment)
    estimates = monte_carlo_estimates(experiment, trials, seed, progress, executor)
    lines = {
        each: BudgetDeviations(linear[each.name], *sample_deviation(estimates[each.name]))
        for each in experiment.imperfections
    }
    together = estimates[ALL_IMPERFECTIONS]
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
