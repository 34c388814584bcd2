"""Compiled: variances over a sliding window, in time that does not depend on the window's length.

The variance of a window is (Σd² − (Σd)²/w)/w with d the reading less a reference. The sums slide:
one sample enters and one leaves. After each block of windows they are computed again with a new
reference, so that neither a large offset nor an earlier shock costs digits. A window is counted by
its first sample. A sample has the window of `window` samples centred on it or, next to the ends of
its segment, the last window that fits.

The variances of a kind of axis are summed with weights, and exist for one block at a time. Arrays
are allocated by the functions that call the kernels: allocations take long to compile.
"""
# Numba's decorator has no types.
# pyright: reportUntypedFunctionDecorator=false

from math import log

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array, Indices
from inercal.estimation.kernel_options import njit

_BLOCK = 64  # windows at least that share a reference
_SAME = 4.0  # a variance within this ratio of an earlier variance is unchanged


@njit(cache=True, nogil=True)
def _window_variances(
    data: Array, columns: Indices, weight: Array, first: int, count: int, window: int, out: Array
) -> None:
    """Write the summed variances of the windows that begin at samples `first` + 0 … count − 1."""
    for k in range(count):
        out[k] = 0.0
    for c in range(columns.size):
        j = columns[c]
        reference = data[first, j]
        total, square = 0.0, 0.0
        for i in range(first, first + window):
            d = data[i, j] - reference
            total += d
            square += d * d
        each = weight[c] / window
        out[0] += each * max(square - total * total / window, 0.0)
        for k in range(1, count):
            old = data[first + k - 1, j] - reference
            new = data[first + k - 1 + window, j] - reference
            total += new - old
            square += new * new - old * old
            out[k] += each * max(square - total * total / window, 0.0)


def window_variances(
    data: Array, columns: Indices, weight: Array, segments: Indices, window: int
) -> Array:
    """Return the variance of each sample's window, (n,); a short segment is a single window.

    Parameters
    ----------
    data : (n, m) array
        Output units.
    columns, weight : (k,) arrays
        The variances of these columns are summed with these weights.
    segments : (s, 2) array of int
        Samples start to stop, half open, between gaps; together all samples.
    window : int
        Samples.
    """
    out = np.empty(data.shape[0])
    _write_variances(data, columns, weight, segments, window, _block(window), out)
    return out


def _block(window: int) -> Array:
    return np.empty(max(window, _BLOCK))


@njit(cache=True, nogil=True)
def _write_variances(
    data: Array,
    columns: Indices,
    weight: Array,
    segments: Indices,
    window: int,
    block: Array,
    out: Array,
) -> None:
    for s in range(segments.shape[0]):
        start, stop = segments[s, 0], segments[s, 1]
        fits = min(window, stop - start)
        half, count = fits // 2, stop - start - fits + 1
        for first in range(0, count, block.size):
            size = min(block.size, count - first)
            _window_variances(data, columns, weight, start + first, size, fits, block)
            # Element by element, here and below: assigning a slice takes twice as long to compile.
            for k in range(size):
                out[start + first + half + k] = block[k]
        for k in range(start, start + half):
            out[k] = out[start + half]
        for k in range(start + half + count, stop):
            out[k] = out[start + half + count - 1]


def variance_extent(
    data: Array, columns: Indices, weight: Array, segments: Indices, window: int
) -> tuple[float, Array, Indices]:
    """Return the largest variance, and each column's smallest step and number of steps.

    Parameters are those of `window_variances`; steps are between neighbouring samples, and not
    zero.
    """
    step, changes = np.full(columns.size, np.inf), np.zeros(columns.size, np.int64)
    top = _largest_variance(data, columns, weight, segments, window, _block(window), step, changes)
    return top, step, changes


@njit(cache=True, nogil=True)
def _largest_variance(
    data: Array,
    columns: Indices,
    weight: Array,
    segments: Indices,
    window: int,
    block: Array,
    step: Array,
    changes: Indices,
) -> float:
    top = 0.0
    for s in range(segments.shape[0]):
        start, stop = segments[s, 0], segments[s, 1]
        for first in range(start, stop - window + 1, block.size):
            size = min(block.size, stop - window + 1 - first)
            _window_variances(data, columns, weight, first, size, window, block)
            for k in range(size):
                top = max(top, block[k])
        for c in range(columns.size):
            for i in range(start + 1, stop):
                d = abs(data[i, columns[c]] - data[i - 1, columns[c]])
                if d > 0.0:
                    changes[c] += 1
                    step[c] = min(step[c], d)
    return top


