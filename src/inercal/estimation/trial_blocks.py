"""Least squares for many trials, in blocks, so that memory does not grow with their number.

If a problem computes normal equations directly, its trials are solved from these without Jacobians.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Bools, Indices
from inercal.basics.errors import InputError
from inercal.estimation import gauss_newton_steps, whitened_problem
from inercal.estimation.fitting import LinearisedRows, estimate_at_solution
from inercal.estimation.gauss_newton_steps import merge, search
from inercal.estimation.nullspace import Observability, observability
from inercal.estimation.problem import NormalEquations, Problem
from inercal.estimation.result import OF_TRIALS, Estimate

# Not a power of two: arrays whose addresses are equal modulo the cache-way size would evict one
# another.
BLOCK_TRIALS = 2000
_COMPARED = 16  # number of trials in which fits from two starts are compared
_LEAST_BLOCK = 100  # trials
_BLOCK_BYTES = 20e6  # of covariances and Jacobians; many parameters mean small blocks


def least_squares_of_trials(
    trials: int,
    problem_of: Callable[[slice], Problem],
    *,
    refined: Callable[[slice, Estimate], Problem | None] | None = None,
) -> Estimate:
    """Solve the problem for each trial, block by block.

    Parameters
    ----------
    trials : int
        Number of trials, 1 or more.
    problem_of : callable
        Function from a slice to the problem of these trials, with a trials dimension. The problems
        differ only in numbers, and the first trial decides which directions count as observable, as
        in `least_squares`.
    refined : callable, optional
        Function from a slice and the estimate of these trials to the next problem to solve, for
        example with different noise. Its search starts at that estimate. None leaves the estimate
        unchanged.

    Raises
    ------
    InputError, NotObserved
        See `least_squares`.
    """
    single = slice(0, 1)
    one = whitened_problem.WhitenedProblem(problem_of(single))
    first, *others = _blocks(trials, one)
    stages = [_Stage(bool(others)) for _ in range(2)]

    def solve(part: slice) -> Estimate:
        solved, next_problem = stages[0].solve(part, problem_of(part), lambda: one), refined
        if next_problem is None or (then := next_problem(part, solved)) is None:
            return solved
        begun = replace(then, start=solved.value)

        def next_one() -> whitened_problem.WhitenedProblem:
            own = None if part == single else next_problem(single, _selected(solved, single))
            return whitened_problem.WhitenedProblem(own or begun)

        return stages[1].solve(part, begun, next_one)

    solved = solve(first)
    if not others:
        return solved
    whole = _with_room(solved, trials)
    _copy_results(solved, whole, first)
    del solved  # only one block at a time is in memory
    for part in others:
        _copy_results(solve(part), whole, part)
    return whole


class _Stage:
    """A block-by-block solver for problems that share the structure of the first trial."""

    def __init__(self, several: bool):
        self._several = several
        self._structure: Observability | None = None
        self._start: Array | None = None

    def solve(
        self, part: slice, problem: Problem, first: Callable[[], whitened_problem.WhitenedProblem]
    ) -> Estimate:
        """Return the estimate for some trials; `first` is only called by the first block."""
        if self._structure is not None:
            return self._solve_from_others(part, problem, self._structure)
        one = first()
        structure = observability(one, one.first)
        solved = _solve_block(problem, part, structure)
        if solved.converged[0]:
            # A coincidence at the solution, such as a parameter that is zero, may hide a direction
            # that the start shows.
            x = solved.value[:1]
            at_solution = observability(one, one.point(x, *one.evaluate(x)))
            structure = min(structure, at_solution, key=lambda s: s.rank)
        self._structure = structure
        if self._several:
            self._start = _common_start(problem, solved)
        return replace(solved, **structure._asdict())

    def _solve_from_others(
        self, part: slice, problem: Problem, structure: Observability
    ) -> Estimate:
        """Return the estimate from a search that starts at other trials' mean, if it succeeds."""
        if self._start is not None:
            with suppress(InputError):  # if the model cannot be evaluated there in some trial
                solved = _solve_block(replace(problem, start=self._start), part, structure)
                if solved.converged.all():
                    return solved
        return _solve_block(problem, part, structure)


