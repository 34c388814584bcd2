"""Detect the holds of a turntable, and the turns of single axes, from its readback.

The table holds if no axis moves by more than its noise within a second. Holds are cut where samples
are missing and where the label changes, and the settling time is removed at both ends. An axis
turns if it is the only one with a rate. A label, or an angle of more than half a turn,
distinguishes a turn from a move to the next position, for which the table takes the shorter way.
"""
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false

from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.recordings import STAMP_ROUNDING, Indices, sample_count

_WINDOW = 1.0  # s
_LEAST = 1.0  # s, shortest hold without its settling
_APART = 0.5  # s without a sample, after which a hold ends
_NOISE = 10.0  # standard deviations: largest range of the readings in a second due to noise
_STILL = 4.8e-5  # rad, 10″; a smaller motion in a second is table control; the earth turns by 15″
_QUANTA = 2.5
_COARSEST = 5e-4  # rad, 0.03°, coarsest step of a readback
_DUST = 1e-9  # rad; smaller steps come from rounding
_SPAN = 0.1  # s before and after a sample, over which its rate is computed
_SLOWEST = 9e-4  # rad/s, 0.05 °/s
_BLOCK = 1 << 16  # samples
_HALF = 3.15  # rad; an unlabelled turn is larger than a move between two positions
_SETTLES = 0.02  # rad, 1°; a labelled turn is larger than the overshoot of a servo


class AxisTurn(NamedTuple):
    """A turn of a single axis, samples `start` to `stop`, half open."""

    axis: int
    start: int
    stop: int
    angle: float  # rad
    rate: float  # rad/s, the median


def hold_limits(angles: Array) -> Array:
    """Return the largest motion of each axis within a second that still counts as a hold, (k,) rad.

    Parameters
    ----------
    angles : (n, k) array
        Unwrapped readback angles, rad.
    """
    limits: list[float] = []
    for column in angles.T:
        # At a steady rate the second differences are noise with 1 + 4 + 1 times its variance.
        bent = np.abs(np.diff(column, 2))
        noise = float(np.median(bent)) / (0.6745 * 6**0.5) if bent.size else 0.0
        steps = np.abs(np.diff(column))
        resolution = float(steps[steps > _DUST].min(initial=np.inf))
        coarse = _QUANTA * resolution if resolution < _COARSEST else 0.0
        limits.append(max(_STILL, _NOISE * noise, coarse))
    return np.array(limits)


def find_holds(
    time: Array, angles: Array, labels: NDArray[np.str_] | None, settling: float
) -> Indices:
    """Return the holds, (h, 2), as half-open ranges of samples.

    Parameters
    ----------
    time : (n,) array
        Time of each sample, s.
    angles : (n, k) array
        Unwrapped readback angles, rad.
    labels : (n,) array of str or None
        Labels of the samples; a hold ends where the label changes.
    settling : float
        Time to remove at both ends of a hold, except at the ends of the recording, s.
    """
    n = time.size
    if n < 2:
        return np.zeros((0, 2), dtype=np.int64)
    window = max(_samples(time, _WINDOW), 2) + 1
    quiet = np.ones(n, dtype=np.bool_)
    for column, most in zip(angles.T, hold_limits(angles), strict=True):
        own = np.ascontiguousarray(column)
        reach = scipy.ndimage.maximum_filter1d(own, window) - scipy.ndimage.minimum_filter1d(
            own, window
        )
        quiet &= reach <= most
    held = scipy.ndimage.maximum_filter1d(quiet.astype(np.uint8), window).astype(np.bool_)
    settled = np.zeros(n, dtype=np.bool_)
    for start, stop in _runs(held, np.zeros(n - 1, dtype=np.bool_)).tolist():
        wait = settling - STAMP_ROUNDING
        first = np.searchsorted(time, time[start] + wait) if start else 0
        last = np.searchsorted(time, time[stop - 1] - wait, "right") if stop < n else n
        settled[first:last] = True
    parted = np.diff(time) > _APART
    if labels is not None:
        parted |= (labels[1:] != labels[:-1]) & (labels[1:] != "") & (labels[:-1] != "")
    return select_long_holds(time, _runs(settled, parted))


