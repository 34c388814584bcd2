"""Check the inputs of estimators, with the same messages for every estimator."""

from collections.abc import Sequence
from itertools import zip_longest
from typing import Any

from inercal.basics.errors import InputError
from inercal.methods import Priors
from inercal.methods.temperature import temperature_coefficients
from inercal.physics.sensors import Sensor
from inercal.recordings import Observations


def require_matching_rows(observations: Observations, sensor: Sensor, steps: Sequence[Any]) -> None:
    """Raise InputError if the steps or channels do not match the rows.

    Raises
    ------
    InputError
        The channels do not match, a row does not match its step, or two steps have the same label.
    """
    if observations.channels != sensor.channels:
        raise InputError(
            f"the readings are from {', '.join(observations.channels)}, but the sensor has "
            f"{', '.join(sensor.channels)}; give the readings of the sensor's axes in the same "
            "order",
            key="observations",
            names=observations.channels,
        )
    labels = tuple(step.label for step in steps)
    if again := tuple(sorted({label for label in labels if labels.count(label) > 1})):
        raise InputError(
            f"two steps have the label {again[0]!r}; give each step a different label",
            key="steps",
            names=again,
        )
    if labels != observations.labels:
        pairs = zip_longest(observations.labels, labels)
        row, step = next(pair for pair in pairs if pair[0] != pair[1])
        raise InputError(
            f"the steps do not match the observations, which have {row or 'no row'} where the "
            f"steps have {step or 'no step'}; give one step per row, in the order of the rows",
            key="steps",
            names=tuple(label for label in (row, step) if label is not None),
        )


def require_single_recording(observations: Observations, what: str) -> None:
    """Raise InputError if there are many trials; `what` names the caller: "estimator fourier".

    Raises
    ------
    InputError
    """
    if observations.mean.ndim != 2:
        raise InputError(
            f"{what} needs a single recording, not {observations.mean.shape[0]} trials; pass "
            "one trial",
            key="observations",
        )


def refuse_priors(priors: Priors, estimator: str, instead: str) -> None:
    """Raise InputError if there are priors and the estimator cannot use them.

    Parameters
    ----------
    priors : sequence of Gaussian
    estimator, instead : str
        Names of this estimator, and of an estimator that uses priors.

    Raises
    ------
    InputError
        There are priors; the message names their coefficients.
    """
    if names := tuple(name for prior in priors for name in prior.names):
        raise InputError(
            f"estimator {estimator} does not use priors; remove the priors, or use estimator "
            f"{instead}",
            key="priors",
            names=names,
        )


def refuse_temperature_terms(sensor: Sensor, estimator: str, instead: str) -> None:
    """Raise InputError if there are temperature coefficients that the estimator cannot estimate.

    Parameters
    ----------
    sensor : Sensor
    estimator, instead : str
        Names of this estimator, and of an estimator that can estimate them.

    Raises
    ------
    InputError
        There are temperature coefficients; the message names them.
    """
    if names := tuple(temperature_coefficients(sensor)):
        raise InputError(
            f"estimator {estimator} cannot estimate temperature coefficients "
            f"({', '.join(names)}); use estimator {instead}, or leave them out",
            key="[method]",
            names=names,
        )


def refuse_tilted_form(sensor: Sensor, estimator: str, instead: str) -> None:
    """Raise InputError if the sensor is not in the reference form, which formulas need.

    Raises
    ------
    InputError
    """
    if sensor.form != "reference":
        raise InputError(
            f"estimator {estimator} estimates only the reference form; set [sensor] form = "
            f'"reference", or use estimator {instead}',
            key="[sensor] form",
        )


def require_plain_means(
    observations: Observations, sensor: Sensor, priors: Priors, estimator: str, instead: str
) -> None:
    """Raise InputError for inputs that formulas cannot use.

    Such inputs are priors, temperature coefficients and many trials.

    Raises
    ------
    InputError
    """
    refuse_priors(priors, estimator, instead)
    refuse_temperature_terms(sensor, estimator, instead)
    require_single_recording(observations, f"estimator {estimator}")
