"""Propagation of distributions by Monte Carlo (GUM Supplement 1), and consistency over trials.

Trials are drawn in batches, each with a random stream of its own that is spawned from one seed: a
batch does not depend on how many others there are, and they may be drawn in any order.
"""

from collections.abc import Callable, Mapping

import numpy as np
from numpy.random import Generator

from inercal.arrays import Array

BATCH = 500


def monte_carlo(
    run: Callable[[Generator, int], Mapping[str, Array]],
    trials: int,
    seed: int,
    batch: int = BATCH,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, Array]:
    """Return what `run` gives for every trial.

    Parameters
    ----------
    run : callable
        A generator and a number of trials n, to arrays (n, ...) by name.
    trials : int
        How many in all.
    seed : int
        Of all streams. Equal seeds and equal batches give equal results.
    batch : int, optional
        Trials drawn at once: enough to share the cost of a call, few enough for the cache.
    progress : callable, optional
        Called after each batch with the number of trials done and of all trials.

    Returns
    -------
    dict of str to (trials, ...) arrays
        By the names that `run` gives.
    """
    firsts = range(0, trials, batch)
    streams = np.random.SeedSequence(seed).spawn(len(firsts))
    parts: list[Mapping[str, Array]] = []
    for first, stream in zip(firsts, streams, strict=True):
        count = min(batch, trials - first)
        parts.append(run(np.random.default_rng(stream), count))
        if progress:
            progress(first + count, trials)
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def nees(error: Array, covariance: Array) -> Array:
    """Return the normalised error squared eᵀ C⁻¹ e of each trial.

    Its mean is p where C is the covariance of e (Bar-Shalom, Li and Kirubarajan 2001, Estimation
    with Applications to Tracking and Navigation, 5.4.2).

    Parameters
    ----------
    error : (trials, p) array
        Estimate − truth.
    covariance : (trials, p, p) or (p, p) array
        As stated.

    Returns
    -------
    (trials,) array
    """
    return np.sum(error * np.linalg.solve(covariance, error[..., None])[..., 0], axis=-1)
