"""Common errors of temperatures and biases, for estimators that do not weigh them.

Temperatures that are all δ too high give the polynomial b(T − δ): the coefficient of order k − 1
moves by −k c_k δ, whatever the estimator. Errors of single soaks move an estimate by what it moves
when the readings, or the temperatures, of the soak are changed by their standard deviation.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.keys import CoefficientName
from inercal.estimation import Estimate
from inercal.physics.sensors import Sensor
from inercal.recordings import Observations, Transitions
from inercal.recordings.environment import Environment
from inercal.recordings.environment.soaks import soak_numbers


def with_temperature_shift(estimate: Estimate, sensor: Sensor, sd: float) -> Estimate:
    """Return an estimate with an error of all temperatures in its covariance.

    Parameters
    ----------
    estimate : Estimate
        Of one trial; its first parameters are the sensor's coefficients. A lowest order that was
        not estimated has its place in "constant[axis]", if there is any.
    sensor : Sensor
    sd : float
        K.
    """
    if not sd:
        return estimate
    names, moved = estimate.names, np.zeros(len(estimate.names))
    terms = {name: sensor.coefficient(name) for name in sensor.coefficients}
    places = {
        (CoefficientName(name).axis, one.without_temperature, one.temperature_order): at
        for at, (name, one) in enumerate(terms.items())
    }
    for (axis, base, order), at in places.items():
        if not order:
            continue
        lower = places.get((axis, base, order - 1))
        if lower is None and f"constant[{axis}]" in names:
            lower = names.index(f"constant[{axis}]")
        if lower is not None:
            moved[lower] -= order * estimate.value[at]
    return with_added_covariance(estimate, sd**2 * np.outer(moved, moved))


def with_added_covariance(estimate: Estimate, added: Array) -> Estimate:
    """Return an estimate with a further covariance, (p, p), which no Birge ratio enlarges."""
    covariance = estimate.covariance + added / float(estimate.birge) ** 2
    return replace(estimate, covariance=covariance)


def changed_by_soak_errors(
    observations: Observations, sensor: Sensor, environment: Environment
) -> Iterator[Observations]:
    """Yield the observations changed by each error of a soak, by its standard deviation.

    Parameters
    ----------
    observations : Observations
        Of one trial, with temperatures.
    sensor : Sensor
    environment : Environment
    """
    number, kelvin = soak_numbers(observations), observations.temperature
    assert kelvin is not None
    sizes = {"f": environment.force_repeatability, "w": environment.rate_repeatability}
    for soak in range(int(number.max()) + 1):
        member = number == soak
        path = observations.transitions
        samples = None if path is None else _samples_of_soak(observations, path, number, soak)
        if environment.temperature_sd:
            warmer = path
            if path is not None and path.temperature is not None:
                warmth = path.temperature + environment.temperature_sd * np.asarray(samples)
                warmer = replace(path, temperature=warmth)
            yield replace(
                observations,
                temperature=kelvin + environment.temperature_sd * member,
                transitions=warmer,
            )
        for k, axis in enumerate(sensor.axes):
            if not sizes[axis.measures]:
                continue
            mean = observations.mean.copy()
            mean[member, k] += sizes[axis.measures]
            moved = path
            if path is not None:
                output = path.output.copy()
                output[samples, k] += sizes[axis.measures] * axis.readout.scale
                moved = replace(path, output=output)
            yield replace(observations, mean=mean, transitions=moved)


def _samples_of_soak(
    observations: Observations, path: Transitions, number: NDArray[np.int64], soak: int
) -> NDArray[np.bool_]:
    """Return which samples are of a soak: from its first row to that of the next, (n,)."""
    order = np.argsort(observations.time, kind="stable")
    row = np.searchsorted(observations.time[order], path.time, side="right") - 1
    return number[order][np.maximum(row, 0)] == soak
