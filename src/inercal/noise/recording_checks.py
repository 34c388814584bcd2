"""Check the units, motion and rounding in a recording of a sensor that should be at rest.

Units are checked as in a calibration: the norm of three perpendicular accelerometers must be
gravity. This is not possible with one or two accelerometers, which may be perpendicular to gravity,
or with more than three, which are not at right angles to each other. In these cases, only readings
that are too large are detected.

Motion is a change that no disturbance at rest can explain. (a) Accelerometers: the direction of
gravity in the sensor's case changes. The median of each window is compared with the median of all
windows. The limit is a change of 0.17 g, which occurs if the sensor tilts by 10°. This limit
exceeds the drift of any bias and the slow tilt of a bench. (b) Gyros: the sensor turns by 10°
within a window of 5 s, or the median rate changes by the corresponding 2 °/s within two windows. A
bias drifts more slowly, so a temperature ramp of any size passes. Knocks and bursts hardly affect
medians and integrals: a vibration has a large rate but a small angle, unless sampling aliases the
vibration to a slow swing.

If rounding to steps hides the noise, N cannot be determined. If the noise is below half a step, the
scatter of the readings depends on where the mean lies between two steps. If the noise is 0.4 of a
step, the reported N is 1.15 to 1.31 times too large. At 0.2 of a step, the reported N is 0.56 to
2.5 times the true value.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units import si_factor
from inercal.noise.channel_noise import QUANTITIES, quantity_of
from inercal.physics.quantities import SensorKind
from inercal.physics.sensors import G0
from inercal.recordings import Recording
from inercal.recordings.io.rest_norm import (
    LARGEST_BIAS,
    norm_at_rest,
    norm_finding,
    rate_finding,
    rest_norm_text,
)

_TRIAD = 3
LARGEST_TURN = np.radians(10.0)  # tilt against gravity, or turn within a window
WINDOW = 5.0  # s
_LARGEST_CHANGE = G0 * np.sin(LARGEST_TURN)  # m/s²
_FEWEST = 8  # windows
_DEVIATIONS = 8.0  # a change must exceed this many sd (white noise) of a median
_MEDIAN_ABS = 0.67449  # median absolute value of a normal deviate
_MEDIAN_SD = 1.2533  # sd of a median over the sd of a mean, for normal deviates
REFUSED, WARNED = 0.4, 1.5  # sd of the noise divided by the step
_LEAST_RATIO = 0.01  # of a step; less cannot be told from rounding
_LOOKED_AT = 100_000  # samples
_EVEN = 1e-3  # of a step
_LAGS = (1, 4, 16, 64)


def check_rest_units(recording: Recording, gravity: float | None) -> tuple[str, ...]:
    """Return remarks on readings that are not plausible for a sensor at rest with these units.

    Parameters
    ----------
    recording : Recording
        Recording in units of rate or acceleration, (n, m); its samples may be block means.
    gravity : float or None
        Local gravity, m/s². None if the readings do not contain gravity or if the sensor is carried
        around.

    Raises
    ------
    InputError
        The accelerometers' readings cannot be gravity.
    """
    if gravity is None:
        return ()
    columns: dict[SensorKind, list[int]] = {one: [] for one in QUANTITIES}
    for k, unit in enumerate(recording.units):
        columns[quantity_of(unit, recording.channels[k])].append(k)
    found = columns["accelerometer"]
    together = [found] if len(found) <= _TRIAD else [[k] for k in found]
    remarks: list[str] = []
    for group in filter(None, together):
        norm = norm_at_rest(lambda rows, group=group: _in_si(recording, rows, group), recording)
        if len(group) < _TRIAD and norm <= gravity:
            continue
        text, unit = rest_norm_text(norm, gravity), recording.units[group[0]]
        finding = norm_finding(norm, gravity, text, unit)
        if finding is None:
            continue
        if finding.severity == "refused":
            raise InputError(
                f"{recording.source or 'recording'}: {finding.message}; for a log use --set "
                "sensor.accelerometer.unit=…",
                file=recording.source or None,
                key="[sensor.accelerometer] unit",
            )
        remarks.append(finding.message)
    rates = [
        (recording.channels[k], float(np.median(recording.data[:, k])) * si_factor(unit))
        for k, unit in enumerate(recording.units)
        if k in columns["gyro"]
    ]
    large = rate_finding([one for one in rates if abs(one[1]) > LARGEST_BIAS], "")
    return (*remarks, *(() if large is None else (large.message,)))


def _in_si(recording: Recording, rows: slice, columns: list[int]) -> Array:
    sizes = np.array([si_factor(recording.units[k]) for k in columns])
    return recording.data[rows][:, columns] * sizes


def movement(recording: Recording) -> str:
    """Describe how a sensor moved in a recording that should be at rest; empty if it did not.

    Parameters
    ----------
    recording : Recording
        Recording in units of rate or acceleration, (n, m); its samples may be block means.
    """
    step = recording.median_step
    count = len(recording.time)
    size = max(1, round(min(WINDOW, step * count / _FEWEST) / step))
    if count < 2 * size:
        return ""
    starts = (recording.time - recording.time[0])[: count // size * size : size]
    found: dict[SensorKind, list[_Windows]] = {one: [] for one in QUANTITIES}
    for k, unit in enumerate(recording.units):
        y = recording.data[: count // size * size, k] * si_factor(unit)
        kind = quantity_of(unit, recording.channels[k])
        found[kind].append(_windows(y.reshape(-1, size), step))
    texts = (_turned_gravity(found["accelerometer"], starts), _turn(found["gyro"], starts))
    return "; ".join(text for text in texts if text)


class _Windows(NamedTuple):
    """Statistics of a channel's windows: medians, their sd due to white noise, and angles."""

    medians: Array
    sd: float
    angles: Array