def _common_start(problem: Problem, solved: Estimate) -> Array | None:
    """Return the mean solution if it fits some trials better than the common start.

    Many sensors of one type, or one sensor with different noise in each trial, are closer to one
    another than to a perfect sensor. The result is None if each trial has its own start.
    """
    if problem.normal_equations is None or problem.start.ndim > 1 or not solved.converged.all():
        return None
    mean = solved.value.mean(axis=0)
    some = np.arange(min(len(solved.value), _COMPARED))

    def cost(x: Array) -> Array:
        assert problem.normal_equations is not None
        found = problem.normal_equations(np.tile(x, (some.size, 1)), some)
        with np.errstate(over="ignore"):
            return np.sum(found.whitened**2, axis=-1)

    return mean if np.all(cost(mean) < cost(problem.start)) else None


def _solve_block(problem: Problem, part: slice, structure: Observability) -> Estimate:
    trials = part.stop - part.start
    if problem.normal_equations is not None and trials > gauss_newton_steps.QR_MAX_TRIALS:
        packed = PackedTrials(problem, trials)
        point, converged, iterations = search(packed)
        return packed.estimate(point, structure, converged, iterations)
    system = whitened_problem.WhitenedProblem(problem)
    at, converged, iterations = search(LinearisedRows(system))
    return estimate_at_solution(system, at, structure, converged, iterations)


def _selected(solved: Estimate, part: slice) -> Estimate:
    return replace(solved, **{name: getattr(solved, name)[part] for name in OF_TRIALS})


def _copy_results(solved: Estimate, whole: Estimate, part: slice) -> None:
    for name in OF_TRIALS:
        getattr(whole, name)[part] = getattr(solved, name)


def _with_room(solved: Estimate, trials: int) -> Estimate:
    """Return the estimate with arrays large enough for the results of all trials."""
    own = {name: getattr(solved, name) for name in OF_TRIALS}
    return replace(solved, **{n: np.empty((trials, *a.shape[1:]), a.dtype) for n, a in own.items()})


