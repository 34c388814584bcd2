"""Estimate by least squares from one recording, or from many trials block by block."""

from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from contextvars import ContextVar

import numpy as np

from inercal.estimation import Estimate, Gaussian, Problem, least_squares, least_squares_of_trials
from inercal.estimation.fitting import least_squares_each
from inercal.methods import Priors
from inercal.recordings import Observations

_prepared: ContextVar[list[Estimate] | None] = ContextVar("prepared", default=None)
_each: ContextVar[list[Estimate | None] | None] = ContextVar("each", default=None)


class _EachFoundError(Exception):
    """The estimates were found, so the estimator of the trials need not continue."""


@contextmanager
def prepared(estimate: Estimate | None) -> Generator[None]:
    """Let the first call of `solve` in this block return an estimate that `solve_each` found."""
    token = _prepared.set([] if estimate is None else [estimate])
    try:
        yield
    finally:
        _prepared.reset(token)


def solve_each(estimate: Callable[[], Estimate]) -> list[Estimate | None]:
    """Return the estimates of single recordings from an estimator of their trials.

    Parameters
    ----------
    estimate : callable
        Function that calls `solve` with observations of a few trials.

    Returns
    -------
    list of Estimate or None
        See `inercal.estimation.fitting.least_squares_each`; empty if the estimator cannot be used
        for trials.
    """
    found: list[Estimate | None] = []
    token = _each.set(found)
    try:
        with suppress(Exception):  # any: each recording is then solved alone, with its own error
            estimate()
    finally:
        _each.reset(token)
    return found


def solve(
    observations: Observations,
    priors: Priors,
    problem: Callable[[Observations, Priors], Problem],
    refined: Callable[[Observations, Priors, Estimate], Problem | None] | None = None,
) -> Estimate:
    """Return the estimate, (..., p).

    Parameters
    ----------
    observations : Observations
        With or without an axis of trials.
    priors : sequence of Gaussian
    problem : callable
        Maps the observations and priors of some trials to their problem.
    refined : callable, optional
        Maps these and the estimate of the same trials to the next problem to solve, for example
        with corrected readings; None keeps the estimate.
    """

    def of_trials(part: slice) -> tuple[Observations, list[Gaussian]]:
        return observations.of_trials(part), [prior.of_trials(part) for prior in priors]

    if ready := _prepared.get():
        return ready.pop()
    lead = np.broadcast_shapes(observations.trial_shape, *(one.mean.shape[:-1] for one in priors))
    if (each := _each.get()) is not None:
        first_problem = problem(observations, priors)
        first = least_squares(first_problem) if refined else None
        then = refined(observations, priors, first) if refined and first else None
        each += least_squares_each(then or first_problem)
        raise _EachFoundError
    if len(lead) != 1:
        first = least_squares(problem(observations, priors))
        then = refined(observations, priors, first) if refined else None
        return least_squares(then) if then else first
    return least_squares_of_trials(
        lead[0],
        lambda part: problem(*of_trials(part)),
        refined=(lambda part, first: refined(*of_trials(part), first)) if refined else None,
    )
