"""Include the errors that the rows of a soak share, and find the hysteresis over soaks.

An error δ of a soak's temperature adds (∂y/∂T) δ to each reading of its rows; the slope ∂y/∂T comes
from a first fit. A bias that repeats within a standard deviation s adds the same error to all rows
of a soak. Both errors differ independently from soak to soak. They are marginalised by adding them
as columns of `inercal.recordings.Observations.common`.

Some estimators do not use this covariance. If all temperatures are too high by δ, every estimator
finds the polynomial b(T − δ), so the coefficient of order k − 1 changes by −k c_k δ. For errors of
single soaks, the readings or temperatures of one soak are changed by their standard deviation, and
the resulting change of the estimate is its uncertainty.

The hysteresis over soaks is the difference between the biases at the same temperature when it is
reached from below and from above.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple, TypeVar

import numpy as np

from inercal.basics.arrays import Array, Bools, Indices
from inercal.basics.keys import CoefficientName
from inercal.estimation import Estimate
from inercal.physics.sensors import Sensor, inverse
from inercal.recordings import Observations, Track, Transitions
from inercal.recordings.environment import Environment

SOAK_SPREAD = 3.0  # K; rows that differ by more belong to different soaks
_STEP = 0.01  # K, step of the difference quotient; curvature over it is far below data rounding


def soak_numbers(observations: Observations) -> Indices:
    """Return the number of the soak of each row, (r,), counted from 0 in time order.

    Consecutive rows belong to the same soak as long as their temperatures stay within `SOAK_SPREAD`
    of that of its first row. If the same temperature is reached again later, another soak begins.

    Parameters
    ----------
    observations : Observations
        Observations with temperatures; with several trials, only those of the first one are used.
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
    """Return the mean temperatures of the soaks in time order, (s,) K."""
    assert observations.temperature is not None
    kelvin = observations.temperature.reshape(-1, observations.temperature.shape[-1])[0]
    number = soak_numbers(observations)
    return np.bincount(number, kelvin) / np.bincount(number)


def distinct_levels(temperatures: Array) -> int:
    """Return the number of temperatures that differ by more than `SOAK_SPREAD`."""
    ordered = np.sort(temperatures)
    return 1 + int(np.count_nonzero(np.diff(ordered) > SOAK_SPREAD))


def temperature_slopes(observations: Observations, sensor: Sensor, c: Array) -> Array:
    """Return ∂y/∂T for each reading, (..., r, m) SI per K, at coefficients c (..., p).

    The motion in each row is computed from its reading with the coefficients c.
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
    """Return the observations with the errors that the rows of each soak share.

    Parameters
    ----------
    observations : Observations
        Observations with temperatures.
    sensor : Sensor
    c : (..., p) array
        The sensor's coefficients from a first fit, SI.
    environment : Environment
    rates : (r,) array, optional
        Mean rate of temperature change in each row, K/s; an error of the lag acts in proportion to
        it.
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


class SoakLoop(NamedTuple):
    """Half of the difference, rising minus falling, between two soaks at the same temperature.

    Parameters
    ----------
    temperature : float
        Temperature, K.
    half : (m,) array
        Half the difference of the mean residuals of each axis, SI.
    """

    temperature: float
    half: Array


def soak_loops(observations: Observations, residual: Array) -> tuple[SoakLoop, ...]:
    """Return the hysteresis loops of a run that reaches a temperature from below and from above.

    Parameters
    ----------
    observations : Observations
        Observations with r rows and m axes, one trial.
    residual : (r m,) array
        Residuals of a fit to these observations, SI; with any other size, no loops are returned.
    """
    r, m = observations.mean.shape[-2:]
    if residual.shape != (r * m,):
        return ()
    number, kelvin = soak_numbers(observations), soak_temperatures(observations)
    mean = np.stack([residual.reshape(r, m)[number == k].mean(axis=0) for k in range(kelvin.size)])
    rising = np.diff(kelvin, prepend=kelvin[0]) > 0
    falling = np.diff(kelvin, prepend=kelvin[0]) < 0
    found: list[SoakLoop] = []
    for k in np.flatnonzero(falling).tolist():
        near = np.flatnonzero(rising & (np.abs(kelvin - kelvin[k]) < SOAK_SPREAD)).tolist()
        if near:
            found.append(SoakLoop(float(kelvin[k]), 0.5 * (mean[near].mean(axis=0) - mean[k])))
    return tuple(found)


def with_temperature_shift(estimate: Estimate, sensor: Sensor, sd: float) -> Estimate:
    """Return an estimate whose covariance includes a common error of all temperatures.

    Parameters
    ----------
    estimate : Estimate
        Estimate for one trial; its first parameters are the sensor's coefficients. If the lowest
        order of a polynomial was not estimated, "constant[axis]" takes its place, if present.
    sensor : Sensor
    sd : float
        Standard deviation of the common temperature error, K.
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
    """Add to an estimate a covariance that the Birge ratio does not enlarge, (p, p)."""
    covariance = estimate.covariance + added / float(estimate.birge) ** 2
    return replace(estimate, covariance=covariance)


def changed_by_soak_errors(
    observations: Observations, sensor: Sensor, environment: Environment
) -> Iterator[Observations]:
    """Yield the observations once for each soak error, changed by one standard deviation of it.

    Parameters
    ----------
    observations : Observations
        Observations of one trial, with temperatures.
    sensor : Sensor
    environment : Environment
    """
    number, kelvin = soak_numbers(observations), observations.temperature
    assert kelvin is not None
    sizes = {"f": environment.force_repeatability, "w": environment.rate_repeatability}
    for soak in range(int(number.max()) + 1):
        member = number == soak
        path, track = observations.transitions, observations.track
        samples = None if path is None else _samples_of_soak(observations, path.time, number, soak)
        followed = (
            None if track is None else _samples_of_soak(observations, track.time, number, soak)
        )
        if sd := environment.temperature_sd:
            yield replace(
                observations,
                temperature=kelvin + sd * member,
                transitions=_warmed(path, samples, sd),
                track=_warmed(track, followed, sd),
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
            shifted = track
            if track is not None:
                reading = track.reading.copy()
                reading[..., followed, k] += sizes[axis.measures]
                shifted = replace(track, reading=reading)
            yield replace(observations, mean=mean, transitions=moved, track=shifted)


_Samples = TypeVar("_Samples", Transitions, Track)


def _warmed(samples: _Samples | None, chosen: Bools | None, kelvin: float) -> _Samples | None:
    """Return samples of which the chosen ones are warmer by some K, if a temperature is known."""
    if samples is None or samples.temperature is None:
        return samples
    return replace(samples, temperature=samples.temperature + kelvin * np.asarray(chosen))


def _samples_of_soak(observations: Observations, time: Array, number: Indices, soak: int) -> Bools:
    """Return which samples belong to a soak, (n,): from its first row to that of the next one."""
    order = np.argsort(observations.time, kind="stable")
    row = np.searchsorted(observations.time[order], time, side="right") - 1
    return number[order][np.maximum(row, 0)] == soak
