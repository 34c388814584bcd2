"""Wrap the SciPy functions that the estimators use; SciPy is only imported when needed.

SciPy has no stubs, and importing its parts takes up to a second.
"""
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false

from collections.abc import Callable

import numpy as np

from inercal.basics.arrays import Array


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


def pseudo_inverse(a: Array) -> Array:
    """Return the pseudo-inverse of a symmetric matrix, computed with a unit diagonal."""
    size = np.sqrt(np.diag(a))
    size = np.where(size > 0, size, 1.0)
    inverse = np.linalg.pinv(a / np.outer(size, size), rcond=1e-12)
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
