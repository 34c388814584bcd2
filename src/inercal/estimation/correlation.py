"""Estimate the noise correlation within sections, and each section's variance, from Haar contrasts.

`inercal.estimation.section_statistics` defines the contrasts and their variance at each level.

Sources: Percival and Walden, Wavelet Methods for Time Series Analysis, Cambridge 2000, chapter 8
(Haar variance of a process); Smyth 2004, Statistical Applications in Genetics 3, article 3,
section 6.2 (moderated variances).
"""

# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple, cast

import numpy as np
import scipy

from inercal.basics.arrays import Array, Indices

COARSE_LEVELS = 2  # levels that reveal a change; the finer levels show the noise
SMALLEST_VARIANCE = 1e-6  # fraction of the mean variance; below it a section is constant
_LEVEL = 0.01  # significance level of the likelihood ratio for a correlation
# Significance levels to exclude a long memory, and to exclude all short memories.
_EXCLUDED, _EXCLUDED_SHORT = 0.01, 0.05
_RATIOS = np.concatenate([[0.0], np.geomspace(0.1, 3e3, 28)])  # ρ
_KEPT = 128  # forms of recordings whose ratios are kept
_TIMES = 14  # number of values of τ
_SHORT, _LONG = 1 / 9, 4.0  # in section lengths; the second one looks like a random walk
_LONG_RATIOS = np.geomspace(0.1, 3e6, 50)  # ρ for the long memory
_SURE = 1e9  # degrees of freedom of the prior if sections have equal variances


class Contrasts(NamedTuple):
    """Haar contrasts, slope and sample variance of one section with m channels."""

    seconds: float
    samples: int
    levels: tuple[Array, ...]  # (2^(l − 1), m) each
    slope: Array  # (m,)
    slope_per_trend: float  # value of `slope` for a trend of one per second


@dataclass(frozen=True, eq=False)
class NoiseCorrelation:
    """The Gauss–Markov part of noise: its density relative to the white part, ρ, and τ, s."""

    ratio: float = 0.0
    seconds: float = 1.0

    def contrast_variance_ratio(self, seconds: Array) -> Array:
        """Return the variance ratio, total to white, for contrasts of blocks of h seconds."""
        return _contrast_variance_ratio(np.array(self.ratio), np.array(self.seconds), seconds)

    def mean_variance_ratio(self, seconds: Array) -> Array:
        """Return the variance ratio, total to white, for means over T seconds."""
        x = self.seconds / seconds
        return np.asarray(1 + self.ratio * (1 + x * np.expm1(-1 / x)))

    def batch_variance_ratio(self, seconds: Array, batches: int) -> Array:
        """Return the scatter of batch means over T seconds relative to that of white noise."""
        own, whole = self.mean_variance_ratio(seconds / batches), self.mean_variance_ratio(seconds)
        return np.asarray((own - whole / batches) * batches / (batches - 1))


def _contrast_variance_ratio(ratio: Array, tau: Array, h: Array) -> Array:
    x = tau / h
    a = -np.expm1(-1 / x)
    return np.asarray(1 + ratio * (1 - x * a - 0.5 * x * a**2), dtype=np.float64)


WHITE = NoiseCorrelation()


def block_durations(seconds: float, levels: int) -> Array:
    """Return the block lengths at levels 1, 2, …, (levels,) s."""
    return np.array([seconds / 2**place for place in range(1, levels + 1)])


def contrast_powers(one: Contrasts, size: Array, used: Indices) -> Array:
    """Return the mean square of the contrasts at each level over all channels, (levels,)."""
    squares = np.mean((np.concatenate(one.levels)[:, used] / size[used]) ** 2, axis=1)
    counts = np.array([len(level) for level in one.levels])
    return np.asarray(np.add.reduceat(squares, np.cumsum(counts) - counts) / counts)


class SectionCorrelations(NamedTuple):
    """The noise correlation of r sections.

    Parameters
    ----------
    whole : NoiseCorrelation
        Correlation estimated from all sections.
    others : tuple of r NoiseCorrelation
        For each section, the correlation estimated from all the other sections.
    rise : float
        Twice the gain in log-likelihood over white noise: the smallest gain that remains if any one
        section is left out; 0 without a correlation.
    long : bool
        Whether the correlation time is a large part of a section, and a time much longer than the
        sections cannot be excluded. The drift of the noise between sections is then unknown.
    """

    whole: NoiseCorrelation
    others: tuple[NoiseCorrelation, ...]
    rise: float = 0.0
    long: bool = False


@lru_cache(_KEPT)
def _compared_correlations(longest: float, shortest: float) -> tuple[NoiseCorrelation, ...]:
    """Return white noise, a grid of correlations, and correlations far longer than the sections."""
    times: Array = np.geomspace(shortest / 4, longest / 2, _TIMES, dtype=np.float64)
    grid = [NoiseCorrelation(float(ratio), float(time)) for time in times for ratio in _RATIOS[1:]]
    long = [NoiseCorrelation(float(ratio), _LONG * longest) for ratio in _LONG_RATIOS]
    return (WHITE, *grid, *long)


