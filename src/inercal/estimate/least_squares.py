"""Batched nonlinear least squares: Levenberg–Marquardt, for many trials at once.

Minimises  Σ ρ(uᵢ(x)) + Σ |L⁻¹(μ − x)|²  over x that satisfy the gauges, where u is the whitened
residual and ρ = u² or a robust loss, of influence ψ = ρ′/2. Each step solves the equations of
`gauss_newton_steps` (Marquardt 1963, SIAM J. 11, 431–441); a robust loss enters by iterated weights
w = ψ/u. Each trial has its own damping, acceptance and convergence; the damping follows the gain
of the last step (Nielsen 1999, IMM-REP-1999-05). The search starts undamped, since calibrations
are nearly linear.

A trial has converged when the error that the next step would leave is negligible against the cost:
with δ₀, δ the last two steps in standard deviations, δ²·min(1, δ²/δ₀²) < 10⁻¹⁵ cost + ε, ε the
cost of rounding (δ² alone where weights are iterated); or when the step is below 10⁻¹² of every
parameter or of its typical size. The last step is still taken. It is rejected only if it raises the
cost and predicts a fall below rounding: where χ² is far below one, rounding is a large part of it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from inercal.arrays import Array
from inercal.estimate import gauss_newton_steps, nullspace
from inercal.estimate.lazy_value import LazyValue
from inercal.estimate.problem import Problem
from inercal.estimate.result import Estimate
from inercal.estimate.scores import NO_SCORE_TESTS, Candidate, ScoreTestSet, score_tests
from inercal.estimate.whitened_problem import LinearisationPoint, WhitenedProblem

Bools = NDArray[np.bool_]

# λ after the first rejected step, the least nonzero λ, and λ at which a search ends.
_FIRST, _LEAST, _MOST = 1e-2, 1e-12, 1e14


@dataclass(frozen=True)
class Cauchy:
    """A loss that is logarithmic beyond the threshold: a far outlier has hardly any influence.

    The default threshold keeps 95 % of the efficiency of least squares where the noise is Gaussian
    (Holland and Welsch 1977, Communications in Statistics A6, 813–827, table 1).
    """

    threshold: float = 2.385

    def cost(self, u: Array) -> Array:
        """Return ρ(u)."""
        return self.threshold**2 * np.log1p((u / self.threshold) ** 2)

    def weight(self, u: Array) -> Array:
        """Return w(u) = ψ(u)/u."""
        return 1 / (1 + (u / self.threshold) ** 2)

    def slope(self, u: Array) -> Array:
        """Return ψ′(u)."""
        z = (u / self.threshold) ** 2
        return (1 - z) / (1 + z) ** 2


def least_squares(
    problem: Problem, loss: Cauchy | None = None, max_iterations: int = 200
) -> Estimate:
    """Solve a problem, or each trial of a problem.

    Parameters
    ----------
    problem : Problem
        Its start decides which directions count as observable.
    loss : Cauchy, optional
        Robust loss on the whitened residuals of the observations (not of the priors); with
        correlated noise it acts on the decorrelated residuals.
    max_iterations : int, optional
        Steps tried at most.

    Returns
    -------
    Estimate
        `converged` is False for a trial that did not reach a minimum. With a loss the covariance
        is the asymptotic one of an M-estimator (see `_robust_covariance`).

    Raises
    ------
    InputError
        Shapes, noise or values that cannot be used.
    NotObserved
        Wanted parameters that neither data nor priors nor gauges determine, at the start or at
        the solution.
    """
    system = WhitenedProblem(problem)
    structure = nullspace.observability(system, system.first)
    point, converged, iterations = search(system, loss, max_iterations)
    if converged[0]:
        # An accident at the solution, such as a parameter of zero, may hide what the start shows.
        at_solution = nullspace.observability(system, point)
        structure = min(structure, at_solution, key=lambda s: s.rank)
    return estimate_at_solution(system, point, structure, converged, iterations, loss)


def estimate_at_solution(
    system: WhitenedProblem,
    point: LinearisationPoint,
    structure: nullspace.Observability,
    converged: Bools,
    iterations: NDArray[np.intp],
    loss: Cauchy | None = None,
) -> Estimate:
    """Return the estimate at a solution, without the axis of trials if the problem has none."""
    if loss is None:
        covariance, exists = gauss_newton_steps.covariance(
            point.rows, point.weight, system.prior_rows
        )
        pull = point.whitened
    else:
        covariance, exists = _robust_covariance(system, point, loss)
        pull = loss.weight(point.whitened) * point.whitened
    if system.basis is not None:
        covariance = system.basis @ covariance @ system.basis.T
    covariance = np.broadcast_to(covariance, (system.trials, *covariance.shape[1:]))
    chi2 = np.sum(pull**2, axis=-1) + np.sum(point.prior**2, axis=-1)
    first = 0 if system.single else slice(None)
    candidates = system.single and loss is None and system.problem.candidates is not None
    return Estimate(
        names=system.problem.names,
        value=point.x[first],
        covariance=covariance[first],
        chi2=chi2[first],
        dof=system.dof,
        residual=point.residual[first],
        whitened=point.whitened[first],
        observations=system.problem.observations,
        wanted=system.problem.wanted,
        rank=structure.rank,
        singular_values=structure.singular_values,
        null_directions=structure.null_directions,
        weakest=structure.weakest,
        converged=(converged & exists)[first],
        iterations=iterations[first],
        scoring=LazyValue(lambda: _score_tests_at_solution(system, point))
        if candidates
        else NO_SCORE_TESTS,
    )


def _score_tests_at_solution(system: WhitenedProblem, point: LinearisationPoint) -> ScoreTestSet:
    """Return the score tests of the problem's candidates at the solution of its one trial."""
    assert system.problem.candidates is not None
    inverse, full = system.whitener(point.x)
    width, left_out = len(system.prior_rows), system.problem.candidates(point.x[0])

    def whitened() -> Iterator[Candidate]:
        for one in left_out:
            rows = inverse[0] @ one.rows if full else inverse[0][:, None] * one.rows
            yield replace(one, rows=np.concatenate([rows, np.zeros((width, rows.shape[1]))]))

    jacobian = np.concatenate([point.weight[0][:, None] * point.rows[0], system.prior_rows])
    residual = np.concatenate([point.whitened[0], point.prior[0]])
    # What comes one by one is not kept together: of hundreds of rows it would not fit.
    found = list(whitened()) if isinstance(left_out, Sequence) else whitened()
    return score_tests(residual, jacobian, found, system.basis)


