"""Compute sliding-window variances; the time per sample does not depend on the window length.

The variance of a window is (Σd² − (Σd)²/w)/w, where d is the reading minus a reference. The sums
are updated as one sample enters the window and one leaves it. After each block of windows they are
computed again with a new reference, so that neither a large offset nor an earlier shock reduces
their precision. A window is numbered by its first sample. Each sample uses the window of `window`
samples that is centred on it; near the ends of a segment it uses the last window that fits.

The variances of one kind of axis are summed with weights, and only one block of them is stored at a
time. The functions that call the kernels allocate the arrays, because allocations inside a kernel
take long to compile.
"""
# Numba's decorator has no types.
# pyright: reportUntypedFunctionDecorator=false

from math import log

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array, Indices
from inercal.estimation.kernel_options import njit

_BLOCK = 64  # smallest number of windows that share a reference
_SAME = 4.0  # a variance counts as unchanged if it is within this ratio of an earlier variance


@njit(cache=True, nogil=True)
def _window_variances(
    data: Array, columns: Indices, weight: Array, first: int, count: int, window: int, out: Array
) -> None:
    """Write the summed variances of the windows starting at samples `first` + 0 … count − 1."""
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
    """Return the variance in each sample's window, (n,); a short segment is a single window.

    Parameters
    ----------
    data : (n, m) array
        Readings in output units.
    columns, weight : (k,) arrays
        Columns whose variances are summed, and their weights.
    segments : (s, 2) array of int
        Ranges of samples between gaps, start to stop (half open); together they cover all samples.
    window : int
        Window length in samples.
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
            # Copy element by element, here and below: slice assignment takes twice as long to
            # compile.
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

    The parameters are those of `window_variances`. Steps are nonzero differences between
    neighbouring samples.
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

    The first array of counts omits most windows with unchanged variance; the second counts all
    windows.

    Parameters
    ----------
    data, columns, weight, segments, window
        As in `window_variances`.
    lowest, top : float
        Lower edge of the first bin and upper edge of the last bin; smaller variances count as
        `lowest`.
    stay : int
        While the variance stays within a ratio of 4, the first array counts only this many windows.
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
    """Return the runs of samples in which every kind's variance is below its limit, (r, 2).

    Parameters
    ----------
    data, columns, weight, segments, window
        As in `window_variances`; the columns are ordered by kind.
    ends : (kinds,) array of int
        End of each kind's columns in `columns`.
    limit : (kinds,) array
        Limit of the summed variance for each kind.
    shortest : int
        Shortest length of a run in samples; shorter runs are omitted.
    """
    block = _block(window)
    # Runs do not touch each other, and none is shorter than the shortest length.
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
