"""Estimate the noise correlation within sections, and each section's variance, from Haar contrasts.

`inercal.estimation.section_statistics` defines the contrasts and their variance at each level.

Sources: Percival and Walden, Wavelet Methods for Time Series Analysis, Cambridge 2000, chapter 8
(Haar variance of a process); Smyth 2004, Statistical Applications in Genetics 3, article 3,
section 6.2 (moderated variances).
"""

# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy

from inercal.basics.arrays import Array, Bools, Indices

COARSE_LEVELS = 2  # levels that reveal a change; the finer levels show the noise
SMALLEST_VARIANCE = 1e-6  # fraction of the mean variance; below it a section is constant
_LEVEL = 0.01  # significance level of the likelihood ratio for a correlation
# Significance levels to exclude a long memory, and to exclude all short memories.
_EXCLUDED, _EXCLUDED_SHORT = 0.01, 0.05
_RATIOS = np.concatenate([[0.0], np.geomspace(0.1, 3e3, 28)])  # ρ
_KEPT, _FEW_KEPT = 128, 8  # forms of recordings whose correlations and ratios are kept
_TIMES = 14  # number of values of τ
_SHORT, _LONG = 1 / 9, 4.0  # in section lengths; the second one looks like a random walk
_LONG_RATIOS = np.geomspace(0.1, 3e6, 50)  # ρ for the long memory
_ROUNDED = 1e-12  # of x
_SURE = 1e9  # degrees of freedom of the prior if sections have equal variances
_FLICKER = 2 * np.log(2) / np.pi  # Allan variance of flicker noise relative to B²


class Contrasts(NamedTuple):
    """Haar contrasts and slopes of r sections with m channels.

    A short section has only half as many batches, so its finest level is zero.
    """

    seconds: Array  # (r,)
    samples: Indices  # (r,)
    batches: Indices  # (r,)
    levels: tuple[Array, ...]  # (r, 2^(l − 1), m) each
    slope: Array  # (r, m)
    slope_per_trend: Array  # (r, m), value of `slope` for a trend of one per second

    @property
    def counts(self) -> Indices:
        """Number of contrasts of one channel at each level, (r, levels)."""
        counts = 2 ** np.arange(len(self.levels))
        return np.where(counts < self.batches[:, None], counts, 0)

    def of(self, chosen: Bools) -> "Contrasts":
        """Return the contrasts of the chosen sections; `chosen` has one value for each section."""
        levels = tuple(level[chosen] for level in self.levels)
        parts = [part if isinstance(part, tuple) else part[chosen] for part in self]
        return Contrasts._make(parts)._replace(levels=levels)

    def relative_to_slow_noise(self, flicker: Array, walk: Array) -> "Contrasts":
        """Return the contrasts, scaled so that known slow noise looks like white noise.

        A contrast of blocks of n samples and h seconds has the variance w + n σ²(h), where w is the
        white noise, found at the fine levels, and σ² is the Allan variance of the slow noise
        (2 ln 2/π B² + K² h/3, IEEE Std 952, annex C). It is divided by the square root of this
        variance relative to w.

        Parameters
        ----------
        flicker, walk : (m,) arrays
            B and K of each channel, in its unit and in its unit per √s.
        """
        blocks = block_durations(self.seconds, len(self.levels))[..., None]
        size = (self.samples / self.seconds)[:, None, None] * blocks
        slow = size * (_FLICKER * flicker**2 + walk**2 * blocks / 3)  # (r, levels, m)
        squares = np.stack([np.sum(level**2, axis=1) for level in self.levels], axis=1)
        fine = self.counts[:, COARSE_LEVELS:, None]
        power = squares[:, COARSE_LEVELS:].sum(axis=(0, 1)) / fine.sum()
        white = power - np.sum(fine * slow[:, COARSE_LEVELS:], axis=(0, 1)) / fine.sum()
        white = np.maximum(white, SMALLEST_VARIANCE * power)
        ratio = np.sqrt(1 + slow / np.where(white > 0, white, np.inf))
        return self._replace(
            levels=tuple(one / ratio[:, [k]] for k, one in enumerate(self.levels)),
            slope=self.slope / ratio[:, 0],
            slope_per_trend=self.slope_per_trend / ratio[:, 0],
        )


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


def block_durations(seconds: Array, levels: int) -> Array:
    """Return the block lengths at levels 1, 2, … of r sections, (r, levels) s."""
    return np.asarray(seconds[:, None] / 2.0 ** np.arange(1, levels + 1))


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


