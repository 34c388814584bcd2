"""Least squares of observations of one recording, or of many trials block by block."""

from collections.abc import Callable, Sequence

import numpy as np

from inercal.estimate import Estimate, Gaussian, Problem, least_squares, least_squares_of_trials
from inercal.recording import Observations


def solve(
    observations: Observations,
    priors: Sequence[Gaussian],
    problem: Callable[[Observations, Sequence[Gaussian]], Problem],
) -> Estimate:
    """Return the estimate, (..., p).

    Parameters
    ----------
    observations : Observations
        Without an axis of trials, or with one.
    priors : sequence of Gaussian
    problem : callable
        From observations and priors of some trials to their problem.
    """
    lead = np.broadcast_shapes(observations.trial_shape, *(one.mean.shape[:-1] for one in priors))
    if len(lead) != 1:
        return least_squares(problem(observations, priors))
    return least_squares_of_trials(
        lead[0],
        lambda part: problem(
            observations.of_trials(part), [prior.of_trials(part) for prior in priors]
        ),
    )
