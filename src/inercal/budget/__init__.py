"""The error budget: what each imperfection contributes to each coefficient.

A budget is of an estimator as it is configured, on a bench as it is stated: one that carries an
error as an unknown with a prior takes a part of it out, or spreads it over other coefficients.
"""

from dataclasses import dataclass

from inercal.arrays import Array
from inercal.budget.contributions import TOGETHER, Progress, drawn, first_order, spread, squares
from inercal.budget.experiment import Experiment
from inercal.budget.imperfections import Imperfection
from inercal.budget.shifts import Shift, shifts
from inercal.errors import InputError


@dataclass(frozen=True, eq=False)
class Spread:
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
    lines : dict of Imperfection to Spread
        Each imperfection alone.
    total : Spread
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
    lines: dict[Imperfection, Spread]
    total: Spread
    bias: Array
    stated: Array
    shifts: tuple[Shift, ...]

    def sorted_lines(self, coefficient: int) -> list[tuple[Imperfection, Spread]]:
        """Return the lines by what they contribute to one coefficient, largest first."""
        return sorted(self.lines.items(), key=lambda line: -float(line[1].monte_carlo[coefficient]))


def budget(
    experiment: Experiment, trials: int = 1000, seed: int = 0, progress: Progress | None = None
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
    linear = first_order(experiment)
    found = drawn(experiment, trials, seed, progress)
    lines = {
        one: Spread(linear[one.name], *spread(found[one.name])) for one in experiment.imperfections
    }
    together = found[TOGETHER]
    return Budget(
        experiment,
        trials,
        seed,
        lines,
        Spread(squares(list(linear.values())), *spread(together)),
        together.mean(axis=0) - experiment.true,
        experiment.stated(),
        shifts(experiment),
    )


__all__ = ["Budget", "Experiment", "Imperfection", "Shift", "Spread", "budget"]
