"""The temperature of rows and samples, as the model of a sensor takes it.

ΔT is set where a problem is built, from the temperature that was recorded: neither benches nor
estimators handle it. Estimators that cannot take it say so by name.
"""

from dataclasses import replace

import numpy as np

from inercal.arrays import Array
from inercal.errors import InputError
from inercal.recording import TEMPERATURE_VARIATION, Observations, Track
from inercal.sensors import Sensor


def row_offsets(observations: Observations, sensor: Sensor) -> Array:
    """Return ΔT of each row, (..., r) K; () of 0 for a sensor that does not depend on it.

    Rows that differ by less than `TEMPERATURE_VARIATION` are at one temperature, their mean: what
    such differences tell of a coefficient is the noise of the temperature's sensor.

    Raises
    ------
    InputError
        Coefficients of temperature, and none was recorded.
    """
    if not sensor.uses("dT"):
        return np.zeros(())
    if observations.temperature is None:
        raise _missing_temperature_error(sensor)
    return _steady_values(observations.temperature_offset(sensor.reference_temperature))


def sample_offsets(track: Track, sensor: Sensor) -> Array:
    """Return ΔT of each sample, (..., n) K; of no samples, (0,), where a sensor depends on none.

    Raises
    ------
    InputError
        Coefficients of temperature, and none was recorded.
    """
    if not sensor.uses("dT"):
        return np.zeros(0)
    result = track.temperature_offset(sensor.reference_temperature)
    if result is None:
        raise _missing_temperature_error(sensor)
    return result


def offsets_at_times(track: Track, sensor: Sensor, time: Array) -> Array | None:
    """Return ΔT of one trial at some times, (e,) K; None where it was not recorded or is constant.

    Parameters
    ----------
    track : Track
    sensor : Sensor
    time : (e,) array
        s.
    """
    result = track.temperature_offset(sensor.reference_temperature)
    return (
        np.interp(time, track.time, result)
        if result is not None and track.temperature_varies
        else None
    )


def with_steady_temperature(track: Track) -> Track:
    """Return a whole track with a temperature that is constant where it hardly varies.

    As of `row_offsets`: not piece by piece, which would tell other temperatures of each.
    """
    if track.temperature is None:
        return track
    return replace(track, temperature=_steady_values(track.temperature))


def _steady_values(warmth: Array) -> Array:
    """Return temperatures, (..., r), that are the mean where they hardly vary."""
    mean = np.broadcast_to(warmth.mean(axis=-1, keepdims=True), warmth.shape)
    return np.where(np.ptp(warmth, axis=-1, keepdims=True) > TEMPERATURE_VARIATION, warmth, mean)


def temperature_coefficients(sensor: Sensor) -> list[str]:
    """Return the full names of a sensor's coefficients of temperature."""
    return [n for n in sensor.coefficients if sensor.coefficient(n).basis.uses("dT")]


def refuse_temperature_terms(sensor: Sensor, estimator: str, instead: str) -> None:
    """Refuse coefficients of temperature for an estimator that has no place for them.

    Parameters
    ----------
    sensor : Sensor
    estimator, instead : str
        Names of the estimator and of one that finds them.

    Raises
    ------
    InputError
    """
    if names := temperature_coefficients(sensor):
        raise InputError(
            f"estimator {estimator} finds no coefficients of temperature, {', '.join(names)}; "
            f"take {instead}, or leave them out"
        )


def refuse_temperature_terms_in_plan(sensor: Sensor) -> None:
    """Refuse coefficients of temperature where a plan stands for the data: it has no temperatures.

    Raises
    ------
    InputError
    """
    if names := temperature_coefficients(sensor):
        raise InputError(
            f"[method] {', '.join(names)}: a plan states no temperatures; leave them out, and add "
            "them for the recording"
        )


def _missing_temperature_error(sensor: Sensor) -> InputError:
    return InputError(
        f"[data] temperature is missing: {', '.join(temperature_coefficients(sensor))} need the "
        "column of the sensor's temperature; name it, or leave them out"
    )
