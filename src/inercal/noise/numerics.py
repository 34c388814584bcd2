"""Wrap the SciPy functions that the estimators use; SciPy is only imported when needed.

SciPy has no stubs, and importing its parts takes up to a second.

Sum squared second differences, which take most of the time of an Allan deviation.

These functions read the cumulative sum only once, whereas NumPy reads it once for each operation.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.estimation.kernel_options import njit


def dct2(values: Array, axis: int = -1) -> Array:
    """Return the orthonormal DCT-II of real values along an axis."""
    from scipy.fft import dct

    return np.asarray(dct(values, norm="ortho", axis=axis), dtype=np.float64)


def cosine_sums(values: Array) -> Array:
    """Return Σ_h values[h] cos(π k h/n), h = 1 … n−1, for k = 1 … n−1; values, (n+1,), end in 0."""
    from scipy.fft import dct

    return np.asarray(dct(values, type=1), dtype=np.float64)[1:-1] / 2


def sine_sums(values: Array) -> Array:
    """Return Σ_h values[h−1] sin(π k h/n), h = 1 … n−1, for k = 1 … n−1; values, (n−1,)."""
    from scipy.fft import dst

    if values.size == 1:
        return values.copy()
    return np.asarray(dst(values, type=1), dtype=np.float64) / 2


def nonnegative_least_squares(a: Array, b: Array) -> Array:
    """Return x ≥ 0 that minimises |a x − b|; the columns are scaled to improve the accuracy."""
    from scipy.optimize import nnls

    size = np.maximum(np.linalg.norm(a, axis=0), 1e-300)
    return np.asarray(nnls(a / size, b)[0], dtype=np.float64) / size


def root_between(function: Callable[[float], float], low: float, high: float, xtol: float) -> float:
    """Return a zero of a function that changes sign between two points."""
    from scipy.optimize import brentq

    return float(brentq(function, low, high, xtol=xtol, rtol=1e-4))  # pyright: ignore


def chi_squared_above(dof: float, probability: float) -> float:
    """Return the value that χ² with `dof` degrees of freedom exceeds with a given probability.

    >>> round(chi_squared_above(1, 0.05), 3)
    3.841
    """
    from scipy.special import chdtri

    return float(chdtri(dof, probability))


def chi_squared_quantiles(dof: Array, probability: float) -> Array:
    """Return the values that χ² exceeds with a given probability, for each `dof`."""
    from scipy.special import chdtri

    return np.asarray(chdtri(dof, probability), dtype=np.float64)


def pseudo_inverse(a: Array, rcond: float = 1e-12) -> Array:
    """Return the pseudo-inverse of a symmetric matrix, computed with a unit diagonal."""
    size = np.sqrt(np.diag(a))
    size = np.where(size > 0, size, 1.0)
    inverse = np.linalg.pinv(a / np.outer(size, size), rcond=rcond)
    return np.asarray(inverse / np.outer(size, size), dtype=np.float64)


def normal_deviate(dof: Array, chi2: Array) -> Array:
    """Return standard normal deviates with the same tail probability as χ² for each `dof`.

    >>> normal_deviate(np.array([1.0]), np.array([3.8414588])).round(3)
    array([1.645])
    """
    from scipy.special import chdtr, chdtrc, ndtri

    # Use the smaller tail, which retains its precision.
    below, above = np.asarray(chdtr(dof, chi2)), np.asarray(chdtrc(dof, chi2))
    smallest = np.finfo(float).tiny
    low, high = (ndtri(np.maximum(one, smallest)) for one in (below, above))
    return np.asarray(np.where(below < 0.5, low, -high), dtype=np.float64)  # pyright: ignore


_BLOCK = 4096  # differences per block for all factors; a block stays in the cache


@njit(cache=True, nogil=True, fastmath=True)
def squared_second_differences(
    x: Array,
    factors: NDArray[np.int64],
    strides: NDArray[np.int64],
    firsts: NDArray[np.int64],
) -> Array:
    """Return Σ (x[i+2m] − 2 x[i+m] + x[i])² over i for each factor m, (k,).

    Parameters
    ----------
    x : (n,) array
    factors, strides : (k,) array of int
    firsts : (k,) array of int
        First value of i, a multiple of the stride. The stride is then added repeatedly.
    """
    out = np.zeros(factors.size)
    for begin in range(0, x.size, _BLOCK):
        for j in range(factors.size):
            m, stride = factors[j], strides[j]
            end = min(begin + _BLOCK, x.size - 2 * m)
            total = 0.0
            start = max(begin, firsts[j])
            if stride == 1:
                if end > start:
                    # The compiler vectorizes slices with a known step.
                    early, middle, late = x[start:end], x[start + m : end + m], x[start + 2 * m :]
                    for i in range(early.size):
                        d = late[i] - 2.0 * middle[i] + early[i]
                        total += d * d
            else:
                for i in range((start + stride - 1) // stride * stride, end, stride):
                    d = x[i + 2 * m] - 2.0 * x[i + m] + x[i]
                    total += d * d
            out[j] += total
    return out
