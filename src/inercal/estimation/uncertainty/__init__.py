"""Compute the uncertainty of means, functions and procedures.

Functions: first-order propagation, C_y = J C_x Jᵀ (GUM 5.2.2, equation 13; S2, 6.2).

Procedures: propagation of distributions by Monte Carlo (GUM Supplement 1), and consistency over
trials. Trials are drawn in batches. Each batch has its own random stream, spawned from one seed, so
a batch does not depend on the number of other batches, and the batches may be drawn in any order.

Means (type A) of samples that are not independent: the samples are divided into a batches of equal
length, and the scatter of the batch means is used instead of the scatter of the samples
(non-overlapping batch means; Flegal and Jones 2010, Annals of Statistics 38, 1034–1070, equation 4;
for independent samples it is GUM 4.2.3)::

    Ω = Σ bⱼ (ȳⱼ − ȳ)(ȳⱼ − ȳ)ᵀ / (a − 1),   cov ȳ = Ω / n,   a − 1 degrees of freedom

The estimate is unbiased if a batch is long compared with the correlation time of the noise. A few
long batches are enough: beyond about 10 to 30 batches the interval hardly gets shorter (Schmeiser
1982, Operations Research 30, 556–568), so their number is fixed and their length grows with the
data. The scatter of sections with the same noise is pooled. If a fit is weighted by a covariance
with ν degrees of freedom in m channels, its χ² is enlarged by about ν / (ν − m − 1), so ν should be
many times m.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.parallel import Executor, SerialExecutor, in_order

COVERAGE = 2.0
"""The coverage factor k in U = k u; it gives about 95 % for usual degrees of freedom (GUM 6.3)."""
COVERAGE_PROBABILITY = 0.9545
"""Coverage of ± 2u for a normal distribution; it is also used for other distributions."""


BATCH = 500
Run = Callable[["np.random.Generator", int], Mapping[str, Array]]
BATCHES = 20


def propagate(
    function: Callable[[Array], Array], x: Array, covariance: Array
) -> tuple[Array, Array]:
    """Return y = f(x) and its covariance, to first order.

    Parameters
    ----------
    function : callable
        Function f from (..., p) to (..., q).
    x : (..., p) array
        Values.
    covariance : (..., p, p) array
        Their covariance.

    Returns
    -------
    value : (..., q) array
        f(x).
    covariance : (..., q, q) array
        Covariance of f(x), to first order.
    """
    value, j = value_and_jacobian(function, x, covariance)
    return value, j @ covariance @ j.mT


def value_and_jacobian(
    function: Callable[[Array], Array], x: Array, covariance: Array
) -> tuple[Array, Array]:
    """Return y = f(x), (..., q), and ∂f/∂x over the range of x, (..., q, p); see `propagate`."""
    sd = np.sqrt(np.linalg.diagonal(covariance))
    return function(x), jacobian(function, x, 0.1 * sd)


def jacobian(function: Callable[[Array], Array], x: Array, step: Array) -> Array:
    """Return ∂f/∂x, (..., q, p), from fourth-order central differences.

    Parameters
    ----------
    function : callable
        Function f from (..., p) to (..., q).
    x : (..., p) array
        Point at which to differentiate.
    step : (..., p) or (p,) array
        Step size: a fraction of the range over which f matters. A step that would be lost in the
        rounding of x is enlarged.
    """
    # Rounding adds an error of ε f / h and curvature h⁴ f⁗ / 30; at h = 1e-4 x both are below
    # 1e-11.
    step = np.broadcast_to(np.maximum(step, 1e-4 * np.abs(x)), x.shape)
    # If the value and its uncertainty are both zero, any step works, because the column is not
    # used.
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
    """Return the results of `run` for all trials.

    Parameters
    ----------
    run : callable or several
        Function of a random generator and a number of trials n that returns arrays (n, ...) by
        name. Several functions get generators with equal draws; each batch of each function is a
        separate task.
    trials : int
        Total number of trials.
    seed : int
        Seed of all random streams. Equal seeds and equal batches give equal results.
    batch : int, optional
        Number of trials drawn at once: enough to share the cost of a call, few enough for the
        cache.
    progress : callable, optional
        Called with the number of finished trials and the total number whenever more are finished.
    executor : Executor, optional
        Executor that draws the batches; by default this process. The results do not depend on it.

    Returns
    -------
    dict of str to (trials, ...) arrays
        Results under the names that `run` uses.
    """
    runs = (run,) if callable(run) else run
    executor = executor or SerialExecutor()
    firsts = range(0, trials, batch)
    streams = np.random.SeedSequence(seed).spawn(len(firsts))
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


def _draw_batch(run: Run, stream: "np.random.SeedSequence", count: int) -> Mapping[str, Array]:
    return run(np.random.default_rng(stream), count)


def nees(error: Array, covariance: Array) -> Array:
    """Return the normalised estimation error squared, eᵀ C⁻¹ e, for each trial.

    The mean of the result is p if C is the covariance of e (Bar-Shalom, Li and Kirubarajan 2001,
    Estimation with Applications to Tracking and Navigation, 5.4.2).

    Parameters
    ----------
    error : (trials, p) array
        Estimate minus true value.
    covariance : (trials, p, p) or (p, p) array
        Stated covariance of the error.

    Returns
    -------
    (trials,) array
    """
    return np.sum(error * np.linalg.solve(covariance, error[..., None])[..., 0], axis=-1)


def pooled_mean_covariances(
    sections: Iterable[Array], batches: int = BATCHES
) -> tuple[list[Array], float]:
    """Return the covariances of the means of several sections that have the same noise.

    The sections share one Ω, estimated from all of them; the covariance of each mean is Ω / n.

    Parameters
    ----------
    sections : iterable of (..., n, m) arrays
        Sections of n samples in m channels, with any lengths but a common sampling rate. Their
        means may differ, but their noise must be the same. They are read once, one after another.
    batches : int
        Number of batches per section. With many sections, a few long batches are enough: 4 batches
        in each of 40 sections give about as many degrees of freedom as 20 batches in each of 6, and
        they allow noise with a longer correlation time.

    Returns
    -------
    covariances : list of (..., m, m) arrays
        One covariance for each section.
    dof : float
        Degrees of freedom that all these covariances share.

    Raises
    ------
    InputError
        There are too few samples for a covariance of m channels.
    """
    total, dof, m = np.zeros(()), 0, 0
    counts: list[int] = []
    for section in sections:
        n, m = section.shape[-2:]
        counts.append(n)
        number = min(max(batches, 2), n)
        edges = np.arange(number + 1) * n // number
        length = edges[1:] - edges[:-1]
        means = np.add.reduceat(section, edges[:-1], axis=-2) / length[:, None]
        off = (means - np.mean(section, axis=-2, keepdims=True)) * np.sqrt(length)[:, None]
        total = total + off.mT @ off
        dof += number - 1
    if dof < max(m, 1):
        raise InputError(
            f"{sum(counts)} samples in {len(counts)} sections give {dof} degrees of freedom, fewer "
            f"than the {m} that the covariance of {m} channels needs; record longer sections"
        )
    return [total / (dof * n) for n in counts], float(dof)
