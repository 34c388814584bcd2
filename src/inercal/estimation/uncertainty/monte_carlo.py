"""Propagation of distributions by Monte Carlo (GUM Supplement 1), and consistency over trials.

Trials are drawn in batches, each with a random stream of its own that is spawned from one seed: a
batch does not depend on how many others there are, and they may be drawn in any order.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.random import Generator, SeedSequence

from inercal.basics.arrays import Array
from inercal.basics.parallel import Executor, SerialExecutor, in_order

BATCH = 500

Run = Callable[[Generator, int], Mapping[str, Array]]


def monte_carlo(
    run: Run | Sequence[Run],
    trials: int,
    seed: int,
    batch: int = BATCH,
    progress: Callable[[int, int], None] | None = None,
    executor: Executor | None = None,
) -> dict[str, Array]:
    """Return what `run` gives for every trial.

    Parameters
    ----------
    run : callable or several
        A generator and a number of trials n, to arrays (n, ...) by name. Several are given
        generators of equal draws; each batch of each is a task of its own.
    trials : int
        How many in all.
    seed : int
        Of all streams. Equal seeds and equal batches give equal results.
    batch : int, optional
        Trials drawn at once: enough to share the cost of a call, few enough for the cache.
    progress : callable, optional
        Called with the number of trials done and of all trials, when more are done.
    executor : Executor, optional
        Where batches are drawn; by default in this process. The results are the same.

    Returns
    -------
    dict of str to (trials, ...) arrays
        By the names that `run` gives.
    """
    runs = (run,) if callable(run) else run
    executor = executor or SerialExecutor()
    firsts = range(0, trials, batch)
    streams = SeedSequence(seed).spawn(len(firsts))
    indices = [
        executor.submit(_draw_batch, one, stream, min(batch, trials - first))
        for first, stream in zip(firsts, streams, strict=True)
        for one in runs
    ]
    parts: dict[str, list[Array]] = {}
    for k, part in enumerate(in_order(executor, indices[0])):
        for name, values in part.items():
            parts.setdefault(name, []).append(values)
        if progress:
            progress(min((k + 1) * batch // len(runs), trials), trials)
    return {name: np.concatenate(values) for name, values in parts.items()}


def _draw_batch(run: Run, stream: SeedSequence, count: int) -> Mapping[str, Array]:
    return run(np.random.default_rng(stream), count)


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
