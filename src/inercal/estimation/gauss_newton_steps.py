"""Levenberg–Marquardt search for the minimum, for many trials at once.

Minimises  Σ ρ(uᵢ(x)) + Σ |L⁻¹(μ − x)|²  over x that satisfy the gauges, where u is the whitened
residual and ρ = u² or a robust loss. Each step solves the equations below
(Marquardt 1963, SIAM J. 11, 431–441). Each trial has its own damping, acceptance and convergence;
the damping follows the gain of the last step (Nielsen 1999, IMM-REP-1999-05). The search starts
undamped, because calibrations are nearly linear.

A trial has converged when the error that the next step would leave is negligible compared with the
cost: δ²·max(δ²/δ₀², 10⁻⁵) < 10⁻¹⁵ cost + ε (only δ² if weights are iterated), where δ₀ and δ are
the last two steps in standard deviations and ε is the cost of rounding. It has also converged when
the step is below 10⁻¹² of every parameter or of its typical size. The bound 10⁻⁵ is needed because
the residuals make later steps converge more slowly than the first ones. The last step is still
taken. If it is below 10⁻⁸ of a standard deviation, residuals and derivatives are not computed
again. Otherwise the step is rejected only if it raises the cost and predicts a decrease below
rounding, because rounding is a large part of χ² if χ² is far below one.

The damped normal equations of a step are solved in one of two ways.

Each step δ minimises |u − A δ|² + |v − B δ|² + λ |D δ|², where A are the whitened rows of the
observations and B those of the priors. D is the root of the diagonal of AᵀA + BᵀB (Marquardt 1963),
so neither the damping nor the conditioning depends on units. A few trials are solved by
QR factorisation of the rows, which keeps the accuracy of the rows. Many trials are solved together
by Cholesky factorisation of the normal equations, which is fast and accurate enough for
column-scaled condition numbers up to about 1e7 (Björck 1996, Numerical Methods for Least Squares
Problems, 2.4).
"""

from collections.abc import Iterable
from typing import NamedTuple, Protocol, TypeVar

import numpy as np

from inercal.basics.arrays import Array, Bools, Indices, row_products
from inercal.estimation.problem import Problem
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
        found = inverse @ inverse.mT
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
    n, (rows, k) = len(triangles), triangles.shape[1:]
    if rows < k:
        return np.broadcast_to(np.eye(k), (n, k, k)), np.zeros(n, dtype=bool)
    diagonal = np.abs(np.linalg.diagonal(triangles))
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
    target = q[:, : right.shape[1]].mT @ right[..., None]
    step = np.linalg.solve(triangle, target)
    # δᵀ(AᵀA + λD²)δ + λ δᵀD²δ loses no accuracy to cancellation.
    predicted = np.sum((triangle @ step)[..., 0] ** 2, axis=-1)
    step = np.where(regular[:, None], step[..., 0], 0.0)
    predicted = np.where(regular, predicted + damping * np.sum(step**2, axis=-1), 0.0)
    return GaussNewtonSteps(step / size, predicted, regular)


# λ after the first rejected step, the smallest nonzero λ, and the λ at which a search ends.
_FIRST, _LEAST, _MOST = 1e-2, 1e-12, 1e14
MAX_ITERATIONS = 200
_NEGLIGIBLE = 1e-16  # squared length of a step in standard deviations


class Point(Protocol):
    """A problem linearised at x (trials, p); a named tuple of arrays with a trials dimension."""

    @property
    def x(self) -> Array:
        """Parameters (trials, p)."""
        ...

    def __iter__(self) -> Iterable[Array]: ...


P = TypeVar("P", bound=Point)


class Trials(Protocol[P]):
    """Problems with the same structure that are solved together."""

    problem: Problem
    trials: int
    m: int
    first: P  # the point at which the search starts
    reweighted: bool  # whether the weights change from step to step

    def cost(self, point: P) -> Array:
        """Return Σ ρ(u) + Σ v² at a point, (trials,)."""
        ...

    def step(self, point: P, damping: Array, active: Bools) -> tuple[Array, Array, Bools]:
        """Return moves of x (trials, p), predicted decreases and which exist, for active trials."""
        ...

    def tried(self, x: Array, point: P, active: Bools) -> tuple[P, Array]:
        """Return the point at x, (trials, p), and its cost with the weights of `point`.

        Trials that are not active keep their values.
        """
        ...

    def with_values(self, point: P, x: Array, chosen: Bools) -> P:
        """Return the point with x, (trials, p), replaced in the chosen trials."""
        ...

    def accepted(self, tried: P, point: P, chosen: Bools) -> P:
        """Return a merged point: in the chosen trials the tried point, elsewhere `point`."""
        ...


