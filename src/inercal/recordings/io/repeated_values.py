"""Runs of one exact value in a channel: readings at the end of their range, and readings stuck.

No amplitude is assumed. Quantised noise repeats values in runs whose lengths decrease smoothly; a
reading at its rail, or stuck, makes runs far longer than these. A coarsely quantised sensor at rest
repeats values too: where its steps exceed its noise, long runs are normal. Noise about the end of
the range is cut off there and makes no long runs: it piles up in the histogram.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array, true_ranges
from inercal.recordings import Indices
from inercal.recordings.io.column_table import row_blocks

_STANDS_OUT = 5  # times the longest ordinary run: a run is long
_RAIL = 5  # samples; fewer at an extreme are a peak
_STUCK = 50  # samples; fewer are an ordinary repetition
_STEEP = 5  # steps by which the samples beside a flat top differ from it
_MOVES = 5.0  # times: a channel's scatter in motion over that at rest
_FEW_STEPS, _HARDLY = 3.0, 0.02  # of the channel's step and range, within which it is at rest
_OFTEN = 0.2  # share of the time in which the other channels are still
_LEVELS = 10  # values; a resting sensor's noise may span fewer, and then its extreme repeats
# A channel is coarse where it spans at most _SPAN steps over _WINDOW samples, in the _QUIETEST
# share of windows, or where the share _GENTLE of long runs ends by a change of two steps at most.
_WINDOW, _SPAN, _QUIETEST, _GENTLE = 50, 2.0, 0.1, 0.8
# An extreme is judged with at least _PILE samples in _PILED_RUNS runs, of at most _MANY samples on
# average: a rest at one value is not noise. It cuts noise off where it has _PILED times the samples
# of each of the _NEXT steps below it, and its neighbours in time are over _BESIDE steps away.
_PILE, _PILED_RUNS, _MANY, _NEXT, _PILED, _BESIDE = 20, 10, 30, 5, 2, 1.5
_NONE: Indices = np.zeros((0, 2), np.int64)


class _Runs(NamedTuple):
    """Runs of two samples and more; a mask holds the single samples, which are most."""

    start: Indices
    length: Indices
    value: Array
    single: NDArray[np.bool_]


def _runs(x: Array) -> _Runs:
    new = np.ones(x.size + 1, np.bool_)  # where another value begins, the end included
    np.not_equal(x[1:], x[:-1], out=new[1:-1])
    start = np.flatnonzero(new[:-1] & ~new[1:])
    stop = np.flatnonzero(~new[:-1] & new[1:]) + 1
    return _Runs(start, stop - start, x[start], new[:-1] & new[1:])


def out_of_range(x: Array, lowest: float, highest: float) -> Indices:
    """Return half-open ranges, (k, 2), of samples at or beyond the ends of the range."""
    return true_ranges((x <= lowest) | (x >= highest))


def rail_ranges(x: Array) -> Indices:
    """Return half-open ranges, (k, 2), where a channel (n,) sits at its extreme reading.

    An extreme is a rail when its longest run has at least 5 samples and 5 times as many as the
    longest run at any value between the two extremes, or when a run of at least 5 begins and ends
    by a jump of 5 steps.
    """
    lowest, highest = x.min(), x.max()
    if not (_has_consecutive(x == lowest, _RAIL) or _has_consecutive(x == highest, _RAIL)):
        return _NONE
    between = (x != lowest) & (x != highest)
    if not between.any():
        return _NONE
    runs = _runs(x)
    longest = int(runs.length[between[runs.start]].max(initial=1))
    needed = max(_RAIL, _STANDS_OUT * longest)
    rails = [
        v
        for v in (lowest, highest)
        if runs.length[runs.value == v].max(initial=1) >= needed or _has_flat_top(x, runs, v)
    ]
    if not rails or _has_fewer_values(x, _LEVELS):
        return _NONE
    return true_ranges(np.logical_or.reduce([x == v for v in rails]))


def _has_flat_top(x: Array, runs: _Runs, extreme: float) -> bool:
    """Return whether a channel that changes fast stands still at its extreme.

    A smooth peak that stays within one step for five samples leaves it by a few steps at most.
    """
    at = np.flatnonzero((runs.value == extreme) & (runs.length >= _RAIL))
    start, stop = runs.start[at], runs.start[at] + runs.length[at]
    inner = (start > 0) & (stop < x.size)
    start, stop = start[inner], stop[inner]
    if not start.size:
        return False
    least = np.minimum(np.abs(x[start - 1] - extreme), np.abs(x[stop] - extreme))
    return bool((least >= _STEEP * _smallest_step(x)).any())


def railed_ranges(x: Array, others: Sequence[Array]) -> Indices:
    """Return half-open ranges, (k, 2), where a channel (n,) sits at the end of its range.

    `others`, (n,) each, are the channels that show when the sensor is at rest.
    """
    railed = rail_ranges(x)
    if not len(railed):
        return railed
    at = x[railed[:, 0]]
    resting = [v for v in np.unique(at).tolist() if is_resting_value(x, v, others)]
    return railed[~np.isin(at, resting)]


def is_resting_value(x: Array, value: float, others: Sequence[Array]) -> bool:
    """Return whether a channel reads a value because it is at rest, not at the end of its range.

    A coarse gyro that turns in one sense only, or not at all, reads its extreme in every rest. The
    sensor is at rest while the other channels are still and this one hardly changes. The value is
    that of rest if the channel spends half of this time within a few steps of it, and also a fair
    part of all the time during which the others are still.

    Parameters
    ----------
    x : (n,) array
    value : float
    others : sequence of (n,) arrays
        The other channels.
    """
    whole = x.size // _WINDOW * _WINDOW
    if not whole or not others:
        return False
    still = np.ones(whole // _WINDOW, np.bool_)
    for other in others:
        scatter = other[:whole].reshape(-1, _WINDOW).std(axis=1)
        quiet, moving = np.quantile(scatter, [_QUIETEST, 1 - _QUIETEST])
        if moving > _MOVES * quiet:
            floor = _smallest_step(other)
            still &= scatter <= max(float(np.sqrt(quiet * moving)), floor)
    windows = x[:whole].reshape(-1, _WINDOW)
    few = _FEW_STEPS * _smallest_step(x)
    at_rest = still & (np.ptp(windows, axis=1) <= max(few, _HARDLY * float(np.ptp(x))))
    near = np.abs(np.median(windows[at_rest], axis=1) - value) <= few
    count = int(near.sum())
    return 2 * count >= max(near.size, 1) and count >= _OFTEN * int(still.sum())


def clipping_values(x: Array) -> tuple[float, ...]:
    """Return the extremes at which a channel's noise is cut off.

    An extreme cuts noise off if it comes twice as often as any of the next five values and the
    samples beside it are two steps from it or more: noise of less than a step piles up at whatever
    value is nearest.
    """
    cut: list[float] = []
    step = 0.0
    for sign in (1.0, -1.0):
        top = sign * float((sign * x).max())
        at = x == top
        if np.count_nonzero(at) < _PILE:
            continue
        step = step or _smallest_step(x)
        begins = np.flatnonzero(at[1:] & ~at[:-1])
        ends = np.flatnonzero(at[:-1] & ~at[1:]) + 1
        beside = np.abs(np.concatenate([x[begins], x[ends]]) - top)
        few = begins.size < max(_PILED_RUNS, np.count_nonzero(at) / _MANY)
        if few or np.median(beside) <= _BESIDE * step:
            continue
        below = np.round(np.abs(x[np.abs(x - top) < (_NEXT + 0.5) * step] - top) / step)
        counts = np.bincount(below.astype(np.int64), minlength=_NEXT + 1)
        if counts[0] >= _PILED * counts[1:].max():
            cut.append(top)
    return tuple(cut)


def ranges_with_values(x: Array, ranges: Indices, values: tuple[float, ...]) -> Indices:
    """Return half-open ranges, (k, 2): `ranges`, and where a channel reads these values."""
    there = np.logical_or.reduce([x == value for value in values])
    for start, stop in ranges.tolist():
        there[start:stop] = True
    return true_ranges(there)


def longest_constant_run(x: Array) -> tuple[int, int] | None:
    """Return the run of one value that takes half of the samples or more, half open, if any."""
    middle = x.size // 2  # it lies in such a run
    other = x != x[middle]
    before, after = other[:middle][::-1], other[middle:]
    start = middle - int(before.argmax()) if before.any() else 0
    stop = middle + int(after.argmax()) if after.any() else x.size
    return (start, stop) if 2 * (stop - start) >= x.size else None


def _smallest_step(x: Array) -> float:
    """Return the smallest change between samples; infinite without any."""
    steps = np.abs(np.diff(x))
    return float(np.min(steps, initial=np.inf, where=steps > 0))


def _is_coarse(x: Array, held: Indices) -> bool:
    """Return whether the steps of a channel are so coarse that it holds values for long at rest.

    Parameters
    ----------
    x : (n,) array
    held : (k, 2) array
        Its long runs, which are excluded.
    """
    few = _SPAN * _smallest_step(x) * (1 + 1e-6)
    inside = np.zeros(x.size + 1, np.int8)
    np.add.at(inside, held[:, 0], 1)
    np.add.at(inside, held[:, 1], -1)
    apart = np.cumsum(inside[:-1], dtype=np.int8) == 0
    whole = x.size // _WINDOW * _WINDOW
    windows = x[:whole].reshape(-1, _WINDOW)[apart[:whole].reshape(-1, _WINDOW).all(axis=1)]
    if len(windows) and float(np.quantile(np.ptp(windows, axis=1), _QUIETEST)) <= few:
        return True
    first, last = held[held[:, 0] > 0, 0], held[held[:, 1] < x.size, 1]
    moved = np.concatenate([np.abs(x[first] - x[first - 1]), np.abs(x[last] - x[last - 1])])
    return len(held) > 2 and float(np.mean(moved <= few)) >= _GENTLE


def _has_consecutive(mask: NDArray[np.bool_], count: int) -> bool:
    """Return whether `count` neighbours are True; most recordings are decided after few steps."""
    width = 1
    while width < count and mask.size:
        more = min(width, count - width)
        mask = mask[:-more] & mask[more:]
        width += more
    return bool(mask.any())


def _has_fewer_values(x: Array, levels: int) -> bool:
    """Return whether there are fewer different values than `levels`."""
    found = x[:0]
    for k in row_blocks(x.size):
        found = np.unique(np.concatenate([found, x[k]]))
        if found.size >= levels:
            return False
    return True


def stuck_ranges(x: Array, known: Indices) -> Indices:
    """Return half-open ranges, (k, 2), where a channel (n,) holds one value for far too long.

    The sorted lengths of runs are split at the first fivefold jump to 50 samples or more. Runs
    above the jump are accepted where they hold most of the samples, or where the steps of the
    channel exceed its noise: such a channel reads in long runs.

    Parameters
    ----------
    x : (n,) array
        Readings.
    known : (k, 2) array
        Ranges to leave out: those at the rails.
    """
    if not _has_consecutive(x[1:] == x[:-1], _STUCK - 1):
        return _NONE
    runs = _runs(x)
    change = np.zeros(x.size + 1, np.int8)
    change[known[:, 0]], change[known[:, 1]] = 1, -1
    free = np.cumsum(change[:-1], dtype=np.int8) == 0
    ordinary = free[runs.start]
    lengths = np.unique(runs.length[ordinary])
    if (runs.single & free).any():
        lengths = np.concatenate([[1], lengths])
    jump = np.flatnonzero((lengths[1:] >= _STANDS_OUT * lengths[:-1]) & (lengths[1:] >= _STUCK))
    if not jump.size:
        return _NONE
    held = (runs.length >= lengths[jump[0] + 1]) & ordinary
    if 2 * runs.length[held].sum() >= x.size:
        return _NONE
    found = np.stack([runs.start[held], runs.start[held] + runs.length[held]], axis=-1)
    return _NONE if _is_coarse(x, found) else found


def merge_ranges(ranges: Indices, apart: float) -> list[tuple[int, int]]:
    """Return ranges, joined where less than `apart` samples lie between them."""
    if not ranges.size:
        return []
    new = np.concatenate([[True], ranges[1:, 0] - ranges[:-1, 1] >= apart])
    last = np.concatenate([new[1:], [True]])
    return list(zip(ranges[new, 0].tolist(), ranges[last, 1].tolist(), strict=True))
