"""Estimate the same coefficients with other methods, to compare them with the likelihood.

- `slopes`: the coefficients are read off the Allan plot from straight lines. B is too large by a
  factor of √(1 + 2NK/(√3·0.4413 B²)), and N at 1 s is too large by √(1 + 0.4413 B²/N² + K²/3N²).
- `wls_log`: least squares of ln σ with weights edf/2, as if averaging times were independent. In
  fact, neighbouring octaves have correlations of 0.5 to 0.9, so the stated u is only 0.58 to 0.75
  of the true value.
- `gmwm`: generalised least squares of the Allan variances with their exact covariance, iterated
  (Guerrier et al. 2013). This method is as efficient as the likelihood.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.noise.deviations import Deviations
from inercal.noise.numerics import nonnegative_least_squares, pseudo_inverse
from inercal.noise.output_filter import OutputFilter, filtered_avar, filtered_model_avar
from inercal.noise.terms import FLICKER_FLOOR, TERMS

_ROUNDS = 12
Estimates = dict[str, tuple[float, float]]


def _columns(
    symbols: Sequence[str],
    tau: Array,
    dt: float,
    markov_time: float,
    output: OutputFilter | None = None,
) -> Array:
    return np.stack([filtered_avar(one, tau, dt, markov_time, output) for one in symbols], 1)


def _nonnegative(columns: Array, target: Array, root: Array) -> Array:
    """Return θ ≥ 0 that minimises the sum of squares of root (columns θ − target)."""
    return nonnegative_least_squares(root @ columns, root @ target)


def _as_estimates(symbols: Sequence[str], theta: Array, covariance: Array) -> Estimates:
    values = np.sqrt(theta)
    sd = np.sqrt(np.diag(covariance))
    return {
        one: (float(v), float(s / (2 * v)) if v > 0 else np.inf)
        for one, v, s in zip(symbols, values, sd, strict=True)
    }


def wls_log(
    oadev: Deviations,
    symbols: Sequence[str],
    dt: float,
    markov_time: float,
    output: OutputFilter | None = None,
) -> Estimates:
    """Estimate coefficients and u by weighted least squares of ln σ; the u is too small.

    Parameters
    ----------
    oadev : Deviations
    symbols : sequence of str
    dt, markov_time : float
        Sampling interval and time constant of the Gauss–Markov process, s.
    output : OutputFilter, optional
        The sensor's own filter.
    """
    measured = oadev.value**2
    if output is not None:
        behind = filtered_model_avar({}, oadev.tau, dt, markov_time, output)
        measured = np.maximum(measured - behind, 1e-2 * measured)
    columns = _columns(symbols, oadev.tau, dt, markov_time, output)
    theta = _nonnegative(columns, measured, np.diag(np.sqrt(oadev.edf / 2) / measured))
    model = np.maximum(columns @ theta, 1e-3 * measured)
    for _ in range(_ROUNDS):
        # Linearise ln σ² around the model: σ² (1 + ln(measured/σ²)).
        target = model * (1 + np.log(measured / model))
        theta = _nonnegative(columns, target, np.diag(np.sqrt(oadev.edf / 2) / model))
        model = np.maximum(columns @ theta, 1e-3 * measured)
    scaled = columns * (np.sqrt(oadev.edf / 2) / model)[:, None]
    return _as_estimates(symbols, theta, pseudo_inverse(scaled.T @ scaled))


def allan_covariance(gamma: Array, factors: Sequence[int], n: int) -> Array:
    """Return the exact covariance of overlapping Allan variances for Gaussian noise, (k, k).

    Parameters
    ----------
    gamma : (n,) array
        Variogram of the block means at lags 0 … n−1; γ(0) = 0.
    factors : sequence of int
        Averaging factors m; all differences are used.
    n : int
        Number of block means.
    """
    size = 1 << int(np.ceil(np.log2(2 * n)))
    covariance = np.concatenate([-gamma, np.full(size - 2 * n + 1, 0.0), -gamma[:0:-1]])
    spectrum = np.fft.rfft(covariance)
    transforms: list[NDArray[np.complex128]] = []
    for m in factors:
        weights = np.zeros(size)
        weights[:m], weights[m : 2 * m] = -1.0, 1.0
        transforms.append(np.fft.rfft(weights) / (m * np.sqrt(2)))
    counts = [n - 2 * m + 1 for m in factors]
    found = np.empty((len(counts), len(counts)))
    lag = np.arange(size)
    lag = np.where(lag >= size // 2, lag - size, lag)
    for p in range(len(counts)):
        for q in range(p, len(counts)):
            c = np.fft.irfft(np.conj(transforms[p]) * transforms[q] * spectrum, size)
            pairs = _pairs(lag, counts[p], counts[q])
            found[p, q] = found[q, p] = 2 * float(pairs @ c**2) / (counts[p] * counts[q])
    return found


def _pairs(lag: Array, first: int, second: int) -> Array:
    """Count the pairs of differences (t, t − lag) for each lag; t < first and t − lag < second."""
    return np.clip(np.minimum(first, second + lag) - np.maximum(0, lag), 0, None).astype(float)


def gmwm(
    oadev: Deviations, symbols: Sequence[str], dt: float, markov_time: float, start: Array, n: int
) -> Estimates:
    """Estimate coefficients and u by iterated least squares with the model's exact covariance.

    Parameters
    ----------
    oadev : Deviations
        Overlapping Allan deviation at octaves, from n block means without gaps.
    symbols : sequence of str
    dt, markov_time : float
        Sampling interval and time constant of the Gauss–Markov process, s.
    start : (p,) array
        Squared coefficients at the start of the iteration.
    n : int
    """
    factors = [round(float(t) / dt) for t in oadev.tau]
    measured = oadev.value**2
    columns = _columns(symbols, oadev.tau, dt, markov_time)
    lags = np.arange(1, n, dtype=np.float64)
    variograms = [TERMS[one].variogram(lags, dt, markov_time) for one in symbols]
    theta = start
    covariance = np.eye(len(symbols))
    for _ in range(3):
        gamma = np.concatenate([[0.0], sum(v * g for v, g in zip(theta, variograms, strict=True))])
        lower = np.linalg.cholesky(allan_covariance(gamma, factors, n))
        root = np.asarray(np.linalg.inv(lower), dtype=np.float64)
        theta = _nonnegative(columns, measured, root)
        scaled = root @ columns
        covariance = pseudo_inverse(scaled.T @ scaled)
    return _as_estimates(symbols, theta, covariance)


def slopes(oadev: Deviations) -> Estimates:
    """Read N, B and K off the Allan plot at slopes −½, 0 and +½, without uncertainties.

    For N and K, a line with slope −½ or +½ is drawn through the point at which the local slope is
    closest to this value.
    """
    log_tau, log_value = np.log(oadev.tau), np.log(oadev.value)
    local = np.diff(log_value) / np.diff(log_tau)
    middle_tau = np.exp((log_tau[1:] + log_tau[:-1]) / 2)
    middle = np.exp((log_value[1:] + log_value[:-1]) / 2)
    least = float(oadev.value.min())
    white, walk = (int(np.argmin(np.abs(local - slope))) for slope in (-0.5, 0.5))
    return {
        "N": (float(middle[white] * np.sqrt(middle_tau[white])), np.inf),
        "B": (least / float(np.sqrt(FLICKER_FLOOR)), np.inf),
        "K": (float(middle[walk] * np.sqrt(3 / middle_tau[walk])), np.inf),
    }