def search(
    system: WhitenedProblem, loss: Cauchy | None, max_iterations: int
) -> tuple[LinearisationPoint, Bools, NDArray[np.intp]]:
    """Return the last point, which trials converged (trials,), and the steps tried (trials,).

    Parameters
    ----------
    system : WhitenedProblem
    loss : Cauchy or None
        As of `least_squares`.
    max_iterations : int
        Steps tried at most.
    """
    trials = system.trials
    point, whitener = system.first, system.first_whitener
    cost, previous = _cost(point, loss), np.zeros(trials)
    damping, growth = np.zeros(trials), np.full(trials, 2.0)
    converged, active = np.zeros(trials, dtype=bool), np.ones(trials, dtype=bool)
    iterations = np.zeros(trials, dtype=np.intp)
    # Weights that change slow the last steps down, so that the ratio of two promises too much.
    reweighted = loss is not None or not system.constant_noise
    for _ in range(max_iterations):
        move, predicted, ok = _step(system, point, loss, damping, active)
        settled = (
            ok
            & (damping <= 1e-3)
            & _has_converged(system, point.x, move, predicted, previous, cost)
        )
        iterations += active

        x = point.x + move
        residual, jacobian = system.evaluate(x)
        # By the weights of the old point: costs compare only under the same weights.
        tried = system.point(x, residual, jacobian, whitener)
        fall = cost - _cost(tried, loss)
        # Where the promise is no more than the rounding of the cost, so is the fall: no failure.
        slack = system.problem.rounding * cost + _rounding_cost(system)
        gain = np.where(predicted > 1e3 * slack, fall / np.maximum(predicted, slack), 1.0)
        # A point that is not finite falls by NaN, and so is refused.
        accepted = ~active | (ok & (fall >= -slack) & (gain > 1e-3))

        x = x if accepted.all() else np.where(accepted[:, None], x, point.x)
        # Where every trial stays at its point, so do its weights: a model beyond its fold is slow.
        if not system.constant_noise and accepted.any():
            whitener = system.whitener(x)
            tried = system.point(x, residual, jacobian, whitener)
        point = tried if accepted.all() else _merge(accepted, tried, point)
        cost = _cost(point, loss)
        if not reweighted:
            previous = np.where(accepted & active, predicted, previous)
        # A last step that promises less than rounding makes: the cost need not fall by it.
        converged |= active & settled & (accepted | (predicted <= slack))
        # Accepted: λ falls to a tenth at a full gain, and doubles at none. Refused: ever faster up.
        less = damping * np.maximum(0.1, 1 - (2 * np.clip(gain, 0, 2) - 1) ** 3)
        less[less < _LEAST] = 0.0
        damping = np.where(accepted, less, np.maximum(damping * growth, _FIRST * (damping == 0)))
        growth = np.where(accepted, 2.0, 2 * growth)
        active = ~converged & (damping < _MOST)
        if not active.any():
            break
    return point, converged, iterations


