"""The course of a recorded temperature: whether it varies, its rate, and its lag.

A temperature sensor with the lag τ reads R while the sensing element is at T = R + τ dR/dt.
"""

from dataclasses import replace

import numpy as np

from inercal.basics.arrays import Array
from inercal.recordings.samples import Recording

SMOOTHING = 8.0  # s; longer would bias lags of 20 s, shorter leaves the sensor's noise in the rate
TEMPERATURE_VARIATION = 0.5  # K; a smaller variation counts as constant temperature


def temperature_varies(kelvin: Array | None) -> bool:
    """Return whether temperatures, (..., n) K, differ by more than `TEMPERATURE_VARIATION`."""
    if kelvin is None:
        return False
    return float(np.ptp(kelvin, axis=-1).max(initial=0.0)) > TEMPERATURE_VARIATION


def temperature_rate(time: Array, kelvin: Array) -> Array:
    """Return the time derivative of a temperature, (..., n) K/s, smoothed over `SMOOTHING`.

    Parameters
    ----------
    time : (n,) array
        s.
    kelvin : (..., n) array
        K.
    """
    if time.size < 2:
        return np.zeros(kelvin.shape)
    step = float(time[-1] - time[0]) / (time.size - 1)
    half = int(min(SMOOTHING / 4 / step, (time.size - 1) / 4))
    return np.gradient(_box(_box(kelvin, half), half), time, axis=-1)


def ahead_of_lag(recording: Recording, lag: float) -> Recording:
    """Return a recording with the temperature of the sensing element, R + τ dR/dt, for a lag, s."""
    kelvin = recording.temperature
    if kelvin is None or not lag:
        return recording
    return replace(recording, temperature=kelvin + lag * temperature_rate(recording.time, kelvin))


def _box(values: Array, half: int) -> Array:
    """Return means over 2 half + 1 samples; beyond the ends the course goes on evenly."""
    if half < 1:
        return values
    first, last = values[..., :1], values[..., -1:]
    before = 2 * first - values[..., half:0:-1]
    after = 2 * last - values[..., -2 : -half - 2 : -1]
    middle = values.mean(axis=-1, keepdims=True)
    padded = np.concatenate([before, values, after], axis=-1) - middle
    total = np.cumsum(np.concatenate([np.zeros_like(first), padded], axis=-1), axis=-1)
    width = 2 * half + 1
    return middle + (total[..., width:] - total[..., :-width]) / width
