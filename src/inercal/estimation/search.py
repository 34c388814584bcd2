"""Levenberg–Marquardt search for the minimum, for many trials at once.

Minimises  Σ ρ(uᵢ(x)) + Σ |L⁻¹(μ − x)|²  over x that satisfy the gauges, where u is the whitened
residual and ρ = u² or a robust loss. Each step solves the equations of `gauss_newton_steps`
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
"""

from collections.abc import Iterable
from typing import Protocol, TypeVar

import numpy as np

from inercal.basics.arrays import Array, Bools, Indices
from inercal.estimation.problem import Problem

# λ after the first rejected step, the smallest nonzero λ, and the λ at which a search ends.
_FIRST, _LEAST, _MOST = 1e-2, 1e-12, 1e14
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

    @property
    def first(self) -> P:
        """The point at which the search starts."""
        ...

    @property
    def reweighted(self) -> bool:
        """Whether the weights change from step to step."""
        ...

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


def search(system: Trials[P], max_iterations: int) -> tuple[P, Bools, Indices]:
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
