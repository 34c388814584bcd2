"""Robust statistics that a few wrong values do not affect: scale, covariance, outliers.

The covariance is the minimum covariance determinant (Rousseeuw and Van Driessen 1999, Technometrics
41, 212–223): the covariance of those three quarters of the values for which its determinant is
smallest, found by the concentration steps of these authors. Nothing is drawn at random. The steps
start from the half of the values nearest the medians, and from the orthogonalised
Gnanadesikan–Kettenring estimator (Maronna and Zamar 2002, Technometrics 44, 307–317), which makes
the pairwise covariances (σ²(x + y) − σ²(x − y))/4 positive definite along their eigenvectors. The
values within χ²₀.₉₇₅ of this covariance give the final covariance. Up to 10 % of the values may
have a common error. p-values are selected so that the expected share of false discoveries is below
a bound (Benjamini and Hochberg 1995, Journal of the Royal Statistical Society B 57, 289–300).

Outliers are rows of a table that differ from the others; the limits account for the number of rows.

A row x is compared with the m rows nearer to the centre, using their mean and covariance S::

    T² = m/(m + 1) (x − mean)ᵀ S⁻¹ (x − mean),   T² (m − p)/(p (m − 1)) ~ F(p, m − p)

for normal rows (Hotelling). Because x is the farthest of m + 1 rows, its tail probability is
multiplied by m + 1. Rows are added in the order of their distance. The first row beyond the limit
and all later ones are outliers. This is the sequential test of Rosner (1983, Technometrics 25,
165–172), applied to all columns together as in Caroni and Prescott (1992, Applied Statistics 41,
355–364). Up to a quarter of the rows can be outliers. They cannot mask one another because none of
them is among the first three quarters.

Each column is also tested separately. The joint test finds rows that contradict the correlation,
and the test of a single column needs fewer rows to find one wrong coefficient among many.
"""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false

import numpy as np
import scipy

from inercal.basics.arrays import Array, Bools, Indices

FALSE_DISCOVERIES = 0.05  # expected share of false discoveries among those selected
_MAD_TO_SIGMA = 1.482602218505602  # of a normal distribution
_KEPT = 0.975  # share of good values included in the covariance
_CORE = 0.75  # share of all values with the smallest determinant
_PASSES, _STEPS = 2, 50
_SETTLED = 1e-9  # tolerance of the logarithm of the determinant
RIDGE = 1e-10
"""Smallest relative variance; dependent columns, as in a symmetric matrix, have no inverse."""
ROWS_A_COLUMN = 5
"""Rows needed per column; with fewer, the covariance is meaningless."""
_BEGIN_ROWS = 20_000  # most rows used for the start of the steps
NAMED_BY_CHANCE = 0.05
"""Expected number of rows flagged as outliers if there are none."""
_LEVEL = 0.9 * NAMED_BY_CHANCE  # sequential testing adds about a tenth
_TOGETHER = 0.2  # share of this rate for the joint test of all columns
_SHARE = 0.25  # largest share of rows that can be outliers
LEAST_ROWS = 10


def robust_scale(values: Array) -> Array:
    """Return each column's standard deviation from its median absolute deviation, (p,)."""
    return _MAD_TO_SIGMA * np.median(np.abs(values - np.median(values, axis=0)), axis=0)


