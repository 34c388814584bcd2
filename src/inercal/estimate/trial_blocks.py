"""Least squares of many trials, in blocks, so that memory does not grow with their number."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from inercal.estimate.gauss_newton_steps import QR_MAX_TRIALS
from inercal.estimate.least_squares import LinearisedRows, estimate_at_solution
from inercal.estimate.nullspace import Observability, observability
from inercal.estimate.packed_trials import PackedTrials
from inercal.estimate.problem import Problem
from inercal.estimate.result import Estimate
from inercal.estimate.search import search
from inercal.estimate.whitened_problem import WhitenedProblem

# No power of two: arrays of equal places modulo the size of a cache way would displace one another.
BLOCK_TRIALS = 1000
_RESULTS = ("value", "covariance", "chi2", "residual", "whitened", "converged", "iterations")


def least_squares_of_trials(
    trials: int, problem_of: Callable[[slice], Problem], max_iterations: int = 200
) -> Estimate:
    """Solve the problem of each trial.

    Parameters
    ----------
    trials : int
        One or more.
    problem_of : callable
        From a slice to the problem of these trials, with their axis. All problems differ in numbers
        alone, and the first trial decides which directions count as observable, as in
        `least_squares`.
    max_iterations : int, optional
        Steps tried at most.

    Raises
    ------
    InputError, NotObserved
        As `least_squares`.
    """
    first, *others = _blocks(trials)
    one = WhitenedProblem(problem_of(slice(0, 1)))
    structure = observability(one, one.first)
    solved = _solve_block(problem_of(first), first, structure, max_iterations)
    if solved.converged[0]:
        # An accident at the solution, such as a parameter of zero, may hide what the start shows.
        x = solved.value[:1]
        at_solution = observability(one, one.point(x, *one.evaluate(x)))
        structure = min(structure, at_solution, key=lambda s: s.rank)
    solved = replace(solved, **structure._asdict())
    if not others:
        return solved
    whole = _with_room(solved, trials)
    _copy_results(solved, whole, first)
    del solved  # a block at a time is in memory
    for part in others:
        _copy_results(_solve_block(problem_of(part), part, structure, max_iterations), whole, part)
    return whole


def _solve_block(
    problem: Problem, part: slice, structure: Observability, max_iterations: int
) -> Estimate:
    trials = part.stop - part.start
    if problem.normal_equations is not None and trials > QR_MAX_TRIALS:
        packed = PackedTrials(problem, trials)
        point, converged, iterations = search(packed, max_iterations)
        return packed.estimate(point, structure, converged, iterations)
    system = WhitenedProblem(problem)
    at, converged, iterations = search(LinearisedRows(system), max_iterations)
    return estimate_at_solution(system, at, structure, converged, iterations)


def _copy_results(solved: Estimate, whole: Estimate, part: slice) -> None:
    for name in _RESULTS:
        getattr(whole, name)[part] = getattr(solved, name)


def _with_room(solved: Estimate, trials: int) -> Estimate:
    """Return the estimate with arrays for the results of all trials."""
    arrays: dict[str, Any] = {}
    for name in _RESULTS:
        own = getattr(solved, name)
        arrays[name] = np.empty((trials, *own.shape[1:]), own.dtype)
    return replace(solved, **arrays)


def _blocks(trials: int) -> list[slice]:
    """Return slices of nearly equal lengths: a short rest would be solved another way."""
    count = -(-trials // BLOCK_TRIALS)
    ends = [trials * k // count for k in range(count + 1)]
    return [slice(a, b) for a, b in pairwise(ends)]
