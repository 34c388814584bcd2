"""Whether a recording that should be at rest moves: what no rest with a disturbance shows.

(a) Accelerometers: gravity turns in the case. The median of a window is compared with the median of
all windows; a change of 0.17 g, which gravity makes when it turns by 10°, is more than any bias
drifts and more than a slow tilt of a bench. (b) Gyros: the sensor turns by 10° within a window of
5 s, or the median rate changes by as much (2 °/s) within two windows. A bias drifts more slowly, so
that a temperature ramp passes whatever its size. Medians and integrals let knocks and bursts pass:
a vibration has a large rate and a small angle, unless the samples alias it to a slow swing.
"""

from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.units import si_factor
from inercal.noise.channel_noise import quantity_of
from inercal.physics.sensors import G0
from inercal.recordings import Recording

LARGEST_TURN = np.radians(10.0)  # of gravity in the case, or of the sensor within a window
WINDOW = 5.0  # s
_LARGEST_CHANGE = G0 * np.sin(LARGEST_TURN)  # m/s²
_FEWEST = 8  # windows
_DEVIATIONS = 8.0  # sd of a median by the white noise of the samples, which a change must exceed
_MEDIAN_ABS = 0.67449  # of the absolute value of a normal deviate
_MEDIAN_SD = 1.2533  # of a median over that of a mean, of normal deviates


def movement(recording: Recording) -> str:
    """Return how a sensor moved in a recording that should be at rest; empty for one at rest.

    Parameters
    ----------
    recording : Recording
        Units of rate or acceleration, (n, m); its samples may be block means.
    """
    step = recording.median_step
    count = len(recording.time)
    size = max(1, round(min(WINDOW, step * count / _FEWEST) / step))
    if count < 2 * size:
        return ""
    starts = (recording.time - recording.time[0])[: count // size * size : size]
    found: dict[str, list[_Windows]] = {"accelerometer": [], "gyro": []}
    for k, unit in enumerate(recording.units):
        y = recording.data[: count // size * size, k] * si_factor(unit)
        kind = quantity_of(unit, recording.channels[k])
        found[kind].append(_windows(y.reshape(-1, size), step))
    texts = (_turned_gravity(found["accelerometer"], starts), _turn(found["gyro"], starts))
    return "; ".join(text for text in texts if text)


class _Windows(NamedTuple):
    """What counts of the windows of a channel: medians, their sd by white noise, angles."""

    medians: Array
    sd: float
    angles: Array


def _windows(y: Array, step: float) -> _Windows:
    """Return the summary of windows, (w, n)."""
    size = y.shape[1]
    differences = float(np.median(np.abs(np.diff(y.ravel()))))
    sd = _MEDIAN_SD * differences / (np.sqrt(2) * _MEDIAN_ABS) / np.sqrt(size)
    # Of each window its own mean: a bias turns nothing.
    angles = np.cumsum(y - y.mean(axis=1, keepdims=True), axis=1) * step
    extent: Array = angles.max(axis=1) - angles.min(axis=1)
    medians: Array = np.median(y, axis=1)
    return _Windows(medians, float(sd), extent)


def _turned_gravity(channels: list[_Windows], starts: Array) -> str:
    """Return how far the accelerometers' level leaves its median; empty where it stays."""
    if not channels:
        return ""
    medians = np.stack([one.medians for one in channels], axis=1)
    away = np.linalg.norm(medians - np.median(medians, axis=0), axis=1)
    limit = max(_LARGEST_CHANGE, _DEVIATIONS * float(np.hypot.reduce([c.sd for c in channels])))
    worst = int(np.argmax(away))
    if away[worst] <= limit:
        return ""
    return (
        f"the accelerometers read {away[worst] / G0:.2g} g from their median at "
        f"{starts[worst]:.4g} s, and more than {limit / G0:.2g} g from it in "
        f"{100 * np.count_nonzero(away > limit) / away.size:.0f} % of the time"
    )


def _turn(channels: list[_Windows], starts: Array) -> str:
    """Return how far the gyros turn or change within 5 s; empty where they do neither."""
    if not channels:
        return ""
    sd = float(np.hypot.reduce([one.sd for one in channels]))
    medians = np.stack([one.medians for one in channels], axis=1)
    changes = np.zeros(len(medians))
    for lag in (1, 2):
        apart = np.linalg.norm(medians[lag:] - medians[:-lag], axis=1)
        changes[lag:] = np.maximum(changes[lag:], apart)
    worst = int(np.argmax(changes))
    if changes[worst] > max(LARGEST_TURN / WINDOW, _DEVIATIONS * sd):
        return (
            f"the gyros' rate changes by {np.degrees(changes[worst]):.3g} °/s within 10 s at "
            f"{starts[worst]:.4g} s, which no bias does"
        )
    turns = np.linalg.norm([one.angles for one in channels], axis=0)
    worst = int(np.argmax(turns))
    if turns[worst] <= max(LARGEST_TURN, _DEVIATIONS * sd * WINDOW):
        return ""
    return f"the gyros turn by {np.degrees(turns[worst]):.3g}° within 5 s at {starts[worst]:.4g} s"
