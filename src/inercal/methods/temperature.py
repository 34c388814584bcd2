"""The temperature of rows and samples, as the model of a sensor takes it.

ΔT is set where a problem is built, from the recorded temperature: neither benches nor estimators
handle it.
"""

from dataclasses import replace

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.physics.sensors import Sensor
from inercal.recordings import Observations, Track
from inercal.recordings.temperature import TEMPERATURE_VARIATION


def row_offsets(observations: Observations, sensor: Sensor) -> Array:
    """Return ΔT of each row, (..., r) K; () of 0 for a sensor that does not depend on it.

    Rows that differ by less than `TEMPERATURE_VARIATION` are at one temperature, their mean:
    smaller differences are noise of the temperature's sensor.

    Raises
    ------
    InputError
        The sensor has coefficients of temperature, and no temperature was recorded.
    """
    if not sensor.uses("dT"):
        return np.zeros(())
    if observations.temperature is None:
        raise _missing_temperature_error(sensor)
    return _steady_values(observations.temperature_offset(sensor.reference_temperature))


def sample_offsets(track: Track, sensor: Sensor) -> Array:
    """Return ΔT of each sample, (..., n) K; (0,) for a sensor that does not depend on it.

    Raises
    ------
    InputError
        The sensor has coefficients of temperature, and no temperature was recorded.
    """
    if not sensor.uses("dT"):
        return np.zeros(0)
    result = track.temperature_offset(sensor.reference_temperature)
    if result is None:
        raise _missing_temperature_error(sensor)
    return result


def offsets_at_times(track: Track, sensor: Sensor, time: Array) -> Array | None:
    """Return ΔT of one trial at these times, (e,) K; None if not recorded or constant.

    Parameters
    ----------
    track : Track
    sensor : Sensor
    time : (e,) array
        s.
    """
    result = track.temperature_offset(sensor.reference_temperature)
    if result is None or not track.temperature_varies:
        return None
    return np.interp(time, track.time, result)


def with_steady_temperature(track: Track) -> Track:
    """Return a whole track with a temperature that is constant where it hardly varies.

    As `row_offsets`. Not piece by piece: each piece would have its own mean temperature.
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
    return [n for n in sensor.coefficients if sensor.coefficient(n).basis.uses("dT", "dTdt")]


def refuse_temperature_terms_in_plan(sensor: Sensor) -> None:
    """Refuse coefficients of temperature where a plan replaces the data: it has no temperatures.

    Raises
    ------
    InputError
        Naming the coefficients.
    """
    if names := tuple(temperature_coefficients(sensor)):
        raise InputError(
            f"[method] {', '.join(names)}: a plan has no temperatures; remove these "
            "coefficients for the plan, and add them for the recording",
            key="[method]",
            names=names,
        )


def _missing_temperature_error(sensor: Sensor) -> InputError:
    names = tuple(temperature_coefficients(sensor))
    return InputError(
        f"[data] temperature is missing: {', '.join(names)} need the sensor's temperature; name "
        "its column, or remove these coefficients",
        key="[data] temperature",
        names=names,
    )