def _windows(y: Array, step: float) -> _Windows:
    """Return the statistics of windows, (w, n)."""
    size = y.shape[1]
    differences = float(np.median(np.abs(np.diff(y.ravel()))))
    sd = _MEDIAN_SD * differences / (np.sqrt(2) * _MEDIAN_ABS) / np.sqrt(size)
    # Subtract the mean of each window, because a bias is not a rotation.
    angles = np.cumsum(y - y.mean(axis=1, keepdims=True), axis=1) * step
    extent: Array = angles.max(axis=1) - angles.min(axis=1)
    medians: Array = np.median(y, axis=1)
    return _Windows(medians, float(sd), extent)


def _turned_gravity(channels: list[_Windows], starts: Array) -> str:
    """Describe how far the accelerometers depart from their medians; empty if they do not."""
    if not channels:
        return ""
    medians = np.stack([one.medians for one in channels], axis=1)
    away = np.linalg.norm(medians - np.median(medians, axis=0), axis=1)
    limit = max(_LARGEST_CHANGE, _DEVIATIONS * float(np.hypot.reduce([c.sd for c in channels])))
    worst = int(np.argmax(away))
    if away[worst] <= limit:
        return ""
    return (
        f"the accelerometers read {away[worst] / G0:.2g} g away from their median at "
        f"{starts[worst]:.6g} s, and more than {limit / G0:.2g} g away from it during "
        f"{100 * np.count_nonzero(away > limit) / away.size:.2g} % of the time"
    )


def _turn(channels: list[_Windows], starts: Array) -> str:
    """Describe a rotation or a change of rate within 5 s; empty if there is none."""
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
            f"the rate of the gyros changes by {np.degrees(changes[worst]):.3g} °/s within 10 "
            f"s at {starts[worst]:.6g} s, which is too fast for a bias"
        )
    turns = np.linalg.norm([one.angles for one in channels], axis=0)
    worst = int(np.argmax(turns))
    if turns[worst] <= max(LARGEST_TURN, _DEVIATIONS * sd * WINDOW):
        return ""
    return f"the gyros turn by {np.degrees(turns[worst]):.3g}° within 5 s at {starts[worst]:.6g} s"


def rounding_step(y: Array) -> float:
    """Return the step to which readings are rounded, in their unit; 0 if no step is detected."""
    values = np.unique(y[:_LOOKED_AT])
    if values.size < 2 or values.size > 0.5 * min(y.size, _LOOKED_AT):
        return 0.0
    gaps = np.diff(values)
    # Values that differ only by arithmetic rounding are the same value.
    gaps = gaps[gaps > 1e-9 * np.abs(values).max()]
    if not gaps.size:
        return 0.0
    step = float(gaps.min())
    off = np.abs(gaps / step - np.rint(gaps / step))
    return step if off.max() < _EVEN * max(1.0, float((gaps / step).max())) else 0.0


def noise_over_step(y: Array, step: float) -> float:
    """Return the sd of the noise divided by the step; the rounding noise (step²/12) is excluded.

    Differences at several lags are used, because differences between neighbours are small after a
    low-pass filter.
    """
    lags = [lag for lag in _LAGS if 2 * lag <= y.size]
    variance = max(float(np.mean((y[lag:] - y[:-lag]) ** 2)) for lag in lags) / 2
    return float(np.sqrt(max(variance / step**2 - 1 / 12, 0.0)))


def check_rounding(parts: Sequence[Array], channel: str, source: str) -> tuple[str, ...]:
    """Return remarks on the rounding of a channel's pieces.

    Raises
    ------
    InputError
        The noise is below 0.4 of a step, or the channel does not change at all.
    """
    where = f"{source or 'recording'}: channel {channel}"
    longest = max(parts, key=len)
    if not np.ptp(longest) > 0:
        raise InputError(
            f"{where} does not change, so it has no noise to analyse", names=(channel,)
        )
    step = rounding_step(longest)
    if not step:
        return ()
    ratio = noise_over_step(longest, step)
    if ratio < REFUSED:
        size = f"only {ratio:.2g}" if ratio > _LEAST_RATIO else f"less than {_LEAST_RATIO:g}"
        raise InputError(
            f"{where} is rounded to steps, and its noise is {size} of a step. Below "
            f"{REFUSED:g} rounding hides the noise; record with a finer resolution or a narrower "
            "range",
            file=source or None,
            names=(channel,),
        )
    times = np.sqrt(1 + 1 / (12 * ratio**2))  # rounding adds its variance, step²/12
    if ratio < WARNED:
        text = (
            f"the noise is only {ratio:.2g} rounding steps, so N may be {times:.2f} times too large"
        )
        return (text,)
    if times - 1 > 1 / np.sqrt(2 * sum(map(len, parts))):  # u(N)/N
        return (f"rounding to steps adds {100 * (times - 1):.2g} % to N, more than its u",)
    return ()
