"""Find runs of exactly equal readings in a channel, which is then saturated or stuck.

No amplitude is assumed. Quantised noise repeats values in runs whose lengths decrease smoothly. A
saturated or stuck channel has much longer runs. A coarsely quantised sensor at rest also repeats
values: long runs are normal if its steps exceed its noise. Noise around the end of the range is cut
off there. It causes no long runs, but one value of the histogram becomes much more frequent.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Bools, true_ranges
from inercal.recordings import Indices
from inercal.recordings.io.column_table import row_blocks

_STANDS_OUT = 5  # a run is long if it has this many times the length of the longest ordinary run
_RAIL = 5  # samples; fewer at an extreme are a peak
_STUCK = 50  # samples; fewer are an ordinary repetition
_STEEP = 5  # steps by which the samples next to a flat top differ from it
_MOVES = 5.0  # smallest ratio of a channel's scatter in motion to that at rest
_FEW_STEPS, _HARDLY = 3.0, 0.02  # of the channel's step and range; a smaller range counts as rest
_OFTEN = 0.2  # share of the time in which the other channels are still
_LEVELS = 10  # values; the noise of a resting sensor may span fewer, so its extreme repeats
# A channel is coarse if it spans at most _SPAN steps over _WINDOW samples in the _QUIETEST share of
# windows, or if the share _GENTLE of long runs ends with a change of at most two steps.
_WINDOW, _SPAN, _QUIETEST, _GENTLE = 50, 2.0, 0.1, 0.8
# An extreme is examined if it has at least _PILE samples in _PILED_RUNS runs, with at most _MANY
# samples on average, because a rest at one value is not noise. It cuts noise off if it has _PILED
# times the samples of each of the _NEXT steps below it, and if its neighbours in time are more than
# _BESIDE steps away. It also does if noise of at least _LEAST_NOISE steps would give _BEYOND
# samples one step further.
_PILE, _PILED_RUNS, _MANY, _NEXT, _PILED, _BESIDE = 20, 10, 30, 5, 2, 1.5
_BEYOND, _LEAST_NOISE = 30.0, 0.7
_NONE: Indices = np.zeros((0, 2), np.int64)


class _Runs(NamedTuple):
    """Runs of at least two samples, and a mask of the single samples, which are the majority."""

    start: Indices
    length: Indices
    value: Array
    single: Bools


def _runs(x: Array) -> _Runs:
    new = np.ones(x.size + 1, np.bool_)  # where a new value begins, including the end
    np.not_equal(x[1:], x[:-1], out=new[1:-1])
    start = np.flatnonzero(new[:-1] & ~new[1:])
    stop = np.flatnonzero(~new[:-1] & new[1:]) + 1
    return _Runs(start, stop - start, x[start], new[:-1] & new[1:])


def out_of_range(x: Array, lowest: float, highest: float) -> Indices:
    """Return half-open ranges, (k, 2), of samples at or beyond the ends of the range."""
    return true_ranges((x <= lowest) | (x >= highest))


def rail_ranges(x: Array) -> Indices:
    """Return half-open ranges, (k, 2), in which a channel (n,) stays at its extreme reading.

    An extreme is a rail in two cases. In the first, its longest run has at least 5 samples and is
    at least 5 times as long as the longest run at any value between the extremes. In the second, a
    run of at least 5 samples begins and ends with a jump of 5 steps.
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
    """Return whether a fast-changing channel stays constant at its extreme.

    A smooth peak that stays within one step for five samples leaves it by only a few steps.
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
    """Return half-open ranges, (k, 2), in which a channel (n,) stays at the end of its range.

    `others`, (n,) each, are the channels that show when the sensor is at rest.
    """
    railed = rail_ranges(x)
    if not len(railed):
        return railed
    at = x[railed[:, 0]]
    resting = [v for v in np.unique(at).tolist() if is_resting_value(x, v, others)]
    return railed[~np.isin(at, resting)]


def is_resting_value(x: Array, value: float, others: Sequence[Array]) -> bool:
    """Return whether a channel repeats a value because it is at rest, not because it is saturated.

    A coarse gyro that turns in only one direction, or not at all, reads its extreme in every rest.
    The sensor is at rest while the other channels are still and this one hardly changes. The value
    is the resting value if the channel is within a few steps of it for half of this time, and also
    for a fair share of the time during which the others are still.

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

    An extreme cuts noise off if it occurs twice as often as any of the next five values and the
    neighbouring samples are at least two steps away. The second condition is needed because noise
    smaller than a step accumulates at the nearest value.

    An extreme at one end also cuts noise off if its count n₀ is too large for an end. Normal noise
    of σ steps around any slow motion has at least n₀²/n₁ exp(−1/σ²) samples one step further, where
    n₁ is the count one step nearer: the logarithm of its density has no second derivative below
    −1/σ². Both ends of a vibration have large counts, so this test needs a single such end.
    """
    cut: list[float] = []
    excessive: list[float] = []
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
        if begins.size < max(_PILED_RUNS, np.count_nonzero(at) / _MANY):
            continue
        below = np.round(np.abs(x[np.abs(x - top) < (_NEXT + 0.5) * step] - top) / step)
        counts = np.bincount(below.astype(np.int64), minlength=_NEXT + 1)
        if counts[0] >= _PILED * counts[1:].max() and np.median(beside) > _BESIDE * step:
            cut.append(top)
        elif counts[1] and (noise := _noise_near(x, at)) > _LEAST_NOISE * step:
            beyond = counts[0] ** 2 / counts[1] * np.exp(-((step / noise) ** 2))
            excessive += [top] * bool(beyond >= _BEYOND)
    return tuple(cut) or tuple(excessive if len(excessive) == 1 else ())


def _noise_near(x: Array, at: Bools) -> float:
    """Return a low estimate of the noise in the windows with marked samples; 0 without windows."""
    whole = x.size // _WINDOW * _WINDOW
    windows = x[:whole].reshape(-1, _WINDOW)[at[:whole].reshape(-1, _WINDOW).any(axis=1)]
    if not len(windows):
        return 0.0
    squares = np.mean(np.diff(windows, axis=1) ** 2, axis=1) / 2
    return float(np.sqrt(np.quantile(squares, _QUIETEST)))


def ranges_with_values(x: Array, ranges: Indices, values: tuple[float, ...]) -> Indices:
    """Return half-open ranges, (k, 2): `ranges`, plus those where a channel reads these values."""
    there = np.logical_or.reduce([x == value for value in values])
    for start, stop in ranges.tolist():
        there[start:stop] = True
    return true_ranges(there)


def longest_constant_run(x: Array) -> tuple[int, int] | None:
    """Return the half-open run of one value that covers at least half of the samples, if any."""
    middle = x.size // 2  # such a run contains the middle sample
    other = x != x[middle]
    before, after = other[:middle][::-1], other[middle:]
    start = middle - int(before.argmax()) if before.any() else 0
    stop = middle + int(after.argmax()) if after.any() else x.size
    return (start, stop) if 2 * (stop - start) >= x.size else None


def _smallest_step(x: Array) -> float:
    """Return the smallest change between samples; infinite if there is none."""
    steps = np.abs(np.diff(x))
    return float(np.min(steps, initial=np.inf, where=steps > 0))


def _is_coarse(x: Array, held: Indices) -> bool:
    """Return whether a channel's steps are so coarse that its value stays constant at rest.

    Parameters
    ----------
    x : (n,) array
    held : (k, 2) array
        The channel's long runs, which are excluded.
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


def _has_consecutive(mask: Bools, count: int) -> bool:
    """Return whether `count` neighbours are True; few steps are usually enough to decide."""
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
    """Return half-open ranges, (k, 2), in which a channel (n,) keeps one value for far too long.

    The sorted run lengths are split at the first fivefold jump to at least 50 samples. Runs above
    the jump are accepted as normal if they contain most of the samples. They are also accepted if
    the steps of the channel exceed its noise, because such a channel has long runs.

    Parameters
    ----------
    x : (n,) array
        Readings of the channel.
    known : (k, 2) array
        Ranges to exclude, namely those at the rails.
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
    """Merge ranges that are separated by less than `apart` samples."""
    if not ranges.size:
        return []
    new = np.concatenate([[True], ranges[1:, 0] - ranges[:-1, 1] >= apart])
    last = np.concatenate([new[1:], [True]])
    return list(zip(ranges[new, 0].tolist(), ranges[last, 1].tolist(), strict=True))