def select_long_holds(time: Array, holds: Indices) -> Indices:
    """Return the holds that last at least a second, (h, 2)."""
    return holds[time[holds[:, 1] - 1] - time[holds[:, 0]] >= _LEAST * (1 - 1e-3)]


def holds_from_numbers(time: Array, number: Array) -> Indices:
    """Return the holds, (h, 2), given each sample's hold number, (n,), negative outside holds."""
    parted = (np.diff(time) > _APART) | (number[1:] != number[:-1])
    return _runs(number >= 0, parted)


def _runs(wanted: NDArray[np.bool_], parted: NDArray[np.bool_]) -> Indices:
    """Return the half-open runs of wanted samples, (r, 2), cut where `parted` is true."""
    cut = np.flatnonzero((wanted[1:] != wanted[:-1]) | parted) + 1
    bounds = np.stack([np.append(0, cut), np.append(cut, wanted.size)], axis=-1)
    return bounds[wanted[bounds[:, 0]]].astype(np.int64)


def find_turns(time: Array, angles: Array, labels: NDArray[np.str_] | None) -> tuple[AxisTurn, ...]:
    """Return the turns of single axes, sorted by time; see `find_holds` for the arguments."""
    if time.size < 2:
        return ()
    rate = _rates(time, angles)
    least = np.maximum(_SLOWEST, hold_limits(angles) / _SPAN)
    sense = (rate > least).astype(np.int8) - (rate < -least)
    cut = np.flatnonzero((sense[1:] != sense[:-1]).any(axis=1)) + 1
    start, stop = np.append(0, cut), np.append(cut, time.size)
    alone = (sense[start] != 0).sum(axis=1) == 1
    turns: list[AxisTurn] = []
    margin = _samples(time, _SPAN)
    for a, b in zip(start[alone].tolist(), stop[alone].tolist(), strict=True):
        axis = int(np.argmax(sense[a] != 0))
        a, b = _extend_to_rest(sense[:, axis], a, b, 2 * margin + 1)
        # Close to a start, a stop or a reversal, the rate is too small to be detected.
        reach = float(np.ptp(angles[max(a - margin, 0) : b + margin, axis]))
        angle = float(sense[a, axis]) * reach
        named = labels is not None and bool(labels[(a + b) // 2])
        if abs(angle) > (_SETTLES if named else _HALF):
            turns.append(AxisTurn(axis, a, b, angle, float(np.median(rate[a:b, axis]))))
    return tuple(turns)


def _extend_to_rest(sense: NDArray[np.int8], start: int, stop: int, most: int) -> tuple[int, int]:
    """Extend a turn to rest if another axis starts soon after it or stopped shortly before it.

    A rate over a span begins too early and ends too late, so the rest is halfway between the axes.
    The mean over a turn must extend from rest to rest, otherwise it depends on the latency.
    """
    other = sense != sense[start]
    begin = max(start - most, 0)
    before = np.flatnonzero(other[begin:start])
    after = np.flatnonzero(other[stop : stop + most])
    first = (begin + int(before[-1]) + 1 + start) // 2 if before.size else start
    return first, stop + int(after[0]) // 2 if after.size else stop


def _rates(time: Array, angles: Array) -> Array:
    """Return the rate of each axis around each sample, (n, k) rad/s."""
    n, reach = time.size, _samples(time, _SPAN)
    rate = np.empty_like(angles)
    for start in range(0, n, _BLOCK):
        at = np.arange(start, min(start + _BLOCK, n))
        after, before = np.minimum(at + reach, n - 1), np.maximum(at - reach, 0)
        rate[at] = (angles[after] - angles[before]) / (time[after] - time[before])[:, None]
    return rate


def _samples(time: Array, seconds: float) -> int:
    return max(sample_count(seconds, float(np.median(np.diff(time)))), 1)
