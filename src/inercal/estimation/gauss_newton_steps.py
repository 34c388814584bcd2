"""Two solvers for the damped normal equations.

Each step δ minimises |u − A δ|² + |v − B δ|² + λ |D δ|², where A are the whitened rows of the
observations and B those of the priors. D is the root of the diagonal of AᵀA + BᵀB (Marquardt 1963),
so neither the damping nor the conditioning depends on units. A few trials are solved one by one by
QR factorisation of the rows, which keeps the accuracy of the rows. Many trials are solved together
by Cholesky factorisation of the normal equations, which is fast and accurate enough for
column-scaled condition numbers up to about 1e7 (Björck 1996, Numerical Methods for Least Squares
Problems, 2.4).
"""

from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Bools, Indices
from inercal.estimation.whitened_problem import column_lengths

Places = slice | Indices

# With fewer trials than this, loading the compiled kernel is not worthwhile.
QR_MAX_TRIALS = 8


class GaussNewtonSteps(NamedTuple):
    """Steps (trials, k), the predicted decreases of χ², and whether each step exists."""

    step: Array
    predicted: Array
    ok: Bools


def solve(
    rows: Array, weight: Array, u: Array, prior_rows: Array, v: Array, damping: Array
) -> GaussNewtonSteps:
    """Return one step for each trial.

    Parameters
    ----------
    rows, weight : (trials, m, k) and (trials, m) arrays
        A is diag(weight) · rows. Either array may have a single trial that all trials share.
    u : (trials, m) array
        Whitened residual of the observations.
    prior_rows, v : (b, k) and (trials, b) arrays
        Whitened rows and residuals of the priors.
    damping : (trials,) array
        λ.
    """
    if len(u) <= QR_MAX_TRIALS:
        return _solve_by_qr(rows * weight[..., None], u, prior_rows, v, damping)
    normal, gradient = _normal_equations(rows, weight, u)
    return solve_packed(normal, gradient, prior_rows, v, damping)


def solve_packed(
    normal: Array, gradient: Array, prior_rows: Array, v: Array, damping: Array
) -> GaussNewtonSteps:
    """Return one step for each trial, computed from its normal equations.

    Parameters
    ----------
    normal : (trials, k (k + 1)/2) array
        Lower triangle of AᵀA, row after row; it may have a single trial that all trials share.
    gradient : (trials, k) array
        Aᵀu.
    prior_rows, v, damping
        See `solve`.
    """
    from inercal.estimation import _kernels

    prior, whole = prior_rows.T @ prior_rows, gradient + v @ prior_rows
    return GaussNewtonSteps(*_kernels.solve(normal, prior, whole, damping, _kernels.LANES))


def _normal_equations(rows: Array, weight: Array, u: Array) -> tuple[Array, Array]:
    """Return AᵀA, (1 or trials, k (k + 1)/2), and Aᵀu, (trials, k)."""
    if len(rows) == len(weight) == 1:
        a = rows[0] * weight[0][:, None]
        return (a.T @ a)[np.tril_indices(a.shape[1])][None], u @ a
    from inercal.estimation import _kernels

    rows, weight, u = (np.ascontiguousarray(a) for a in (rows, weight, u))
    return _kernels.normal_equations(rows, weight, u, _kernels.LANES)


def covariance(rows: Array, weight: Array, prior_rows: Array) -> tuple[Array, Bools]:
    """Return the covariance (AᵀA + BᵀB)⁻¹, (trials, k, k), and whether it exists (trials,).

    For the arguments see `solve`. If all trials share rows and weights, they also share the result,
    which then has a single trial.
    """
    trials, k = max(len(rows), len(weight)), rows.shape[-1]
    if trials <= QR_MAX_TRIALS:
        result = np.full((trials, k, k), np.nan)
        for t, a in enumerate(rows * weight[..., None]):
            stacked = np.concatenate([a, prior_rows])
            size = column_lengths(stacked)
            triangle: Array = np.linalg.qr(stacked / size)[1]
            if _is_regular(triangle):
                inverse = np.linalg.inv(triangle) / size[:, None]
                result[t] = inverse @ inverse.T
        return result, np.isfinite(result[:, 0, 0])
    normal, _ = _normal_equations(rows, weight, np.zeros((1, rows.shape[1])))
    return covariance_packed(normal, prior_rows)


def covariance_packed(normal: Array, prior_rows: Array) -> tuple[Array, Bools]:
    """Return the covariance from normal equations; for the arguments see `solve_packed`."""
    from inercal.estimation import _kernels

    return _kernels.inverse(normal, prior_rows.T @ prior_rows, _kernels.LANES)


def moves(
    step: GaussNewtonSteps, basis: Array | None, x: Array, some: Places
) -> tuple[Array, Array, Bools]:
    """Return moves of x (trials, p), predicted decreases of χ² (trials,), and which exist.

    A move that does not exist is zero.

    Parameters
    ----------
    step : GaussNewtonSteps
        Steps of some trials, in free coordinates.
    basis : (p, k) array, optional
        Matrix from free coordinates to parameters; None means the identity.
    x : (trials, p) array
    some : slice or array of int
        Indices of these trials.
    """
    move, predicted = np.zeros_like(x), np.zeros(len(x))
    ok = np.zeros(len(x), dtype=bool)
    free = np.where(step.ok[:, None], step.step, 0.0)
    move[some] = free if basis is None else free @ basis.T
    predicted[some], ok[some] = step.predicted, step.ok
    return move, predicted, ok


def _is_regular(triangle: Array) -> bool:
    diagonal = np.abs(np.diagonal(triangle))
    square = triangle.shape[0] == triangle.shape[1]
    return square and bool(np.all(diagonal > 1e-14 * np.max(diagonal, initial=0.0)))


def _solve_by_qr(
    rows: Array, u: Array, prior_rows: Array, v: Array, damping: Array
) -> GaussNewtonSteps:
    (trials, m), k = u.shape, rows.shape[-1]
    rows = np.broadcast_to(rows, (trials, m, k))
    result = GaussNewtonSteps(np.zeros((trials, k)), np.zeros(trials), np.zeros(trials, dtype=bool))
    for t in range(trials):
        stacked = np.concatenate([rows[t], prior_rows])
        right = np.concatenate([u[t], v[t]])
        size = column_lengths(stacked)
        damped = np.concatenate([stacked / size, np.sqrt(damping[t]) * np.eye(k)])
        q, triangle = np.linalg.qr(damped)
        if not _is_regular(triangle):
            continue
        step = np.linalg.solve(triangle, q[: len(right)].T @ right)
        result.step[t] = step / size
        # δᵀ(AᵀA + λD²)δ + λ δᵀD²δ loses no accuracy to cancellation.
        result.predicted[t] = np.sum((triangle @ step) ** 2) + damping[t] * np.sum(step**2)
        result.ok[t] = True
    return result
