"""Solve the damped normal equations in one of two ways.

Each step δ minimises |u − A δ|² + |v − B δ|² + λ |D δ|², where A are the whitened rows of the
observations and B those of the priors. D is the root of the diagonal of AᵀA + BᵀB (Marquardt 1963),
so neither the damping nor the conditioning depends on units. A few trials are solved by
QR factorisation of the rows, which keeps the accuracy of the rows. Many trials are solved together
by Cholesky factorisation of the normal equations, which is fast and accurate enough for
column-scaled condition numbers up to about 1e7 (Björck 1996, Numerical Methods for Least Squares
Problems, 2.4).
"""

from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Bools, Indices, row_products
from inercal.estimation.whitened_problem import column_lengths

Places = slice | Indices

# With fewer trials than this, loading the compiled kernel is not worthwhile.
QR_MAX_TRIALS = 64


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
    if max(len(rows), len(weight)) <= QR_MAX_TRIALS:
        stacked = _stacked(rows * weight[..., None], prior_rows)
        size = column_lengths(stacked)
        triangle, regular = _regular(np.linalg.qr(stacked / size[:, None])[1])
        inverse = np.linalg.inv(triangle) / size[..., None]
        found = inverse @ np.swapaxes(inverse, -1, -2)
        found[~regular] = np.nan
        return found, np.isfinite(found[:, 0, 0])
    normal, _ = _normal_equations(rows, weight, np.zeros((1, rows.shape[1])))
    return covariance_packed(normal, prior_rows)


def covariance_packed(normal: Array, prior_rows: Array) -> tuple[Array, Bools]:
    """Return the covariance from normal equations; for the arguments see `solve_packed`."""
    from inercal.estimation import _kernels

    return _kernels.inverse(normal, prior_rows.T @ prior_rows, _kernels.LANES)


def moves(
    step: GaussNewtonSteps, basis: Array | None, x: Array, some: Places
) -> tuple[Array, Array, Bools]:
    """Return moves of x, (trials, p), the decreases of χ² that they predict, and which moves exist.

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
    move[some] = free if basis is None else row_products(free, basis.T)
    predicted[some], ok[some] = step.predicted, step.ok
    return move, predicted, ok


def _stacked(rows: Array, prior_rows: Array) -> Array:
    """Return the rows of each trial above those of the priors, (trials, m + b, k)."""
    return np.concatenate(
        [rows, np.broadcast_to(prior_rows, (len(rows), *prior_rows.shape))], axis=1
    )


def _regular(triangles: Array) -> tuple[Array, Bools]:
    """Return triangles (trials, k, k), where a singular one is the identity, and which are not."""
    rows, k = triangles.shape[1:]
    if rows < k:
        return np.broadcast_to(np.eye(k), (len(triangles), k, k)), np.zeros(
            len(triangles), dtype=bool
        )
    diagonal = np.abs(np.diagonal(triangles, axis1=-2, axis2=-1))
    most = np.max(diagonal, axis=-1, initial=0.0, keepdims=True)
    regular = np.asarray(np.all(diagonal > 1e-14 * most, axis=-1), dtype=bool)
    return np.where(regular[:, None, None], triangles, np.eye(k)), regular


def _solve_by_qr(
    rows: Array, u: Array, prior_rows: Array, v: Array, damping: Array
) -> GaussNewtonSteps:
    (trials, m), k = u.shape, rows.shape[-1]
    stacked = _stacked(np.broadcast_to(rows, (trials, m, k)), prior_rows)
    right = np.concatenate([u, v], axis=-1)
    size = column_lengths(stacked)
    damped = np.concatenate(
        [stacked / size[:, None], np.sqrt(damping)[:, None, None] * np.eye(k)], axis=1
    )
    q, triangle = np.linalg.qr(damped)
    triangle, regular = _regular(triangle)
    target = np.swapaxes(q[:, : right.shape[1]], -1, -2) @ right[..., None]
    step = np.linalg.solve(triangle, target)
    # δᵀ(AᵀA + λD²)δ + λ δᵀD²δ loses no accuracy to cancellation.
    predicted = np.sum((triangle @ step)[..., 0] ** 2, axis=-1)
    step = np.where(regular[:, None], step[..., 0], 0.0)
    predicted = np.where(regular, predicted + damping * np.sum(step**2, axis=-1), 0.0)
    return GaussNewtonSteps(step / size, predicted, regular)
