"""Hadamard total and modified total variance (Howe and Vernotte; NIST SP 1065, 5.2.11 to 5.2.14).

Each of the subsequences that three averaging times span has its trend removed, is reflected at both
ends to three times its length, and is averaged; these are estimators without bias correction.
"""

import numpy as np

from inercal.arrays import Array

_MOST = 1 << 22  # numbers in one block of subsequences


def total_hadamard_variance(y: Array, m: int) -> tuple[float, int]:
    """Return the Hadamard total variance of y, (n,), at factor m, and its number of subsequences.

    At m = 1 it is the overlapping Hadamard variance, as SP 1065 defines it.
    """
    if m == 1:
        d = y[2:] - 2 * y[1:-1] + y[:-2]
        return float(d @ d) / (6 * d.size), d.size
    total, count = _squares_of_subsequences(y, m)
    return total / (6 * count), count


def total_modified_variance(x: Array, m: int) -> tuple[float, int]:
    """Return the modified total variance of phases x, (n + 1,), and its number of subsequences."""
    total, count = _squares_of_subsequences(x, m)
    return total / (2 * float(m) ** 2 * count), count


def _squares_of_subsequences(series: Array, m: int) -> tuple[float, int]:
    """Return the sum over all subsequences of 3 m values, and their number.

    Of each it is the mean square of the second differences of means of m values.
    """
    length = 3 * m
    half, middle = divmod(length, 2)
    lags = (np.arange(length) - (length - 1) / 2) / (half + middle)
    windows = np.lib.stride_tricks.sliding_window_view(series, length)
    total = 0.0
    for part in _blocks(windows, 9 * m):
        slope = part[:, half + middle :].mean(axis=1) - part[:, :half].mean(axis=1)
        flat = part - slope[:, None] * lags
        extended = np.concatenate([flat[:, ::-1], flat, flat[:, ::-1]], axis=1)
        sums = _sums_of(extended)
        means = (sums[:, m:] - sums[:, :-m]) / m
        d = means[:, 2 * m :] - 2 * means[:, m:-m] + means[:, : -2 * m]
        total += float((d[:, : 6 * m] ** 2).mean(axis=1).sum())
    return total, len(windows)


def _sums_of(values: Array) -> Array:
    """Return cumulative sums along rows, with a leading zero."""
    return np.concatenate([np.zeros((len(values), 1)), np.cumsum(values, axis=1)], axis=1)


def _blocks(windows: Array, width: int):
    step = max(1, _MOST // width)
    for start in range(0, len(windows), step):
        yield windows[start : start + step]