@lru_cache(_KEPT)
def _contrast_shapes(
    longest: float, shortest: float, seconds: float, levels: int
) -> tuple[Array, Array]:
    """Return the variance ratios of contrasts for all `_compared_correlations`, and their logs."""
    every = _compared_correlations(longest, shortest)
    ratio, tau = (
        np.array(part)[:, None] for part in zip(*((c.ratio, c.seconds) for c in every), strict=True)
    )
    shape = _contrast_variance_ratio(ratio, tau, block_durations(seconds, levels))
    return shape, np.log(shape)


def fit_correlations(powers: Sequence[Array], sections: Sequence[Contrasts]) -> SectionCorrelations:
    """Return the noise correlation of sections, estimated from their `contrast_powers`."""
    longest = max(one.seconds for one in sections)
    shortest = min(one.seconds / 2 ** len(one.levels) for one in sections)
    every = _compared_correlations(longest, shortest)
    choices = len(every) - len(_LONG_RATIOS)
    channels = max(sections[0].levels[0].shape[1], 1)
    deviance = np.empty((len(sections), len(every)))
    for k, (power, one) in enumerate(zip(powers, sections, strict=True)):
        dof = channels * np.array([len(level) for level in one.levels], dtype=np.float64)
        shape, log = _contrast_shapes(longest, shortest, one.seconds, len(one.levels))
        own = (power / shape) @ dof / dof.sum()
        deviance[k] = log @ dof + dof.sum() * np.log(np.maximum(own, SMALLEST_VARIANCE))
    total = deviance.sum(axis=0)
    without = (total - deviance)[:, :choices]
    rise = without[:, 0] - without.min(axis=1)
    bound = float(scipy.special.chdtri(2, _LEVEL))
    others = tuple(
        every[int(np.argmin(row))] if up > bound else WHITE
        for row, up in zip(without, rise, strict=True)
    )
    if len(sections) < 2 or rise.min() <= bound:
        return SectionCorrelations(WHITE, (WHITE,) * len(sections) if len(sections) < 2 else others)
    short = np.array([one.seconds for one in every]) <= _SHORT * longest
    short[choices:] = False
    least = float(total.min())
    walks = float(total[choices:].min()) - least < float(scipy.special.chdtri(1, _EXCLUDED))
    slow = float(total[short].min()) - least > float(scipy.special.chdtri(1, _EXCLUDED_SHORT))
    whole = every[int(np.argmin(total[:choices]))]
    return SectionCorrelations(whole, others, float(rise.min()), walks and slow)


def fine_variance(
    one: Contrasts, power: Array, channels: int, correlation: NoiseCorrelation
) -> tuple[float, int]:
    """Return the variance at the fine levels relative to the common scale, and its dof.

    `power` contains the `contrast_powers` of these channels.
    """
    shape = correlation.contrast_variance_ratio(block_durations(one.seconds, len(one.levels)))
    counts = [channels * len(level) for level in one.levels[COARSE_LEVELS:]]
    total = float((power / shape)[COARSE_LEVELS:] @ np.array(counts, dtype=np.float64))
    return max(total / max(sum(counts), 1), SMALLEST_VARIANCE), sum(counts)


def _log_variance(freedom: Array) -> Array:
    """Return the variance of the logarithm of an estimated variance: a trigamma function."""
    return np.asarray(scipy.special.polygamma(1, freedom / 2), dtype=np.float64)


def _log_bias(freedom: Array) -> Array:
    """Return the mean of the logarithm of an estimated variance divided by its expectation."""
    half: Array = freedom / 2
    return np.asarray(scipy.special.digamma(half) - np.log(half), dtype=np.float64)


def moderated_variances(found: Sequence[tuple[float, int]]) -> tuple[Array, Array]:
    """Return the moderated variances, (r,), and the degrees of freedom of each."""
    own = np.array([variance for variance, _ in found])
    dof = np.array([count for _, count in found], dtype=np.float64)
    if len(own) < 3:
        return own, dof
    log, expected = np.log(own) - _log_bias(dof), _log_variance(dof)
    weight = 1 / expected
    middle = float(weight @ log / weight.sum())
    spread = float(np.sum((log - middle) ** 2) / (len(own) - 1) - expected.mean())
    prior, level = _SURE, float(dof @ own / dof.sum())
    if spread > 0:
        prior = 2 * _inverse_trigamma(spread)
        level = float(np.exp(middle + _log_bias(np.array([prior]))[0]))
    return (prior * level + dof * own) / (prior + dof), prior + dof


def _inverse_trigamma(y: float) -> float:
    def off(log: float) -> float:
        return float(np.log(_log_variance(np.array([2 * np.exp(log)]))[0] / y))

    low, high = -8.0, 18.0
    if off(high) > 0:
        return float(np.exp(high))
    if off(low) < 0:
        return float(np.exp(low))
    return float(np.exp(cast("float", scipy.optimize.brentq(off, low, high, xtol=1e-6))))