def search(system: Trials[P], max_iterations: int = MAX_ITERATIONS) -> tuple[P, Bools, Indices]:
    """Return the final point, which trials converged (trials,), and the number of steps (trials,).

    Parameters
    ----------
    system : Trials
    max_iterations : int
        Largest number of steps to try.
    """
    trials = system.trials
    point = system.first
    cost, previous = system.cost(point), np.zeros(trials)
    damping, growth = np.zeros(trials), np.full(trials, 2.0)
    converged, active = np.zeros(trials, dtype=bool), np.ones(trials, dtype=bool)
    iterations = np.zeros(trials, dtype=np.intp)
    for _ in range(max_iterations):
        move, predicted, ok = system.step(point, damping, active)
        settled = (
            ok
            & (damping <= 1e-3)
            & _has_converged(system, point.x, move, predicted, previous, cost)
        )
        iterations += active
        last = active & settled & (damping == 0) & (predicted <= _NEGLIGIBLE)
        if last.any():
            point = system.with_values(point, point.x + move, last)
            move[last] = 0.0
            converged |= last
            active &= ~last
            if not active.any():
                break

        # Use the weights of the old point: costs are comparable only with the same weights.
        tried, cost_then = system.tried(point.x + move, point, active)
        fall = cost - cost_then
        # If the predicted decrease is below the rounding of the cost, it is no failure if the cost
        # does not decrease.
        slack = system.problem.rounding * cost + _rounding_cost(system)
        gain = np.where(predicted > 1e3 * slack, fall / np.maximum(predicted, slack), 1.0)
        # At a point that is not finite the decrease is NaN, so the point is rejected.
        accepted = ~active | (ok & (fall >= -slack) & (gain > 1e-3))

        point = system.accepted(tried, point, accepted)
        cost = system.cost(point)
        # Changing weights slow the last steps down, so the ratio of two steps would be too
        # optimistic.
        if not system.reweighted:
            previous = np.where(accepted & active, predicted, previous)
        # If the last step predicts a decrease below rounding, the cost need not decrease.
        converged |= active & settled & (accepted | (predicted <= slack))
        # Accepted steps reduce λ to a tenth at full gain and double it at no gain. Rejected steps
        # raise λ ever faster.
        less = damping * np.maximum(0.1, 1 - (2 * np.clip(gain, 0, 2) - 1) ** 3)
        less[less < _LEAST] = 0.0
        damping = np.where(accepted, less, np.maximum(damping * growth, _FIRST * (damping == 0)))
        growth = np.where(accepted, 2.0, 2 * growth)
        active = ~converged & (damping < _MOST)
        if not active.any():
            break
    return point, converged, iterations


def _has_converged(
    system: Trials[P], x: Array, move: Array, predicted: Array, previous: Array, cost: Array
) -> Bools:
    """Return whether the error left after this step is negligible (trials,)."""
    rate = np.maximum(predicted / np.maximum(previous, predicted + np.finfo(float).tiny), 1e-5)
    size = 1e-12 * np.maximum(np.abs(x), system.problem.scale)
    tiny = np.all(np.abs(move) <= size, axis=-1)
    return tiny | (
        predicted * np.where(previous > 0, rate, 1.0) <= 1e-15 * cost + _rounding_cost(system)
    )


def _rounding_cost(system: Trials[P]) -> float | Array:
    """Return the cost due to rounding if the observations agree exactly with the model."""
    return 1e-20 + system.m * system.problem.rounding**2


def merge(chosen: Bools, new: Iterable[Array], old: Iterable[Array]) -> list[Array]:
    """Return the new arrays for the chosen trials and the old ones for the others."""
    return [
        np.where(chosen.reshape(-1, *[1] * (a.ndim - 1)), a, b)
        for a, b in zip(new, old, strict=True)
    ]
