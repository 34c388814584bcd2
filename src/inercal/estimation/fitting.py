"""Solve problems that provide the Jacobian of their rows by least squares.

`inercal.estimation.gauss_newton_steps` finds the minimum. A robust loss with influence function
ψ = ρ′/2 enters the steps of the search through iterated weights w = ψ/u.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from inercal.basics.arrays import Array, Bools, Indices
from inercal.basics.errors import NotObserved
from inercal.estimation import gauss_newton_steps, nullspace
from inercal.estimation.candidate_scores import (
    score_tests,
    score_tests_of_trials,
    spanned_candidates,
)
from inercal.estimation.gauss_newton_steps import MAX_ITERATIONS, merge, search
from inercal.estimation.lazy_value import LazyValue
from inercal.estimation.problem import Problem
from inercal.estimation.residual_scatter import WhitenedRows
from inercal.estimation.result import NO_ROWS, OF_TRIALS, Estimate
from inercal.estimation.scores import (
    NO_SCORE_TESTS,
    Candidate,
    ScoreTestSet,
    UnlikeTrials,
    with_rows,
)
from inercal.estimation.whitened_problem import LinearisationPoint, WhitenedProblem

_PULLED = 6.0  # deviation in prior standard deviations, beyond which the fit contradicts the prior
_MOST_KEPT = 5000  # most observations whose rows the estimate keeps; tables of means have fewer


@dataclass(frozen=True)
class Cauchy:
    """The Cauchy loss, which grows logarithmically, so that far outliers have little influence.

    With the default threshold, the efficiency for Gaussian noise is 95 % of that of least squares
    (Holland and Welsch 1977, Communications in Statistics A6, 813–827, table 1).
    """

    threshold: float = 2.385

    def cost(self, u: Array) -> Array:
        """Return the loss ρ(u)."""
        return self.threshold**2 * np.log1p((u / self.threshold) ** 2)

    def weight(self, u: Array) -> Array:
        """Return the weight w(u) = ψ(u)/u."""
        return 1 / (1 + (u / self.threshold) ** 2)

    def slope(self, u: Array) -> Array:
        """Return the derivative ψ′(u) of the influence function."""
        z = (u / self.threshold) ** 2
        return (1 - z) / (1 + z) ** 2


def least_squares(
    problem: Problem, loss: Cauchy | None = None, max_iterations: int = MAX_ITERATIONS
) -> Estimate:
    """Solve a problem, or every trial of a problem, by least squares.

    Parameters
    ----------
    problem : Problem
        The problem; its start values decide which directions count as observable.
    loss : Cauchy, optional
        Robust loss on the whitened residuals of the observations (not of the priors). With
        correlated noise it acts on the decorrelated residuals.
    max_iterations : int, optional
        Largest number of steps to try.

    Returns
    -------
    Estimate
        `converged` is False for a trial that did not reach a minimum. With a loss, the covariance
        is the asymptotic covariance of an M-estimator (see `_robust_covariance`).

    Raises
    ------
    InputError
        Shapes, noise or values are invalid.
    NotObserved
        Neither data nor priors nor gauges determine some wanted parameters, at the start or at the
        solution.
    """
    system = WhitenedProblem(problem)
    structure = nullspace.observability(system, system.first)
    point, converged, iterations = search(LinearisedRows(system, loss), max_iterations)
    if converged[0]:
        structure = _least_observable(structure, system, point)
    return estimate_at_solution(system, point, structure, converged, iterations, loss)


def least_squares_each(problem: Problem) -> list[Estimate | None]:
    """Solve every trial of a problem as if it were solved alone, with its own score tests.

    The trials share the search and the linearisation for the score tests. The result is None for a
    trial that must be solved alone, because it has no solution, contradicts its priors, or has
    different candidates.

    Parameters
    ----------
    problem : Problem
        A problem with trials.

    Raises
    ------
    InputError
        Shapes, noise or values are invalid.
    """
    system = WhitenedProblem(problem)
    point, converged, iterations = search(LinearisedRows(system))
    usable = converged & ~np.any(_contradicted_priors(system, point), axis=-1)
    try:
        tested = score_tests_of_trials(*_whitened_candidates(system, point), system.basis)
    except UnlikeTrials:
        return [None] * system.trials

    whole = estimate_at_solution(system, point, nullspace.UNKNOWN, usable, iterations)

    def alone(k: int) -> Estimate | None:
        here = point.of_trial(k)
        try:
            structure = nullspace.observability(system, system.first.of_trial(k))
            structure = _least_observable(structure, system, here)
        except NotObserved:
            return None
        return replace(
            whole,
            **structure._asdict(),
            **{name: getattr(whole, name)[k] for name in OF_TRIALS},
            scoring=LazyValue(lambda: tested[k]),
            rows=LazyValue(lambda: _whitened_rows(system, point, k)),
        )

    return [alone(k) if fine else None for k, fine in enumerate(whole.converged.tolist())]


def _least_observable(
    structure: nullspace.Observability, system: WhitenedProblem, point: LinearisationPoint
) -> nullspace.Observability:
    """Return the observability at the start or at the solution, whichever shows less.

    A coincidence at the solution, such as a parameter that is zero, may hide a direction that the
    start shows.
    """
    return min(structure, nullspace.observability(system, point), key=lambda s: s.rank)


def estimate_at_solution(
    system: WhitenedProblem,
    point: LinearisationPoint,
    structure: nullspace.Observability,
    converged: Bools,
    iterations: Indices,
    loss: Cauchy | None = None,
) -> Estimate:
    """Return the estimate at a solution, without a trials dimension if the problem has none."""
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
        **structure._asdict(),
        converged=(converged & exists)[first],
        iterations=iterations[first],
        scoring=LazyValue(lambda: _score_tests_at_solution(system, point))
        if candidates
        else NO_SCORE_TESTS,
        rows=LazyValue(lambda: _whitened_rows(system, point))
        if system.single and loss is None and system.m <= _MOST_KEPT
        else NO_ROWS,
    )


def _whitened_rows(
    system: WhitenedProblem, point: LinearisationPoint, trial: int = 0
) -> WhitenedRows:
    """Return the whitened rows of a trial at a point."""
    whitener, own = system.whitener(point.x).of_trial(trial), point.of_trial(trial)

    def whiten(rows: Array) -> Array:
        return whitener.whiten(rows)[0]

    jacobian = own.weight[0][:, None] * own.rows[0]
    return WhitenedRows(own.whitened[0], jacobian, own.prior[0], system.prior_rows, whiten)


def _score_tests_at_solution(system: WhitenedProblem, point: LinearisationPoint) -> ScoreTestSet:
    """Return the score tests of the candidates at the solution of a single-trial problem."""
    residual, jacobian, found = _whitened_candidates(system, point)
    # Candidates that arrive one by one are not collected: with hundreds of rows they would not fit
    # in memory.
    spanned = _spanned_at_statements(system, point) if isinstance(found, Sequence) else ()
    return score_tests(residual[0], jacobian[0], found, system.basis, spanned)


def _whitened_candidates(
    system: WhitenedProblem, point: LinearisationPoint
) -> tuple[Array, Array, Iterable[Candidate]]:
    """Return the whitened residual, Jacobian and candidates at a point, including prior rows.

    They have a trials dimension, except for the candidates of a single-trial problem.
    """
    assert system.problem.candidates is not None
    width = len(system.prior_rows)
    left_out = system.problem.candidates(point.x[0] if system.single else point.x)
    whitener = system.whitener(point.x)

    def whitened(together: Sequence[Candidate]) -> list[Candidate]:
        lead = () if system.single else (len(point.x),)
        rows = np.concatenate(
            [np.broadcast_to(one.rows, (*lead, *one.rows.shape[-2:])) for one in together], axis=-1
        )
        rows = whitener.whiten(rows)
        rows = np.concatenate([rows, np.zeros((len(rows), width, rows.shape[-1]))], axis=1)
        return with_rows(together, rows[0] if system.single else rows)

    residual = np.concatenate([point.whitened, point.prior], axis=-1)
    jacobian = point.weight[..., None] * point.rows
    prior = np.broadcast_to(system.prior_rows, (len(jacobian), *system.prior_rows.shape))
    jacobian = np.concatenate([jacobian, prior], axis=1)
    jacobian = np.broadcast_to(jacobian, (len(residual), *jacobian.shape[1:]))
    if isinstance(left_out, Sequence):
        return residual, jacobian, whitened(left_out) if left_out else []
    return residual, jacobian, (scaled for one in left_out for scaled in whitened([one]))


def _contradicted_priors(system: WhitenedProblem, point: LinearisationPoint) -> Bools:
    """Return which priors of parameters each trial contradicts, (trials, number of priors)."""
    names, pulled = system.problem.names, [np.zeros((len(point.x), 0), dtype=bool)]
    for prior in system.problem.priors:
        away = np.abs(point.x[:, [names.index(name) for name in prior.names]] - prior.mean)
        pulled.append(away > _PULLED * np.sqrt(np.diagonal(prior.covariance)))
    return np.concatenate(pulled, axis=-1)


def _spanned_at_statements(
    system: WhitenedProblem, point: LinearisationPoint
) -> frozenset[tuple[str, ...]]:
    """Return the candidates that duplicate estimated parameters, if the fit contradicts priors.

    A misfit pulls nuisances far from their priors. At such values the derivatives differ from row
    to row, so a column that lies in the span of the others, such as a scale common to all rows,
    seems to lie outside it. When evaluated at the prior means, the column does lie in the span.
    """
    pulled = _contradicted_priors(system, point)[0]
    if not pulled.any():
        return frozenset()
    x, priors = point.x.copy(), system.problem.priors
    at = [system.problem.names.index(name) for prior in priors for name in prior.names]
    means = np.concatenate([np.broadcast_to(p.mean, len(p.names)) for p in priors])
    x[0, np.array(at)[pulled]] = means[pulled]
    _, jacobian, found = _whitened_candidates(system, system.point(x, *system.evaluate(x)))
    return spanned_candidates(jacobian[0], found)


class LinearisedRows:
    """Trials with explicit Jacobians, in the form that `gauss_newton_steps.search` needs."""

    def __init__(self, system: WhitenedProblem, loss: Cauchy | None = None):
        self._system, self._loss = system, loss
        self.problem, self.trials, self.m = system.problem, system.trials, system.m
        self.first = system.first
        self.reweighted = loss is not None or not system.constant_noise
        self._whitener = system.first_whitener
        self._active = np.ones(self.trials, dtype=bool)
        self._linearised = system.first.residual, system.first.rows  # until a point is tried

    def cost(self, point: LinearisationPoint) -> Array:
        """Return the cost of trial points; see `gauss_newton_steps.Trials`."""
        with np.errstate(over="ignore", invalid="ignore"):
            u = point.whitened
            u = u**2 if self._loss is None else self._loss.cost(u)
            return np.sum(u, axis=-1) + np.sum(point.prior**2, axis=-1)

    def step(
        self, point: LinearisationPoint, damping: Array, active: Bools
    ) -> tuple[Array, Array, Bools]:
        """Return the moves; see `gauss_newton_steps.Trials`."""
        some = slice(None) if active.all() else np.flatnonzero(active)
        rows, weight = (a if len(a) == 1 else a[some] for a in (point.rows, point.weight))
        u = point.whitened[some]
        if self._loss is not None:
            root = np.sqrt(self._loss.weight(u))
            weight, u = root * weight, root * u
        step = gauss_newton_steps.solve(
            rows, weight, u, self._system.prior_rows, point.prior[some], damping[some]
        )
        return gauss_newton_steps.moves(step, self._system.basis, point.x, some)

    def tried(
        self, x: Array, point: LinearisationPoint, active: Bools
    ) -> tuple[LinearisationPoint, Array]:
        """Return a trial point and its cost; see `gauss_newton_steps.Trials`."""
        self._linearised = self._system.evaluate(x)
        tried = self._system.point(x, *self._linearised, self._whitener)
        self._active = active
        return tried, self.cost(tried)

    def with_values(self, point: LinearisationPoint, x: Array, chosen: Bools) -> LinearisationPoint:
        """Return the point with some values replaced; see `gauss_newton_steps.Trials`."""
        return point._replace(x=np.where(chosen[:, None], x, point.x))

    def accepted(
        self, tried: LinearisationPoint, point: LinearisationPoint, chosen: Bools
    ) -> LinearisationPoint:
        """Return the merged point; see `gauss_newton_steps.Trials`."""
        system, x, chosen = self._system, tried.x, chosen & self._active
        x = x if chosen.all() else np.where(chosen[:, None], x, point.x)
        # If every trial stays at its point, keep the weights too: a model beyond its fold is slow.
        if not system.constant_noise and chosen.any():
            self._whitener = system.whitener(x)
            tried = system.point(x, *self._linearised, self._whitener)
        return tried if chosen.all() else LinearisationPoint(*merge(chosen, tried, point))


def _robust_covariance(
    system: WhitenedProblem, point: LinearisationPoint, loss: Cauchy
) -> tuple[Array, Bools]:
    """Return the asymptotic M-estimator covariance (trials, k, k), and whether it exists.

    The covariance is K² H⁻¹ M H⁻¹, where N is AᵀA of the observations, P is AᵀA of the priors, H =
    mean(ψ′) N + P, M = Σψ²/ν N + P and K = 1 + (k/m) var(ψ′)/mean(ψ′)². Without priors this is the
    first form in Huber 1981, Robust Statistics, section 7.6. Priors are Gaussian, so P enters H and
    M without a factor.
    """
    u, weight = point.whitened, point.weight
    slope = loss.slope(u)
    mean = np.mean(slope, axis=-1)
    pull = np.sum((loss.weight(u) * u) ** 2, axis=-1) / max(system.dof, 1)
    # With more outliers than good observations there is no curvature, and the formula fails.
    usable = mean > 0.05
    mean = np.where(usable, mean, 1.0)
    inverse, ok = gauss_newton_steps.covariance(
        point.rows, np.sqrt(mean)[:, None] * weight, system.prior_rows
    )
    rows = weight[..., None] * point.rows
    normal = rows.mT @ rows
    meat = pull[:, None, None] * normal + system.prior_rows.T @ system.prior_rows
    k = 1 + system.free / system.m * np.var(slope, axis=-1) / mean**2
    return k[:, None, None] ** 2 * (inverse @ meat @ inverse), ok & usable