@lru_cache(_FEW_KEPT)
def _contrast_shapes(
    longest: float, shortest: float, seconds: tuple[float, ...], levels: int
) -> tuple[Array, Array]:
    """Return the variance ratios of contrasts for all `_compared_correlations`, and their logs.

    Both are (r, correlations, levels) for r sections.
    """
    every = _compared_correlations(longest, shortest)
    blocks = block_durations(np.array(seconds), levels)[:, None]
    ratio, tau = np.array([(one.ratio, one.seconds) for one in every]).T[..., None]
    shape = _contrast_variance_ratio(ratio, tau, blocks)
    return shape, np.log(shape)


def fit_correlations(powers: Array, sections: Contrasts) -> SectionCorrelations:
    """Return the noise correlation of sections from the mean power at each level, (r, levels)."""
    longest = float(sections.seconds.max())
    shortest = float((sections.seconds / sections.batches).min())
    every = _compared_correlations(longest, shortest)
    choices, r = len(every) - len(_LONG_RATIOS), len(powers)
    counts = max(sections.levels[0].shape[2], 1) * sections.counts[..., None].astype(np.float64)
    shape, log = _contrast_shapes(
        longest, shortest, tuple(sections.seconds.tolist()), len(sections.levels)
    )
    dof = counts.sum(axis=1)
    own = (1 / shape @ (counts * powers[..., None]))[..., 0] / dof
    deviance = (log @ counts)[..., 0] + dof * np.log(np.maximum(own, SMALLEST_VARIANCE))
    total = deviance.sum(axis=0)
    without = (total - deviance)[:, :choices]
    rise = without[:, 0] - without.min(axis=1)
    bound = float(scipy.special.chdtri(2, _LEVEL))
    others = tuple(
        every[int(np.argmin(row))] if up > bound else WHITE
        for row, up in zip(without, rise, strict=True)
    )
    if r < 2 or rise.min() <= bound:
        return SectionCorrelations(WHITE, (WHITE,) * r if r < 2 else others)
    short = np.array([one.seconds for one in every]) <= _SHORT * longest
    short[choices:] = False
    least = float(total.min())
    walks = float(total[choices:].min()) - least < float(scipy.special.chdtri(1, _EXCLUDED))
    slow = float(total[short].min()) - least > float(scipy.special.chdtri(1, _EXCLUDED_SHORT))
    whole = every[int(np.argmin(total[:choices]))]
    return SectionCorrelations(whole, others, float(rise.min()), walks and slow)


def fine_variances(
    sections: Contrasts, powers: Array, channels: int, correlation: NoiseCorrelation
) -> tuple[Array, Array]:
    """Return each section's variance at the fine levels relative to the common scale, and its dof.

    `powers` contains the mean power of the contrasts at each level, (r, levels).
    """
    blocks = block_durations(sections.seconds, len(sections.levels))
    shape = correlation.contrast_variance_ratio(blocks)
    counts = channels * sections.counts[:, COARSE_LEVELS:].astype(np.float64)
    dof = counts.sum(axis=1)
    total = np.sum((powers / shape)[:, COARSE_LEVELS:] * counts, axis=1)
    return np.maximum(total / np.maximum(dof, 1), SMALLEST_VARIANCE), dof


def _log_bias(freedom: Array) -> Array:
    """Return the mean of the logarithm of an estimated variance divided by its expectation."""
    half: Array = freedom / 2
    return np.asarray(scipy.special.digamma(half) - np.log(half), dtype=np.float64)


def moderated_variances(own: Array, dof: Array) -> tuple[Array, Array]:
    """Return the moderated variances of r sections, (r,), and the degrees of freedom of each."""
    if len(own) < 3:
        return own, dof
    # The variance of the logarithm of an estimated variance is a trigamma function.
    log, expected = np.log(own) - _log_bias(dof), np.asarray(scipy.special.polygamma(1, dof / 2))
    weight = 1 / expected
    middle = float(weight @ log / weight.sum())
    spread = float(np.sum((log - middle) ** 2) / (len(own) - 1) - expected.mean())
    prior, level = _SURE, float(dof @ own / dof.sum())
    if spread > 0:
        prior = 2 * _inverse_trigamma(spread)
        level = float(np.exp(middle + _log_bias(np.array([prior]))[0]))
    return (prior * level + dof * own) / (prior + dof), prior + dof


def _inverse_trigamma(y: float) -> float:
    """Return x with trigamma(x) = y, by Newton's method for 1/trigamma (Smyth 2004, appendix).

    1/trigamma is convex and nearly straight, so the steps approach x from one side.
    """
    x, step = 0.5 + 1 / y, np.inf
    while abs(step) > _ROUNDED * x:
        value, slope = (float(scipy.special.polygamma(n, x)) for n in (1, 2))
        step = value * (1 - value / y) / slope
        x += step
    return min(x, _SURE)