def _step(
    system: WhitenedProblem,
    point: LinearisationPoint,
    loss: Cauchy | None,
    damping: Array,
    active: Bools,
) -> tuple[Array, Array, Bools]:
    """Return moves of x (trials, p), predicted falls (trials,), which exist; of active ones."""
    some = slice(None) if active.all() else np.flatnonzero(active)
    rows, weight = (a if len(a) == 1 else a[some] for a in (point.rows, point.weight))
    u = point.whitened[some]
    if loss is not None:
        root = np.sqrt(loss.weight(u))
        weight, u = root * weight, root * u
    step = gauss_newton_steps.solve(
        rows, weight, u, system.prior_rows, point.prior[some], damping[some]
    )
    move = np.zeros_like(point.x)
    predicted, ok = np.zeros(len(move)), np.zeros(len(move), dtype=bool)
    free = np.where(step.ok[:, None], step.step, 0.0)
    move[some] = free if system.basis is None else free @ system.basis.T
    predicted[some], ok[some] = step.predicted, step.ok
    return move, predicted, ok


def _has_converged(
    system: WhitenedProblem, x: Array, move: Array, predicted: Array, previous: Array, cost: Array
) -> Bools:
    """Return whether no error worth another step will be left after this one (trials,)."""
    rate = predicted / np.maximum(previous, predicted + np.finfo(float).tiny)
    size = 1e-12 * np.maximum(np.abs(x), system.problem.scale)
    tiny = np.all(np.abs(move) <= size, axis=-1)
    return tiny | (
        predicted * np.where(previous > 0, rate, 1.0) <= 1e-15 * cost + _rounding_cost(system)
    )


def _rounding_cost(system: WhitenedProblem) -> float:
    """Return the cost that rounding alone makes where the observations agree with the model."""
    return 1e-20 + system.m * system.problem.rounding**2


def _cost(point: LinearisationPoint, loss: Cauchy | None) -> Array:
    """Return Σ ρ(u) + Σ v² (trials,)."""
    with np.errstate(over="ignore", invalid="ignore"):
        u = point.whitened**2 if loss is None else loss.cost(point.whitened)
        return np.sum(u, axis=-1) + np.sum(point.prior**2, axis=-1)


def _merge(chosen: Bools, new: LinearisationPoint, old: LinearisationPoint) -> LinearisationPoint:
    """Return the new point in the chosen trials, the old one in the others."""
    return LinearisationPoint(
        *(
            np.where(chosen.reshape(-1, *[1] * (a.ndim - 1)), a, b)
            for a, b in zip(new, old, strict=True)
        )
    )


def _robust_covariance(
    system: WhitenedProblem, point: LinearisationPoint, loss: Cauchy
) -> tuple[Array, Bools]:
    """Return the asymptotic covariance of an M-estimator (trials, k, k), and where it exists.

    K² H⁻¹ M H⁻¹ with N = AᵀA of the observations and P of the priors, H = mean(ψ′) N + P,
    M = Σψ²/ν N + P and K = 1 + (k/m) var(ψ′)/mean(ψ′)²: without priors it is the first form in
    Huber 1981, Robust Statistics, section 7.6. Priors are Gaussian and enter H and M whole.
    """
    u, weight = point.whitened, point.weight
    slope = loss.slope(u)
    mean = np.mean(slope, axis=-1)
    pull = np.sum((loss.weight(u) * u) ** 2, axis=-1) / max(system.dof, 1)
    # More outliers than good observations: the curvature is gone, and with it the formula.
    usable = mean > 0.05
    mean = np.where(usable, mean, 1.0)
    inverse, ok = gauss_newton_steps.covariance(
        point.rows, np.sqrt(mean)[:, None] * weight, system.prior_rows
    )
    rows = weight[..., None] * point.rows
    normal = np.swapaxes(rows, -1, -2) @ rows
    meat = pull[:, None, None] * normal + system.prior_rows.T @ system.prior_rows
    k = 1 + system.free / system.m * np.var(slope, axis=-1) / mean**2
    return k[:, None, None] ** 2 * (inverse @ meat @ inverse), ok & usable