def _blocks(trials: int, one: whitened_problem.WhitenedProblem) -> list[slice]:
    """Return slices of nearly equal lengths, because a short last block would use another solver.

    The first block is shorter, because the others start at its solutions.
    """
    p = len(one.problem.names)
    most = min(BLOCK_TRIALS, max(_LEAST_BLOCK, int(_BLOCK_BYTES / (8 * p * (p + one.m)))))
    if trials <= most:
        return [slice(0, trials)]
    first = most // 5
    count = -(-(trials - first) // most)
    ends = [0, *(first + (trials - first) * k // count for k in range(count + 1))]
    return [slice(a, b) for a, b in pairwise(ends)]


class PackedPoint(NamedTuple):
    """Normal equations at x, in free coordinates; all arrays have a trials dimension."""

    x: Array  # (trials, p)
    residual: Array  # y − h(x), (trials, m)
    weight: Array  # as in `NormalEquations`, (trials, m)
    whitened: Array  # u, (trials, m)
    normal: Array  # lower triangle of AᵀA, (trials, k (k + 1)/2)
    gradient: Array  # Aᵀu, (trials, k)
    prior: Array  # whitened μ − x, (trials, b)


class PackedTrials:
    """The trials of a problem in the form that `inercal.estimation.gauss_newton_steps` needs.

    Parameters
    ----------
    problem : Problem
        A problem with `normal_equations`.
    trials : int

    Raises
    ------
    InputError
        At the start, a residual is not finite or a noise is not positive.
    """

    def __init__(self, problem: Problem, trials: int):
        assert problem.normal_equations is not None
        self.problem, self.trials, self._of = problem, trials, problem.normal_equations
        self.reweighted: bool = callable(problem.noise)
        self.basis, start = whitened_problem.gauge_basis(problem)
        self._prior_full, self._prior_rows, targets = whitened_problem.prior_equations(
            problem, self.basis
        )
        self._target = whitened_problem.prior_targets(targets, trials)
        self.first = self._point(
            np.broadcast_to(start, (trials, start.shape[-1])), np.arange(trials)
        )
        self.m = self.first.residual.shape[-1]
        whitened_problem.require_finite(self.first.residual)
        positive = np.isfinite(self.first.weight).all(axis=0)
        if not positive.all():
            raise whitened_problem.noise_error(problem, int(np.flatnonzero(~positive)[0]))

    def _point(self, x: Array, which: Indices) -> PackedPoint:
        """Return the point for the trials with these indices, at their own x."""
        found = self._of(x, which)
        if self.basis is not None:
            found = _in_free_coordinates(found, self.basis)
        return PackedPoint(x, *found, self._target[which] - x @ self._prior_full.T)

    def cost(self, point: PackedPoint) -> Array:
        """Return the cost at a point; see `gauss_newton_steps.Trials`."""
        return _squares(point.whitened) + _squares(point.prior)

    def step(self, point: PackedPoint, damping: Array, active: Bools) -> tuple[Array, Array, Bools]:
        """Return the moves; see `gauss_newton_steps.Trials`."""
        some = slice(None) if active.all() else np.flatnonzero(active)
        normal, gradient, prior = point.normal[some], point.gradient[some], point.prior[some]
        step = gauss_newton_steps.solve_packed(
            normal, gradient, self._prior_rows, prior, damping[some]
        )
        return gauss_newton_steps.moves(step, self.basis, point.x, some)

    def tried(self, x: Array, point: PackedPoint, active: Bools) -> tuple[PackedPoint, Array]:
        """Return a trial point and its cost; see `gauss_newton_steps.Trials`."""
        which = np.flatnonzero(active)
        tried = self._point(x[which], which)
        if len(which) < len(active):
            whole = PackedPoint(*(a.copy() for a in point))
            for a, b in zip(whole, tried, strict=True):
                a[which] = b
            tried = whole
        if not self.reweighted:
            return tried, self.cost(tried)
        return tried, _squares(point.weight * tried.residual) + _squares(tried.prior)

    def with_values(self, point: PackedPoint, x: Array, chosen: Bools) -> PackedPoint:
        """Return the point with some values replaced; see `gauss_newton_steps.Trials`."""
        return point._replace(x=np.where(chosen[:, None], x, point.x))

    def accepted(self, tried: PackedPoint, point: PackedPoint, chosen: Bools) -> PackedPoint:
        """Return the merged point; see `gauss_newton_steps.Trials`."""
        return tried if chosen.all() else PackedPoint(*merge(chosen, tried, point))

    def estimate(
        self, point: PackedPoint, structure: Observability, converged: Bools, iterations: Indices
    ) -> Estimate:
        """Return the estimate at a solution."""
        covariance, exists = gauss_newton_steps.covariance_packed(point.normal, self._prior_rows)
        if self.basis is not None:
            covariance = self.basis @ covariance @ self.basis.T
        return Estimate(
            names=self.problem.names,
            value=point.x,
            covariance=covariance,
            chi2=self.cost(point),
            dof=self.m + len(self._prior_rows) - self._prior_rows.shape[1],
            residual=point.residual,
            whitened=point.whitened,
            observations=self.problem.observations,
            wanted=self.problem.wanted,
            **structure._asdict(),
            converged=converged & exists,
            iterations=iterations,
        )


def _squares(u: Array) -> Array:
    with np.errstate(over="ignore", invalid="ignore"):
        return np.einsum("ij,ij->i", u, u)


def _in_free_coordinates(found: NormalEquations, basis: Array) -> NormalEquations:
    """Transform the normal equations to the free coordinates t, where x = x₀ + B t."""
    (p, k), (trials, _) = basis.shape, found.normal.shape
    whole = np.zeros((trials, p, p))
    rows, columns = np.tril_indices(p)
    whole[:, rows, columns] = whole[:, columns, rows] = found.normal
    rows, columns = np.tril_indices(k)
    return found._replace(
        normal=(basis.T @ whole @ basis)[:, rows, columns], gradient=found.gradient @ basis
    )
