"""Compute the error budget: how much each imperfection contributes to each coefficient.

A budget is valid for one configuration of the estimator and one stated bench. If the estimator
estimates an error with a prior, it removes part of this error or spreads it over other
coefficients.

First order (GUM, JCGM 100:2008, 5.1): c_k = ∂E/∂z_k is computed by central differences over one
standard deviation. If the effect of this step is not larger than rounding errors, it counts as
zero. The independent draws of an imperfection are combined in quadrature, and so are all
imperfections. Monte Carlo (GUM Supplement 1, JCGM 101:2008, clause 7): each imperfection is drawn
separately, and then all are drawn together, with the same random numbers.

The two methods differ if an estimate depends nonlinearly on an error, or if errors interact.

A known effect that is not corrected shifts an estimate. There are two kinds of such effects. The
first kind, such as earth's rate, is an effect that a bench can correct: the simulated readings
contain the effect, but the bench that the estimator uses does not. The second kind is a coefficient
of the sensor that is not estimated, such as a lever arm: only the readings contain its effect.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.parallel import Executor, SerialExecutor, in_order
from inercal.basics.process_settings import with_one_thread
from inercal.basics.units import Measured, format_number, format_quantity
from inercal.benches import MeanBench
from inercal.benches.kind_definition import Effect, kind_for_bench
from inercal.estimation.uncertainty import BATCH, monte_carlo
from inercal.pipeline.budget.imperfections import NOISE, Imperfection
from inercal.pipeline.budget.virtual_experiment import Experiment

ProgressCallback = Callable[[int, int], None]
ALL_IMPERFECTIONS = "together"


def first_order_contributions(experiment: Experiment) -> dict[str, Array]:
    """Return the contribution of each imperfection, by name, as standard deviations (p,), SI."""
    n, z = experiment.size, experiment.expansion_point
    shifted = np.concatenate([z + np.eye(n), z - np.eye(n)])
    estimates = np.concatenate([experiment(shifted[k : k + BATCH]) for k in range(0, 2 * n, BATCH)])
    by_draw = (estimates[:n] - estimates[n:]) / 2
    return {
        name: np.sqrt(np.sum(by_draw[columns] ** 2, axis=0))
        for name, columns in experiment.draw_columns.items()
    }


def monte_carlo_estimates(
    experiment: Experiment,
    trials: int,
    seed: int,
    progress: ProgressCallback | None = None,
    executor: Executor | None = None,
) -> dict[str, Array]:
    """Return estimates, (trials, p) SI, by the name of the imperfection that was drawn.

    The name `ALL_IMPERFECTIONS` gives the estimates with all imperfections drawn together.

    Parameters
    ----------
    experiment : Experiment
    trials : int
    seed : int
    progress : callable, optional
        Called with the number of finished trials and the total number of trials.
    executor : Executor, optional
        Executor for the trials. By default, the trials run in this process.
    """
    names = list(experiment.draw_columns)
    # If the noise is the only imperfection, its trials are the same as those of all imperfections.
    runs = [ImperfectionTrials(experiment, name) for name in names]
    if names != [NOISE]:
        runs.append(ImperfectionTrials(experiment, ALL_IMPERFECTIONS))
    found = monte_carlo(runs, trials, seed, progress=progress, executor=executor)
    return {ALL_IMPERFECTIONS: found[NOISE]} | found


@dataclass(frozen=True, eq=False)
class ImperfectionTrials:
    """Trials in which one imperfection, or all imperfections, are drawn at random."""

    experiment: Experiment
    name: str

    def __call__(self, rng: np.random.Generator, count: int) -> dict[str, Array]:
        """Return the estimates of some trials, (count, p) SI, by the name of the imperfection."""
        z = rng.standard_normal((count, self.experiment.size))
        if self.name == ALL_IMPERFECTIONS:
            return {self.name: self.experiment(z)}
        columns = self.experiment.draw_columns[self.name]
        alone = np.tile(self.experiment.expansion_point, (count, 1))
        alone[:, columns] = z[:, columns]
        return {self.name: self.experiment(alone)}


def sample_deviation(estimates: Array) -> tuple[Array, Array]:
    """Return the standard deviation of estimates, (trials, p), and its standard error, (p,) each.

    The standard error is √(m₄ − s⁴ (n−3)/(n−1)) / (2 s √n), which is valid for any distribution
    with a fourth moment. For a normal distribution, it is s / √(2n).
    """
    n = len(estimates)
    sd = np.std(estimates, axis=0, ddof=1)
    centred = np.where(sd > 0, (estimates - estimates.mean(axis=0)) / np.where(sd > 0, sd, 1), 0)
    fourth = np.mean(centred**4, axis=0)
    return sd, sd * np.sqrt(np.maximum(fourth - (n - 3) / (n - 1), 0) / n) / 2


@dataclass(frozen=True, eq=False)
class Shift:
    """The shift of the estimates due to a known effect that is not corrected.

    Parameters
    ----------
    name : str
    value : str
        Printed size of the effect.
    shift : (p,) array
        Shift of each estimate, SI.
    """

    name: str
    value: str
    shift: Array


def effect_shifts(experiment: Experiment) -> tuple[Shift, ...]:
    """Return the shift due to each known effect and, if there are several, due to all of them."""
    bench, own, z = experiment.bench, experiment.sensor.coefficients, experiment.expansion_point
    # The mean over a draw of the noise and the negative draw cancels the noise to first order.
    readings, priors = experiment.simulated_readings(np.stack([z, -z]))
    q = {name: np.array(parameter.value) for name, parameter in experiment.bench_parameters.items()}
    quiet = experiment.readings(q, own)
    corrected = experiment.estimates(readings, priors)

    def shift_with(other: MeanBench, more: tuple[str, ...] = ()) -> Array:
        changed = readings + experiment.readings(q, (*own, *more)) - quiet
        return np.mean(experiment.estimates(changed, priors, other) - corrected, axis=0)

    shifts: list[Shift] = []
    absent: dict[str, Measured | float] = {}
    for effect in kind_for_bench(bench).effects:
        value = _effect_value(getattr(bench, effect.field))
        if value and _effect_reaches_sensor(experiment, effect):
            absent[effect.field] = effect.absent
            shift = shift_with(replace(bench, **{effect.field: effect.absent}))
            text = f"{format_number(value * effect.per, 4)} {effect.unit}"
            shifts.append(Shift(effect.name, text, shift))
    more = tuple(name for name, c in experiment.truth.items() if name not in own and c)
    full = replace(experiment.sensor, coefficients=(*own, *more))
    for name in more:
        line = full.coefficient(name)
        text = format_quantity(experiment.truth[name], 0.0, line.unit, 4)
        shifts.append(Shift(name, text, shift_with(bench, (name,))))
    if len(shifts) > 1:
        shifts.append(Shift("all of these", "", shift_with(replace(bench, **absent), more)))
    return tuple(shifts)


def _effect_value(stated: Measured | float | None) -> float:
    """Return the value of a field; 0 if unknown, because the effect is then not a known effect."""
    if stated is None:
        return 0.0
    return stated.value if isinstance(stated, Measured) else stated


def _effect_reaches_sensor(experiment: Experiment, effect: Effect) -> bool:
    """Return whether the sensor measures an effect; held by hand, only gyros sense earth's rate."""
    gyros = any(axis.measures == "w" for axis in experiment.sensor.axes)
    return gyros or not effect.affects_rates


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

    def of(self, k: int) -> tuple[float, float, float]:
        """Return the three numbers of coefficient k."""
        return float(self.first_order[k]), float(self.monte_carlo[k]), float(self.error[k])


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
    executor = executor or SerialExecutor()
    functions = (_first_order, Experiment.stated, effect_shifts)
    first, *_ = [executor.submit(function, experiment) for function in functions]
    (experiment, linear), stated, shifts = in_order(executor, first)
    estimates = monte_carlo_estimates(experiment, trials, seed, progress, executor)
    lines = {
        each: BudgetDeviations(linear[each.name], *sample_deviation(estimates[each.name]))
        for each in experiment.imperfections
    }
    together = estimates[ALL_IMPERFECTIONS]
    first_order = np.sqrt(np.sum(np.square(list(linear.values())), axis=0))
    return Budget(
        experiment,
        trials,
        seed,
        lines,
        BudgetDeviations(first_order, *sample_deviation(together)),
        together.mean(axis=0) - experiment.true_values,
        stated,
        shifts,
    )


def _first_order(experiment: Experiment) -> tuple[Experiment, dict[str, Array]]:
    """Return the contributions, with the experiment, which then knows more of its estimator."""
    return experiment, first_order_contributions(experiment)


__all__ = ["Budget", "BudgetDeviations", "Experiment", "Imperfection", "Shift", "budget"]
