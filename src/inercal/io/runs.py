"""Runs of one exact value in a channel: readings at the end of their range, and readings stuck.

No amplitude is assumed. Quantised noise repeats values in runs whose lengths fall off smoothly; a
reading at its rail or stuck stands far above the longest of them. A coarsely quantised sensor at
rest repeats values everywhere, so none of its runs stands out.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from inercal.io.table import blocks
from inercal.recording import Array, Indices

_STANDS_OUT = 5  # times the longest of the ordinary runs
_RAIL = 5  # samples; fewer at an extreme are a peak
_STUCK = 50  # samples; fewer are an ordinary repetition
_LEVELS = 10  # values; a resting sensor's noise may span fewer, and then its top one repeats
_NONE: Indices = np.zeros((0, 2), np.int64)


class _Runs(NamedTuple):
    """Runs of two samples and more; singles, nearly all of an unquantised reading, are a mask."""

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


def beyond(x: Array, lowest: float, highest: float) -> Indices:
    """Return half-open ranges, (k, 2), of samples at or beyond the ends of the range."""
    return _ranges((x <= lowest) | (x >= highest))


def at_rails(x: Array) -> Indices:
    """Return half-open ranges, (k, 2), where a channel (n,) sits at its extreme reading.

    An extreme is a rail when its longest run has at least 5 samples and 5 times as many as the
    longest run at any value between the two extremes.
    """
    lowest, highest = x.min(), x.max()
    if not (_in_a_row(x == lowest, _RAIL) or _in_a_row(x == highest, _RAIL)):
        return _NONE
    between = (x != lowest) & (x != highest)
    if not between.any():
        return _NONE
    runs = _runs(x)
    longest = int(runs.length[between[runs.start]].max(initial=1))
    needed = max(_RAIL, _STANDS_OUT * longest)
    extremes = (lowest, highest)
    rails = [v for v in extremes if runs.length[runs.value == v].max(initial=1) >= needed]
    if not rails or _fewer_values(x, _LEVELS):
        return _NONE
    return _ranges(np.logical_or.reduce([x == v for v in rails]))


def _in_a_row(mask: NDArray[np.bool_], count: int) -> bool:
    """Return whether so many neighbours are True: in most recordings none, which is told soon."""
    width = 1
    while width < count and mask.size:
        more = min(width, count - width)
        mask = mask[:-more] & mask[more:]
        width += more
    return bool(mask.any())


def _fewer_values(x: Array, levels: int) -> bool:
    """Return whether there are fewer different values than so many levels."""
    found = x[:0]
    for k in blocks(x.size):
        found = np.unique(np.concatenate([found, x[k]]))
        if found.size >= levels:
            return False
    return True


def stuck(x: Array, known: Indices) -> Indices:
    """Return half-open ranges, (k, 2), where a channel (n,) holds one value for far too long.

    Lengths of runs, sorted, are taken apart at the first fivefold jump to 50 samples or more.
    Runs above the jump that hold most of the samples are how this channel reads, and are let pass.

    Parameters
    ----------
    x : (n,) array
        Readings.
    known : (k, 2) array
        Ranges to leave out: those at the rails.
    """
    if not _in_a_row(x[1:] == x[:-1], _STUCK - 1):
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
    return np.stack([runs.start[held], runs.start[held] + runs.length[held]], axis=-1)


def joined(ranges: Indices, apart: float) -> list[tuple[int, int]]:
    """Return ranges with those less than `apart` samples from each other made one."""
    if not ranges.size:
        return []
    new = np.concatenate([[True], ranges[1:, 0] - ranges[:-1, 1] >= apart])
    last = np.concatenate([new[1:], [True]])
    return list(zip(ranges[new, 0].tolist(), ranges[last, 1].tolist(), strict=True))


def _ranges(mask: NDArray[np.bool_]) -> Indices:
    """Return half-open ranges of True, (k, 2)."""
    edges = np.flatnonzero(np.diff(mask, prepend=False, append=False))
    return edges.reshape(-1, 2)
