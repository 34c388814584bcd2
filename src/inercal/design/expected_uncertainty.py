"""How well coefficients will be known: what the run's estimator states of its own plan.

The readings are made by the bench as declared, with the noise and the priors as stated
(`inercal.budget.virtual_experiment`); the run's data are not looked at.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from inercal.budget.experiment_from_runfile import experiment_from_run
from inercal.errors import InputError, NotObserved
from inercal.estimate import Estimate
from inercal.runfile import Run
from inercal.sensors import Sensor


@dataclass(frozen=True)
class ExpectedUncertainty:
    """How well a coefficient, or a sum of two, will be known.

    Parameters
    ----------
    name, meaning : str
    unit : str
        As it is printed.
    size : float
        SI size of the unit.
    std : float
        Standard uncertainty, SI.
    """

    name: str
    meaning: str
    unit: str
    size: float
    std: float


def estimate_of_plan(run: Run, rows: str) -> Estimate:
    """Return what the run's estimator makes of its plan.

    Parameters
    ----------
    run : Run
        In known attitudes.
    rows : str
        What the plan is of, "positions" or "states".

    Raises
    ------
    InputError
        No noise, or no result of this plan.
    NotObserved
        Coefficients that the plan leaves open.
    """
    experiment = experiment_from_run(run)
    try:
        estimate = experiment.estimate()
    except NotObserved as error:
        raise NotObserved(
            f"{run.path}: the plan of {len(run.steps)} {rows} does not determine the coefficients: "
            f"{error}",
            error.directions,
        ) from None
    except InputError as error:
        raise InputError(f"{run.path}: {error}") from None
    if not (np.all(estimate.converged) and np.isfinite(estimate.covariance).all()):
        raise InputError(
            f"{run.path}: estimator {run.estimator} finds no result of this plan: look at the "
            "noise as stated and at [sensor.truth]"
        )
    return estimate


def estimated_uncertainties(estimate: Estimate, sensor: Sensor) -> tuple[ExpectedUncertainty, ...]:
    """Return each coefficient of the sensor."""
    # As modelled: by how much one draw of the noise scatters is no matter of the plan.
    std = np.sqrt(np.diagonal(estimate.covariance)[: len(sensor.coefficients)])
    return coefficient_uncertainties(
        sensor, dict(zip(sensor.coefficients, std.tolist(), strict=True))
    )


def coefficient_uncertainties(
    sensor: Sensor, std: Mapping[str, float]
) -> tuple[ExpectedUncertainty, ...]:
    """Return each coefficient of the sensor, of standard uncertainties by its name, SI."""
    lines = [(name, sensor.coefficient(name)) for name in sensor.coefficients]
    return tuple(
        ExpectedUncertainty(name, line.meaning, line.unit, line.si, std[name])
        for name, line in lines
    )