def variance_histogram(
    data: Array,
    columns: Indices,
    weight: Array,
    segments: Indices,
    window: int,
    lowest: float,
    top: float,
    stay: int,
    bins: int,
) -> tuple[Indices, Indices]:
    """Return the number of windows in each bin of variance, evenly spaced in its logarithm.

    The first counts leave out unchanged variances, the second count all windows.

    Parameters
    ----------
    data, columns, weight, segments, window
        As of `window_variances`.
    lowest, top : float
        Edges of the first and the last bin; smaller variances count as `lowest`.
    stay : int
        Where the variance stays within a ratio of 4, the first counts take this many windows.
    bins : int
    """
    counts, every = np.zeros(bins, np.int64), np.zeros(bins, np.int64)
    _count_windows(
        data, columns, weight, segments, window, _block(window), lowest,
        bins / log(top / lowest), stay, counts, every,
    )  # fmt: skip
    return counts, every


@njit(cache=True, nogil=True)
def _count_windows(
    data: Array,
    columns: Indices,
    weight: Array,
    segments: Indices,
    window: int,
    block: Array,
    lowest: float,
    per_log: float,
    stay: int,
    counts: Indices,
    every: Indices,
) -> None:
    bins = counts.size
    for s in range(segments.shape[0]):
        start, stop = segments[s, 0], segments[s, 1]
        anchor, stayed = 0.0, 0
        for first in range(start, stop - window + 1, block.size):
            size = min(block.size, stop - window + 1 - first)
            _window_variances(data, columns, weight, first, size, window, block)
            for k in range(size):
                v = max(block[k], lowest)
                if v > _SAME * anchor or v * _SAME < anchor:
                    anchor, stayed = v, 0
                stayed += 1
                place = min(int(per_log * np.log(v / lowest)), bins - 1)
                every[place] += 1
                if stayed <= stay:
                    counts[place] += 1


def rest_runs(
    data: Array,
    columns: Indices,
    weight: Array,
    ends: Indices,
    limit: Array,
    segments: Indices,
    window: int,
    shortest: int,
) -> Indices:
    """Return the runs of samples at which every kind's variance is below its limit, (r, 2).

    Parameters
    ----------
    data, columns, weight, segments, window
        As of `window_variances`, with the columns kind by kind.
    ends : (kinds,) array of int
        End of each kind's columns in `columns`.
    limit : (kinds,) array
        Limit of the summed variance.
    shortest : int
        Samples; shorter runs are left out.
    """
    block = _block(window)
    # Runs are apart, and not shorter than the shortest.
    length = segments[:, 1] - segments[:, 0]
    found = np.empty((int((length // max(shortest, 1) + 1).sum()), 2), np.int64)
    first = np.concatenate([[0], ends[:-1]])
    quiet = np.empty(block.size, np.bool_)
    count = _write_runs(
        data, columns, weight, first, ends, limit, segments, window, shortest, block, quiet, found
    )
    return found[:count].copy()


@njit(cache=True, nogil=True)
def _write_runs(
    data: Array,
    columns: Indices,
    weight: Array,
    begins: Indices,
    ends: Indices,
    limit: Array,
    segments: Indices,
    window: int,
    shortest: int,
    block: Array,
    quiet: NDArray[np.bool_],
    found: Indices,
) -> int:
    count, half = 0, window // 2
    for s in range(segments.shape[0]):
        start, stop = segments[s, 0], segments[s, 1]
        last = stop - window  # the first sample of the last window
        begin = -1
        for first in range(start, last + 1, block.size):
            size = min(block.size, last + 1 - first)
            for k in range(size):
                quiet[k] = True
            for kind in range(ends.size):
                these = slice(begins[kind], ends[kind])
                _window_variances(data, columns[these], weight[these], first, size, window, block)
                for k in range(size):
                    quiet[k] &= block[k] < limit[kind]
            for k in range(size):
                if quiet[k] and begin < 0:
                    begin = start if first + k == start else first + k + half
                at_end = first + k == last
                if begin >= 0 and (at_end or not quiet[k]):
                    end = stop if at_end and quiet[k] else first + k + half
                    if end - begin >= shortest:
                        found[count, 0], found[count, 1] = begin, end
                        count += 1
                    begin = -1
    return count
