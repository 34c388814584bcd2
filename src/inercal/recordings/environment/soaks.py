"""Rows of soaks: which belong together, and the errors that they have in common.

The error δ of the temperature of a soak adds (∂y/∂T) δ to each reading of its rows; the slope
∂y/∂T is that of a first fit. A bias that comes back within s adds the same to all rows of a soak.
Both are independent from soak to soak and are marginalised: as columns of
`inercal.recordings.Observations.common`.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.physics.sensors import Sensor, inverse
from inercal.recordings import Observations
from inercal.recordings.environment import Environment

SOAK_SPREAD = 3.0  # K; rows further apart are of different soaks
_STEP = 0.01  # K, of the difference quotient; the curvature over it is far below rounding of data


def soak_numbers(observations: Observations) -> NDArray[np.int64]:
    """Return the number of the soak of each row, (r,), from 0 in the order of time.

    Rows that follow one another are of one soak while their temperatures stay within
    `SOAK_SPREAD` of that of its first row. A temperature that comes back later is another soak.

    Parameters
    ----------
    observations : Observations
        With temperatures; of several trials the first one's count.
    """
    assert observations.temperature is not None
    kelvin = observations.temperature.reshape(-1, observations.temperature.shape[-1])[0]
    number, first, result = -1, np.inf, np.zeros(kelvin.size, dtype=np.int64)
    for row in np.argsort(observations.time, kind="stable").tolist():
        if number < 0 or abs(kelvin[row] - first) > SOAK_SPREAD:
            number, first = number + 1, kelvin[row]
        result[row] = number
    return result


def soak_temperatures(observations: Observations) -> Array:
    """Return the mean temperature of each soak, (s,) K, in the order of time."""
    assert observations.temperature is not None
    kelvin = observations.temperature.reshape(-1, observations.temperature.shape[-1])[0]
    number = soak_numbers(observations)
    return np.bincount(number, kelvin) / np.bincount(number)


def distinct_levels(temperatures: Array) -> int:
    """Return the number of temperatures that differ by more than `SOAK_SPREAD`."""
    ordered = np.sort(temperatures)
    return 1 + int(np.count_nonzero(np.diff(ordered) > SOAK_SPREAD))


def temperature_slopes(observations: Observations, sensor: Sensor, c: Array) -> Array:
    """Return ∂y/∂T of each reading, (..., r, m) SI per K, at coefficients c (..., p).

    The motion of a row is that which its reading measures by c.
    """
    dT = observations.temperature_offset(sensor.reference_temperature)
    zero = np.zeros((1, 3))
    sensed = inverse(sensor, observations.mean, c, f=zero, w=zero, dT=dT, refuse=False)
    above = sensor.forward(replace(sensed, dT=dT + _STEP), c)
    below = sensor.forward(replace(sensed, dT=dT - _STEP), c)
    return (above - below) / (2 * _STEP)


def with_soak_errors(
    observations: Observations,
    sensor: Sensor,
    c: Array,
    environment: Environment,
    rates: Array | None = None,
) -> Observations:
    """Return the observations with the errors that the rows of a soak have in common.

    Parameters
    ----------
    observations : Observations
        With temperatures.
    sensor : Sensor
    c : (..., p) array
        Its coefficients by a first fit, SI.
    environment : Environment
    rates : (r,) array, optional
        Mean rate of the temperature in each row, K/s, by which an error of the lag acts.
    """
    number = soak_numbers(observations)
    member: Array = np.eye(int(number.max()) + 1)[number]  # (r, s)
    columns: list[Array] = []
    slope = temperature_slopes(observations, sensor, c)
    if environment.temperature_sd:
        columns.append(environment.temperature_sd * slope[..., None] * member[:, None, :])
    if rates is not None and environment.lag is not None and environment.lag.sd:
        columns.append((environment.lag.sd * rates[:, None] * slope)[..., None])
    sizes = {"f": environment.force_repeatability, "w": environment.rate_repeatability}
    for k, axis in enumerate(sensor.axes):
        if size := sizes[axis.measures]:
            column = np.zeros((*observations.mean.shape[-2:], member.shape[1]))
            column[:, k] = size * member
            columns.append(column)
    if not columns:
        return observations
    lead = np.broadcast_shapes(*(one.shape[:-1] for one in columns))
    widened = [np.broadcast_to(one, (*lead, one.shape[-1])) for one in columns]
    return replace(observations, common=np.concatenate(widened, axis=-1))
