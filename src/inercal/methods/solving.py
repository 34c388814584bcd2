"""Least-squares estimates from one recording, or from many trials block by block."""

from collections.abc import Callable

import numpy as np

from inercal.estimation import Estimate, Gaussian, Problem, least_squares, least_squares_of_trials
from inercal.methods import Priors
from inercal.recordings import Observations


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

    lead = np.broadcast_shapes(observations.trial_shape, *(one.mean.shape[:-1] for one in priors))
    if len(lead) != 1:
        first = least_squares(problem(observations, priors))
        then = refined(observations, priors, first) if refined else None
        return least_squares(then) if then else first
    return least_squares_of_trials(
        lead[0],
        lambda part: problem(*of_trials(part)),
        refined=(lambda part, first: refined(*of_trials(part), first)) if refined else None,
    )