def squared_distances(values: Array) -> tuple[Array, Array]:
    """Return each row's robust squared Mahalanobis distance, and the share of each column.

    Parameters
    ----------
    values : (n, p) array
        The values. A column without scatter is ignored. With fewer than `ROWS_A_COLUMN` rows per
        column, correlations are ignored.

    Returns
    -------
    distances : (n,) array
        Squared distances, scaled so that their median is that of χ² with p degrees of freedom.
    shares : (n, p) array
        Parts of the distance; their sum is the distance.
    """
    scale = robust_scale(values)
    used = scale > 0
    scaled = (values[:, used] - np.median(values[:, used], axis=0)) / scale[used]
    p = scaled.shape[1]
    shares = np.zeros(values.shape)
    if p == 0:
        return np.zeros(len(values)), shares
    if len(values) < ROWS_A_COLUMN * p:
        shares[:, used] = scaled**2
        return shares.sum(axis=1), shares
    near = np.argsort((scaled**2).sum(axis=1))[: max(len(scaled) // 2, p + 1)]
    begins = (
        _orthogonalised(scaled[:: -(-len(scaled) // _BEGIN_ROWS)]),
        (scaled[near].mean(axis=0), np.atleast_2d(np.cov(scaled[near].T))),
    )
    distances = min((_concentrated(scaled, *begin) for begin in begins), key=lambda one: one[0])[1]
    kept = scaled[distances <= float(scipy.special.chdtri(p, 1 - _KEPT))]
    distances, shares[:, used] = _distances(
        scaled, kept.mean(axis=0), np.atleast_2d(np.cov(kept.T))
    )
    return distances, shares


def _concentrated(values: Array, centre: Array, covariance: Array) -> tuple[float, Array]:
    """Return the smallest log-determinant that concentration steps reach, and the distances.

    Each step uses the covariance of the nearest values, which reduces the determinant.
    """
    core = max(int(_CORE * len(values)), values.shape[1] + 1)
    distances, before = _distances(values, centre, covariance)[0], np.inf
    for _ in range(_STEPS):
        kept = values[np.argpartition(distances, core - 1)[:core]]
        covariance = np.atleast_2d(np.cov(kept.T))
        distances = _distances(values, kept.mean(axis=0), covariance)[0]
        determinant = float(np.linalg.slogdet(covariance)[1])
        if not before - determinant > _SETTLED:
            break
        before = determinant
    return before, distances


def _distances(values: Array, centre: Array, covariance: Array) -> tuple[Array, Array]:
    """Return squared distances, scaled to the median of χ², and the columns' parts of them."""
    off = values - centre
    ridge = RIDGE * float(np.diag(covariance).mean())
    parts = off * np.linalg.solve(covariance + ridge * np.eye(len(covariance)), off.T).T
    distances = parts.sum(axis=1)
    factor = float(scipy.special.chdtri(values.shape[1], 0.5)) / np.median(distances)
    return distances * factor, parts * factor


def _orthogonalised(values: Array) -> tuple[Array, Array]:
    """Return the centre, (p,), and the orthogonalised covariance, (p, p), of scaled values."""
    back = np.eye(values.shape[1])
    turned = values
    for _ in range(_PASSES):
        scale = robust_scale(turned)
        scale = np.where(scale > 0, scale, 1.0)
        unit = turned / scale
        p = unit.shape[1]
        correlation = np.eye(p)
        for j in range(p):
            # Compare one column with all columns before it: compute all sums and differences at
            # once.
            sums = robust_scale(unit[:, :j] + unit[:, j : j + 1]) ** 2
            differences = robust_scale(unit[:, :j] - unit[:, j : j + 1]) ** 2
            correlation[j, :j] = correlation[:j, j] = (sums - differences) / 4
        axes = np.linalg.eigh(correlation)[1]
        turned, back = unit @ axes, back @ (scale[:, None] * axes)
    variance = np.maximum(robust_scale(turned) ** 2, np.finfo(float).tiny)
    return back @ np.median(turned, axis=0), back @ np.diag(variance) @ back.T


def false_discovery_selection(tails: Array, rate: float = FALSE_DISCOVERIES) -> Indices:
    """Return the indices of the rejected p-values, smallest first.

    Parameters
    ----------
    tails : (n,) array
        p-values.
    rate : float
        Upper bound for the expected share of false rejections.
    """
    order = np.argsort(tails, kind="stable")
    below = tails[order] <= rate * np.arange(1, len(tails) + 1) / len(tails)
    count = int(np.flatnonzero(below)[-1]) + 1 if below.any() else 0
    return order[:count]


def find_outliers(values: Array, distances: Array) -> Indices:
    """Return the row indices of the outliers, farthest first.

    Parameters
    ----------
    values : (n, p) array
        The rows. With fewer than `LEAST_ROWS` rows no outliers are found. A column without scatter
        is ignored.
    distances : (n,) array
        Robust squared distances from `inercal.estimation.uncertainty.robust.squared_distances`.
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


def _outliers_of_columns(values: Array, level: float) -> Bools:
    """Return which rows are outliers in at least one column, (n,)."""
    n = len(values)
    order = np.argsort(np.abs(values - np.median(values, axis=0)), axis=0)
    # Sums over the nearest 1, 2, … rows, relative to the median so that no digits are lost.
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


def _joint_outliers(values: Array, distances: Array, level: float) -> Indices:
    """Return the indices of the outliers found by the joint test of all columns."""
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
