"""Which rows of a table differ from the others, with limits that hold at the number of rows.

A row x is judged by the m rows nearer to the centre, with their mean and covariance S::

    T² = m/(m + 1) (x − mean)ᵀ S⁻¹ (x − mean),   T² (m − p)/(p (m − 1)) ~ F(p, m − p)

for normal rows (Hotelling). x is the farthest of m + 1 rows, so its tail probability counts m + 1
times. Rows are taken in by their distance, and from the first that is beyond the limit all are
outliers: the sequential test of Rosner (1983, Technometrics 25, 165–172), by all columns together
as by Caroni and Prescott (1992, Applied Statistics 41, 355–364). A quarter of the rows can be
outliers, and cannot hide one another because none of them is within the first three quarters.

Each column is tested alone too: all columns together find a row against the correlation, and a
single column finds one coefficient among many with fewer rows.
"""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false

import numpy as np
import scipy
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.estimation.uncertainty.robust import RIDGE, ROWS_A_COLUMN

NAMED_BY_CHANCE = 0.05
"""Expected number of rows that are called outliers where there is none."""
_LEVEL = 0.9 * NAMED_BY_CHANCE  # the tests of a sequence add a tenth
_TOGETHER = 0.2  # of it, for all columns together
_SHARE = 0.25  # of the rows, that can be outliers
LEAST_ROWS = 10


def find_outliers(values: Array, distances: Array) -> NDArray[np.intp]:
    """Return the places of the outliers, the farthest first.

    Parameters
    ----------
    values : (n, p) array
        None are found in fewer than `LEAST_ROWS` rows. A column without scatter is ignored.
    distances : (n,) array
        Robust squared distances, as of `inercal.estimation.uncertainty.robust.squared_distances`.
    """
    used = values[:, np.median(np.abs(values - np.median(values, axis=0)), axis=0) > 0]
    n, p = used.shape
    if n < LEAST_ROWS or p == 0:
        return np.zeros(0, dtype=np.intp)
    together = p > 1 and n >= ROWS_A_COLUMN * p
    alone = _LEVEL * (1 - _TOGETHER if together else 1)
    named = _outliers_of_columns(used, alone / p)
    if together:
        named[_joint_outliers(used, distances, _LEVEL * _TOGETHER)] = True
    found = np.flatnonzero(named)
    return found[np.argsort(-distances[found], kind="stable")]


def _outliers_of_columns(values: Array, level: float) -> NDArray[np.bool_]:
    """Return which rows are outliers of some column, (n,)."""
    n = len(values)
    order = np.argsort(np.abs(values - np.median(values, axis=0)), axis=0)
    # Sums of the nearest 1, 2, … rows; about the median, they lose no digits.
    centred = np.take_along_axis(values - np.median(values, axis=0), order, axis=0)
    first = n - int(_SHARE * n)
    inside = np.arange(first, n)[:, None]
    total = np.cumsum(centred, axis=0)[first - 1 : -1]
    squares = np.cumsum(centred**2, axis=0)[first - 1 : -1]
    mean = total / inside
    variance = (squares - inside * mean**2) / (inside - 1)
    squared = (centred[first:] - mean) ** 2 * inside / (inside + 1)
    tails = scipy.special.fdtrc(1, inside - 1, squared / variance)
    beyond = np.logical_or.accumulate(tails * (inside + 1) <= level, axis=0)
    named = np.zeros(n, dtype=bool)
    named[order[first:][beyond]] = True
    return named


def _joint_outliers(values: Array, distances: Array, level: float) -> NDArray[np.intp]:
    """Return the places of the outliers by all columns together."""
    n, p = values.shape
    order = np.argsort(distances, kind="stable")
    scaled = (values - np.median(values, axis=0)) / values.std(axis=0)
    first = n - int(_SHARE * n)
    near = scaled[order[:first]]
    mean = near.mean(axis=0)
    scatter = (near - mean).T @ (near - mean)
    for k in range(first, n):
        off = np.asarray(scaled[order[k]] - mean, dtype=np.float64)
        covariance = scatter / (k - 1) + RIDGE * np.eye(p)
        solved = np.asarray(np.linalg.solve(covariance, off), dtype=np.float64)
        squared = np.dot(off, solved) * k / (k + 1)
        tail: Array = scipy.special.fdtrc(p, k - p, squared * (k - p) / (p * (k - 1)))
        if tail * (k + 1) <= level:
            return order[k:]
        mean = mean + off / (k + 1)
        scatter = scatter + np.outer(off, off) * k / (k + 1)
    return np.zeros(0, dtype=np.intp)
