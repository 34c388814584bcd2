"""Least squares of many trials, in blocks, so that memory does not grow with their number."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from inercal.estimate.least_squares import estimate_at_solution, least_squares, search
from inercal.estimate.nullspace import Observability
from inercal.estimate.problem import Problem
from inercal.estimate.result import Estimate
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
    solved = least_squares(problem_of(first), max_iterations=max_iterations)
    if not others:
        return solved
    structure = Observability(
        solved.rank, solved.singular_values, solved.null_directions, solved.weakest
    )
    whole = _with_room(solved, trials)
    _copy_results(solved, whole, first)
    del solved  # a block at a time is in memory
    for part in others:
        _copy_results(_solve_block(problem_of(part), structure, max_iterations), whole, part)
    return whole


def _solve_block(problem: Problem, structure: Observability, max_iterations: int) -> Estimate:
    system = WhitenedProblem(problem)
    point, converged, iterations = search(system, None, max_iterations)
    return estimate_at_solution(system, point, structure, converged, iterations)


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
