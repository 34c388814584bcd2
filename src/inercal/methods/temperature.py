"""Provide the temperature of rows and samples in the form that the sensor models use.

ΔT is computed from the recorded temperature when a problem is built, so benches and estimators do
not handle temperatures.
"""

from dataclasses import replace

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.methods import Priors
from inercal.physics.sensors import Sensor
from inercal.recordings import Observations, Track
from inercal.recordings.temperature import TEMPERATURE_VARIATION


def row_offsets(observations: Observations, sensor: Sensor, priors: Priors = ()) -> Array:
    """Return ΔT of each row, (..., r) K; a scalar 0 if the sensor does not depend on temperature.

    Rows that differ by less than `TEMPERATURE_VARIATION` get their mean temperature, because
    such small differences do not determine coefficients. Rows keep their own temperatures if
    `priors` state all temperature coefficients.

    Raises
    ------
    InputError
        The sensor has temperature coefficients, but no temperature was recorded.
    """
    if not sensor.uses("dT"):
        return np.zeros(())
    if observations.temperature is None:
        raise _missing_temperature_error(sensor)
    offsets = observations.temperature_offset(sensor.reference_temperature)
    stated = set(temperature_coefficients(sensor)) <= {n for one in priors for n in one.names}
    return offsets if stated else _steady_values(offsets)


def sample_offsets(track: Track, sensor: Sensor) -> Array:
    """Return ΔT of each sample, (..., n) K, or (0,) if the sensor does not depend on it.

    Raises
    ------
    InputError
        The sensor has temperature coefficients, but no temperature was recorded.
    """
    if not sensor.uses("dT"):
        return np.zeros(0)
    result = track.temperature_offset(sensor.reference_temperature)
    if result is None:
        raise _missing_temperature_error(sensor)
    return result


def offsets_at_times(track: Track, sensor: Sensor, time: Array) -> Array | None:
    """Return ΔT in one trial at these times, (e,) K, or None if it is constant or not recorded.

    Parameters
    ----------
    track : Track
    sensor : Sensor
    time : (e,) array
        Times, s.
    """
    result = track.temperature_offset(sensor.reference_temperature)
    if result is None or not track.temperature_varies:
        return None
    return np.interp(time, track.time, result)


def with_steady_temperature(track: Track) -> Track:
    """Return a whole track with the temperature made constant if it hardly varies.

    The rule is that of `row_offsets`. It is not applied to pieces of a track, because each piece
    would have its own mean temperature.
    """
    if track.temperature is None:
        return track
    return replace(track, temperature=_steady_values(track.temperature))


def _steady_values(warmth: Array) -> Array:
    """Return temperatures, (..., r), replaced by their mean if they hardly vary."""
    mean = np.broadcast_to(warmth.mean(axis=-1, keepdims=True), warmth.shape)
    return np.where(np.ptp(warmth, axis=-1, keepdims=True) > TEMPERATURE_VARIATION, warmth, mean)


def temperature_coefficients(sensor: Sensor) -> list[str]:
    """Return the full names of a sensor's temperature coefficients."""
    return [n for n in sensor.coefficients if sensor.coefficient(n).basis.uses("dT", "dTdt")]


def refuse_temperature_terms_in_plan(sensor: Sensor) -> None:
    """Raise InputError if a plan replaces the data and the sensor has temperature coefficients.

    Raises
    ------
    InputError
        A plan has no temperatures; the message names the coefficients.
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
