"""Expected uncertainties: the uncertainties that the estimator of a run states for its plan.

The readings are simulated for the declared bench, with the stated noise and priors
(`inercal.pipeline.budget.virtual_experiment`). The data of the run are not read.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from inercal.basics.errors import InputError, NotObserved
from inercal.estimation import Estimate
from inercal.physics.sensors import Sensor
from inercal.pipeline.budget.experiment_from_runfile import experiment_from_run
from inercal.runfile import Run


@dataclass(frozen=True)
class ExpectedUncertainty:
    """The expected uncertainty of a coefficient, or of the sum of two coefficients.

    Parameters
    ----------
    name, meaning : str
    unit : str
        Unit in which the coefficient is printed.
    size : float
        Size of the unit in SI units.
    std : float
        Standard uncertainty, SI.
    """

    name: str
    meaning: str
    unit: str
    size: float
    std: float


def estimate_of_plan(run: Run, rows: str) -> Estimate:
    """Run the estimator on simulated readings of a run's plan, and return the estimate.

    Parameters
    ----------
    run : Run
        Run with known attitudes or with means.
    rows : str
        Word for the rows of the plan in messages, "positions" or "states".

    Raises
    ------
    InputError
        If no noise is stated, or the estimator gives no result for this plan.
    NotObserved
        If the plan does not determine all coefficients.
    """
    experiment = experiment_from_run(run, free_attitudes=run.data.kind == "means")
    try:
        estimate = experiment.estimate()
    except NotObserved as error:
        text = f"the plan of {len(run.steps)} {rows} does not determine the coefficients"
        raise error.located(text).located(run.path) from None
    except InputError as error:
        raise error.located(run.path) from None
    if not (np.all(estimate.converged) and np.isfinite(estimate.covariance).all()):
        raise InputError(
            f"{run.path}: estimator {run.estimator} has no result for this plan; check the stated "
            "noise and [sensor.truth]",
            file=run.path,
        )
    return estimate


def estimated_uncertainties(estimate: Estimate, sensor: Sensor) -> tuple[ExpectedUncertainty, ...]:
    """Return the expected uncertainty of each coefficient of the sensor."""
    # The covariance is not scaled by the residuals, because the scatter of one draw of the noise
    # says nothing about the plan.
    std = np.sqrt(np.diagonal(estimate.covariance)[: len(sensor.coefficients)])
    return coefficient_uncertainties(
        sensor, dict(zip(sensor.coefficients, std.tolist(), strict=True))
    )


def coefficient_uncertainties(
    sensor: Sensor, std: Mapping[str, float]
) -> tuple[ExpectedUncertainty, ...]:
    """Combine the coefficients of the sensor with standard uncertainties by name, SI."""
    lines = [(name, sensor.coefficient(name)) for name in sensor.coefficients]
    return tuple(
        ExpectedUncertainty(name, line.meaning, line.unit, line.si, std[name])
        for name, line in lines
    )
