"""The error budget: the contribution of each imperfection to each coefficient.

A budget is valid for one configuration of the estimator and one stated bench. If the estimator
estimates an error with a prior, it removes part of this error or spreads it over other
coefficients.
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
    """Standard deviations of the estimates, each (p,) in SI units.

    Parameters
    ----------
    first_order : (p,) array
        Standard deviations from derivatives. A total is the root sum of squares.
    monte_carlo : (p,) array
        Standard deviations from random draws.
    error : (p,) array
        Standard error of `monte_carlo`.
    """

    first_order: Array
    monte_carlo: Array
    error: Array


@dataclass(frozen=True, eq=False)
class Budget:
    """An error budget: the contributions of all imperfections to p coefficients.

    Parameters
    ----------
    experiment : Experiment
    trials, seed : int
        Number of trials and seed of the Monte Carlo simulation.
    contributions : dict of Imperfection to BudgetDeviations
        Contribution of each imperfection.
    total : BudgetDeviations
        Contribution of all imperfections together.
    bias : (p,) array
        Mean of the estimates with all imperfections minus the true values, SI.
    stated : (p,) array
        Standard uncertainties that the estimator states, SI.
    shifts : tuple of Shift
        Shifts due to known effects that are not corrected.
    """

    experiment: Experiment
    trials: int
    seed: int
    contributions: dict[Imperfection, BudgetDeviations]
    total: BudgetDeviations
    bias: Array
    stated: Array
    shifts: tuple[Shift, ...]

    def unit_size(self, coefficient: int) -> float:
        """Return the size in SI of the unit in which a coefficient is printed."""
        sensor = self.experiment.sensor
        return sensor.coefficient(sensor.coefficients[coefficient]).si

    def sorted_contributions(self, coefficient: int) -> list[tuple[Imperfection, BudgetDeviations]]:
        """Return all imperfections and their contributions to one coefficient, largest first."""
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
    """Compute the error budget of an experiment.

    Parameters
    ----------
    experiment : Experiment
    trials : int
        Number of Monte Carlo trials for each imperfection, and for all imperfections together. The
        deviations have a relative standard error of 1/√(2 trials).
    seed : int
        Seed of the random numbers; the same seed gives the same budget.
    progress : callable, optional
        Function called with the number of finished trials and the total number of trials.
    executor : Executor, optional
        Executor for the trials. By default, the trials run in this process. The budget does not
        depend on the executor.

    Raises
    ------
    InercalError
        If there are fewer than two trials, or if the estimator refuses the plan or does not
        converge.
    """
    if trials < 2:
        raise InputError(
            f"no standard deviation can be computed from {trials} trials: use at least 2, such as "
            "1000",
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
