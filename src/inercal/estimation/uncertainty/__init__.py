"""Uncertainty of means, of functions and of procedures.

Of functions: propagation to first order, C_y = J C_x Jᵀ (GUM 5.2.2, equation 13; S2, 6.2).

Of procedures: propagation of distributions by Monte Carlo (GUM Supplement 1), and consistency over
trials. Trials are drawn in batches, each with a random stream of its own that is spawned from one
seed: a batch does not depend on how many others there are, and they may be drawn in any order.

Of means (type A) whose samples are not independent: samples are cut into a batches of equal length,
and the scatter of the batch means is used instead of the scatter of the samples (non-overlapping
batch means; Flegal and Jones 2010, Annals of Statistics 38, 1034–1070, equation 4; for independent
samples it is GUM 4.2.3)::

    Ω = Σ bⱼ (ȳⱼ − ȳ)(ȳⱼ − ȳ)ᵀ / (a − 1),   cov ȳ = Ω / n,   a − 1 degrees of freedom

It is unbiased when a batch is long compared with the correlation time of the noise. Few, long
batches cost little: beyond some 10 to 30 the interval hardly gets shorter (Schmeiser 1982,
Operations Research 30, 556–568), so their number is fixed and their length grows with the data.
Sections of the same noise pool their scatter: a fit that is weighted by a covariance of ν degrees
of freedom in m channels has its χ² enlarged by about ν / (ν − m − 1), so ν should be many times m.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
from numpy.random import Generator, SeedSequence

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.parallel import Executor, SerialExecutor, in_order

BATCH = 500
Run = Callable[[Generator, int], Mapping[str, Array]]
BATCHES = 20


def propagate(
    function: Callable[[Array], Array], x: Array, covariance: Array
) -> tuple[Array, Array]:
    """Return y = f(x) and its covariance.

    Parameters
    ----------
    function : callable
        (..., p) to (..., q).
    x : (..., p) array
        Values.
    covariance : (..., p, p) array
        Their covariance.

    Returns
    -------
    value : (..., q) array
        f(x).
    covariance : (..., q, q) array
        To first order.
    """
    value, j = value_and_jacobian(function, x, covariance)
    return value, j @ covariance @ np.swapaxes(j, -1, -2)


def value_and_jacobian(
    function: Callable[[Array], Array], x: Array, covariance: Array
) -> tuple[Array, Array]:
    """Return y = f(x), (..., q), and ∂f/∂x over the range of x, (..., q, p); as for `propagate`."""
    sd = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    return function(x), jacobian(function, x, 0.1 * sd)


def jacobian(function: Callable[[Array], Array], x: Array, step: Array) -> Array:
    """Return ∂f/∂x by central differences of fourth order, (..., q, p).

    Parameters
    ----------
    function : callable
        (..., p) to (..., q).
    x : (..., p) array
        Where.
    step : (..., p) or (p,) array
        Size of the steps: a part of the range over which f matters. A step that rounding of x
        would swallow is enlarged.
    """
    # Rounding costs ε f / h and curvature h⁴ f⁗ / 30: at h = 1e-4 x both are below 1e-11.
    step = np.broadcast_to(np.maximum(step, 1e-4 * np.abs(x)), x.shape)
    # Where the value and its uncertainty are both zero, any step will do: the column is not used.
    step = np.where(step > 0, step, 1e-4)
    columns: list[Array] = []
    for i in range(x.shape[-1]):
        h = np.zeros_like(step)
        h[..., i] = step[..., i]
        near = function(x + h) - function(x - h)
        far = function(x + 2 * h) - function(x - 2 * h)
        columns.append((8 * near - far) / (12 * step[..., i, None]))
    return np.stack(columns, axis=-1)


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


def pooled_mean_covariances(
    sections: Iterable[Array], batches: int = BATCHES
) -> tuple[list[Array], float]:
    """Return the covariance of the mean of each of several sections of the same noise.

    The sections share one Ω, estimated from all of them; the covariance of each mean is Ω / n.

    Parameters
    ----------
    sections : iterable of (..., n, m) arrays
        Sections of n samples of m channels, of any lengths at one sampling rate; their means may
        differ, their noise may not. They are read once, one after another.
    batches : int
        Batches per section. Of many sections, few and long batches are enough: 4 of each of 40
        give as many degrees of freedom as 20 of each of 6, and allow noise of a longer correlation.

    Returns
    -------
    covariances : list of (..., m, m) arrays
        One for each section.
    dof : float
        Degrees of freedom behind all of them.

    Raises
    ------
    InputError
        Too few samples for a covariance of m channels.
    """
    total, dof, m = np.zeros(()), 0, 0
    counts: list[int] = []
    for section in sections:
        n, m = section.shape[-2:]
        counts.append(n)
        number = min(max(batches, 2), n)
        edges = np.arange(number) * n // number
        length = np.diff(edges, append=n)
        means = np.add.reduceat(section, edges, axis=-2) / length[:, None]
        off = (means - np.mean(section, axis=-2, keepdims=True)) * np.sqrt(length)[:, None]
        total = total + np.swapaxes(off, -1, -2) @ off
        dof += number - 1
    if dof < max(m, 1):
        raise InputError(
            f"{sum(counts)} samples in {len(counts)} sections give {dof} degrees of freedom, fewer "
            f"than the {m} that the covariance of {m} channels needs; record longer sections"
        )
    return [total / (dof * n) for n in counts], float(dof)
