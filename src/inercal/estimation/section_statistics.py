"""Test sections for changes, correlated noise and a common trend within them.

A section of T seconds is divided into batches of equal length. Haar contrasts compare the batch
means y: the first half with the second (level 1), then the two halves of each half (level 2), and
so on. If the blocks on either side have h = T/2^l seconds and n_h samples each, the contrast is::

    z = √(n_h/2) (ȳ_left − ȳ_right)

For white noise, z has the same variance at all levels. With an additional first-order Gauss–Markov
process of correlation time τ, and a = 1 − exp(−h/τ), it is::

    var z = w (1 + ρ (1 − (τ/h) a − (τ/2h) a²))

and the variance of the section's mean is w (1 + ρ (1 − (τ/T)(1 − exp(−T/τ)))) divided by the number
of samples. ρ and τ are common to all sections, and each section has its own w. These values
maximise the likelihood. They are accepted only if, whichever section is left out, twice the
log-likelihood rises by more than the 99 % bound. A single disturbed section is thus not mistaken
for a correlation. τ is at most T/2. If likelihood ratios exclude all τ below T/9 but do not exclude
a random walk (τ = 4 T), no statistic within sections shows how far the noise drifts from one
section to the next. The model assumes that the noise of different sections is independent, so in
this case it is rejected with the p-value of the correlation.

* Change within a section: an F test compares the contrast of its halves, and the contrasts within
  each half, with the section's own scatter at the finer levels, given the correlation found in the
  other sections.
* Burst within a section: the one or two largest contrasts at the finest level are compared with the
  others.
* Trend common to all sections without changes: the mean of their slopes is compared with the
  scatter of the slopes and of the contrasts at levels 2 and 3.
* Scatter of each section: its variance at the finer levels is shrunk towards the common variance
  (empirical Bayes), as strongly as the scatter between sections with equal variances requires.

Sources: Percival and Walden, Wavelet Methods for Time Series Analysis, Cambridge 2000, chapter 8
(Haar variance of a process); Smyth 2004, Statistical Applications in Genetics 3, article 3,
section 6.2 (moderated variances).
"""

# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb
from typing import Literal, NamedTuple

import numpy as np
import scipy

from inercal.basics.arrays import Array, Indices
from inercal.estimation.correlation import (
    COARSE_LEVELS,
    SMALLEST_VARIANCE,
    WHITE,
    Contrasts,
    NoiseCorrelation,
    block_durations,
    contrast_powers,
    fine_variance,
    fit_correlations,
    moderated_variances,
)
from inercal.estimation.scores import ModelTest

_BATCHES, _FEW_BATCHES, _FEW_SAMPLES = 16, 8, 64
_OF_SLOPES = 3  # levels whose scatter is close to that of slopes
_LEVEL = 0.01  # p-value of the tests within sections, below which a change counts
_RAREST = 1e-290
_ROUNDING = 16 * float(np.finfo(float).eps)  # relative to a reading
_COMMON = "drift common to all sections"
_BEYOND = 0.05  # p-value of the common-trend test, below which the trend counts
_LONG = "noise slower than the sections"


@dataclass(frozen=True, eq=False)
class SectionStatistics:
    """Noise, trends and disturbances of sections, found from their samples.

    Parameters
    ----------
    correlation : NoiseCorrelation
        Correlation of the noise; `WHITE` if it is not significant.
    scale : (r,) array
        Noise variance of each section divided by the common variance.
    trend, trend_sd : (m,) arrays
        Mean slope and its standard deviation, per second; NaN for fewer than three sections.
    slope_sd : (m,) array
        Standard deviation of `Contrasts.slope` for one section; NaN for fewer than three sections.
    disturbance_variance : (r, m) array
        Variance added to a mean because of a change or burst found in its section: the square of
        the shift that it caused in the mean. Zero for all other sections.
    within, trend_test, long_test : ModelTest, optional
        Tests for a change within a section, for a trend common to all sections, and for noise that
        may be slower than the sections. The first two name the worst section or channel.
    shape : "change" or "burst"
        Shape of the worst change within a section.
    """

    correlation: NoiseCorrelation
    scale: Array
    trend: Array
    trend_sd: Array
    slope_sd: Array
    disturbance_variance: Array
    within: ModelTest | None = None
    trend_test: ModelTest | None = None
    long_test: ModelTest | None = None
    shape: Literal["change", "burst"] = "change"

    @property
    def tests(self) -> tuple[ModelTest, ...]:
        """The tests that were made."""
        every = (self.within, self.trend_test, self.long_test)
        return tuple(test for test in every if test is not None)

    @property
    def significant_trend_sd(self) -> Array:
        """Standard deviation of the channels' trends in excess of noise, per second.

        The value is a moment estimate over all channels together, in units of each channel's noise
        effect. It is zero if the trend test does not reject at 5 %, the level at which residuals
        also enlarge uncertainties: the slopes of short sections are so uncertain that random values
        must not count.
        """
        if self.trend_test is None or self.trend_test.p_value >= _BEYOND:
            return np.zeros(len(self.trend))
        known = (self.trend_sd > 0) & np.isfinite(self.trend_sd)
        if not known.any():
            return np.zeros(len(self.trend))
        beyond = float(np.mean((self.trend[known] / self.trend_sd[known]) ** 2)) - 1
        return np.where(known, self.trend_sd, 0.0) * np.sqrt(max(beyond, 0.0))


def haar_contrasts(section: Array, seconds: float) -> Contrasts:
    """Return the contrasts of a section's samples (n, m), n ≥ 8.

    Contrasts no larger than the floating-point rounding of the samples are set to zero, because a
    section without noise has no scatter to compare with.
    """
    n = len(section)
    count = _BATCHES if n >= _FEW_SAMPLES else _FEW_BATCHES
    edges = np.arange(count + 1) * n // count
    off = section - section[0]  # exactly zero if nothing changes
    means = np.add.reduceat(off, edges[:-1], axis=0) / (edges[1:] - edges[:-1])[:, None]
    rounding = _ROUNDING * np.abs(section).max(axis=0)
    means = np.where(np.ptp(means, axis=0) > rounding, means, 0.0)
    size = np.sqrt(n / count)
    place = np.arange(count) - (count - 1) / 2
    length = float(np.linalg.norm(place))
    levels: list[Array] = []
    merged = means
    while len(merged) > 1:
        width = count // len(merged)
        levels.append((merged[::2] - merged[1::2]) * np.sqrt(width / 2) * size)
        merged = 0.5 * (merged[::2] + merged[1::2])
    slope, slope_per_trend = place @ means / length * size, length * seconds / count * size
    return Contrasts(seconds, n, tuple(reversed(levels)), slope, slope_per_trend)


def analyse_sections(
    sections: Sequence[Contrasts],
    labels: Sequence[str],
    names: Sequence[str],
    rounding: Array | None = None,
    *,
    coloured: bool = False,
) -> SectionStatistics:
    """Analyse sections of channels of one kind, which have the same shape of noise.

    Parameters
    ----------
    sections : sequence of r Contrasts
        Contrasts of m channels.
    labels : sequence of r str
        Labels of the sections.
    names : sequence of m str
        Names of the channels.
    rounding : (m,) array, optional
        Variance that coarse quantisation steps add to each mean.
    coloured : bool
        Whether the noise is known to have a slow part with any spectrum, such as flicker. Each
        contrast and slope is then compared only with others of the same length.
    """
    r = len(sections)
    every = np.concatenate([level for one in sections for level in one.levels])
    size = np.sqrt(np.mean(every**2, axis=0))  # the rms contrast of each channel
    used = np.flatnonzero(size > 0)
    if not used.size or not r:
        unknown, none = np.full(len(names), np.nan), np.zeros((r, len(names)))
        return SectionStatistics(WHITE, np.ones(r), unknown, unknown, unknown, none)
    powers = [contrast_powers(one, size, used) for one in sections]
    correlations = fit_correlations(powers, sections)
    fitted, others = correlations.whole, correlations.others
    distinct = {id(found): found for found in (fitted, *others)}  # usually only one
    moderated = {
        key: moderated_variances(
            [fine_variance(*one, used.size, found) for one in zip(sections, powers, strict=True)]
        )
        for key, found in distinct.items()
    }
    steps = np.zeros(len(names)) if rounding is None else rounding
    if coloured:
        seen = _changes_by_other_sections(sections, size, used)
    else:
        scatters = [[float(part[k]) for part in moderated[id(one)]] for k, one in enumerate(others)]
        seen = _changes(sections, others, scatters, size, used, steps)
    seen += _bursts(sections, size, used, steps)
    worst = min(seen)
    name = f"{worst.shape} within {labels[worst.section]} ({names[worst.channel]})"
    disturbance_variance = np.zeros((r, len(names)))
    for one in seen:
        if len(seen) * one.p < _LEVEL:
            disturbance_variance[one.section, one.channel] += one.variance
    steady = [one for one, own in zip(sections, disturbance_variance, strict=True) if not own.any()]
    trend, sd, own, common = _trend(steady, names, size, used, None if coloured else fitted)
    scale = moderated[id(fitted)][0]
    test = model_test_from_p_value(name, len(seen) * worst.p)
    # Stated slow noise is part of the model.
    slow = correlations.long and not coloured
    return SectionStatistics(
        fitted,
        scale / scale.mean(),
        trend,
        sd,
        own,
        disturbance_variance,
        test,
        common,
        ModelTest(_LONG, correlations.rise, 2) if slow else None,
        worst.shape,
    )


class _DisturbanceTest(NamedTuple):
    """One test within a section: its p-value, and the variance to add to the mean if it rejects."""

    p: float
    section: int
    channel: int
    shape: Literal["change", "burst"]
    variance: float


def _changes(
    sections: Sequence[Contrasts],
    others: Sequence[NoiseCorrelation],
    own: Sequence[Sequence[float]],
    size: Array,
    used: Indices,
    steps: Array,
) -> list[_DisturbanceTest]:
    """Test each section and channel for changes, compared with the section's own scatter.

    `others` is the correlation in the other sections; `own` is the white noise of the section,
    relative to the common scale, and its degrees of freedom.
    """
    found: list[_DisturbanceTest] = []
    for r, (one, by, (white, dof)) in enumerate(zip(sections, others, own, strict=True)):
        coarse = one.levels[:COARSE_LEVELS]
        shape = by.contrast_variance_ratio(block_durations(one.seconds, len(coarse)))
        # Both blocks have one rounding error each.
        unit = size[used] ** 2
        of_steps = 0.5 * one.samples * steps[used] / unit
        for place, (level, part) in enumerate(zip(coarse, shape.tolist(), strict=True)):
            power = np.sum(level[:, used] ** 2, axis=0)
            ratio = power / len(level) / unit / (white * part + of_steps)
            p = scipy.special.fdtrc(len(level), dof, ratio)
            found += _tests_of_channels(p, r, used, "change", power / 2**place / one.samples)
    return found


def _changes_by_other_sections(
    sections: Sequence[Contrasts], size: Array, used: Indices
) -> list[_DisturbanceTest]:
    """Test for changes by comparison with contrasts at the same level in the other sections."""
    found: list[_DisturbanceTest] = []
    for place in range(COARSE_LEVELS):
        squares = np.stack(
            [(one.levels[place] / np.where(size > 0, size, 1.0)) ** 2 for one in sections]
        )
        squares = squares[..., used]
        count, others = squares.shape[1], squares[0].size * (len(sections) - 1)
        for r, one in enumerate(sections):
            rest = float(squares.sum() - squares[r].sum())
            for a, k in enumerate(used.tolist()):
                ratio = float(squares[r, :, a].mean()) / max(
                    rest / max(others, 1), SMALLEST_VARIANCE
                )
                p = float(scipy.special.fdtrc(count, others, ratio)) if others else 1.0
                power = float(np.sum(one.levels[place][:, k] ** 2))
                variance = power / 2**place / one.samples  # squared shift of the mean
                found.append(_DisturbanceTest(p, r, k, "change", variance))
    return found


def _bursts(
    sections: Sequence[Contrasts], size: Array, used: Indices, steps: Array
) -> list[_DisturbanceTest]:
    """Test each section and channel for one or two batches that differ from the others.

    An F test compares the one or two largest of c contrasts with the others; its p-value is
    multiplied by the number of possible choices.
    """
    found: list[_DisturbanceTest] = []
    counts = [len(one.levels[-1]) for one in sections]
    for c in dict.fromkeys(counts):
        own = [r for r, count in enumerate(counts) if count == c]
        finest = np.stack([sections[r].levels[-1][:, used] for r in own], axis=1)
        squares = np.sort(finest**2, axis=0)[::-1]
        samples = np.array([sections[r].samples for r in own])[:, None]
        least = samples / (2 * c) * steps[used] + SMALLEST_VARIANCE * size[used] ** 2
        for few in (1, 2):
            largest = squares[:few].sum(axis=0)
            rest = squares[few:].mean(axis=0) + least
            p = comb(c, few) * scipy.special.fdtrc(few, c - few, largest / few / rest)
            # Neighbours may have moved in the same direction: their shifts add up.
            added = few * largest / c / samples
            for r, one, variance in zip(own, p, added, strict=True):
                found += _tests_of_channels(one, r, used, "burst", variance)
    return found


def _tests_of_channels(
    p: Array, section: int, used: Indices, shape: Literal["change", "burst"], variance: Array
) -> list[_DisturbanceTest]:
    """Return one test for each of the used channels, from their p-values and variances."""
    each = zip(p.tolist(), used.tolist(), variance.tolist(), strict=True)
    return [_DisturbanceTest(one, section, k, shape, added) for one, k, added in each]


def _trend(
    sections: Sequence[Contrasts],
    names: Sequence[str],
    size: Array,
    used: Indices,
    correlation: NoiseCorrelation | None,
) -> tuple[Array, Array, Array, ModelTest | None]:
    """Return the mean trend, its sd, the sd of one slope, (m,) each, and the trend test."""
    m, r = len(names), len(sections)
    if r < 3:
        return np.full(m, np.nan), np.full(m, np.nan), np.full(m, np.nan), None
    reach = np.array([one.slope_per_trend for one in sections])
    slope = np.stack([one.slope for one in sections])
    square = float(reach @ reach)
    mean = reach @ slope / square
    unit = np.where(size > 0, size, 1.0)
    # In units of their noise, the slopes of all channels scatter as much as contrasts of halves.
    left = ((slope - reach[:, None] * mean) / unit)[:, used]
    total, dof = float(np.sum(left**2)), left.size - used.size
    for one in sections if correlation is not None else ():
        assert correlation is not None
        halves = float(correlation.contrast_variance_ratio(np.array(one.seconds / 2)))
        for place, level in enumerate(one.levels[1:_OF_SLOPES], 2):
            shape = float(correlation.contrast_variance_ratio(np.array(one.seconds / 2**place)))
            total += float(np.sum((level[:, used] / size[used]) ** 2)) / (shape / halves)
            dof += level[:, used].size
    own = np.sqrt(total / dof) * size
    sd = own / np.sqrt(square)
    if not total > 0:
        return mean, sd, own, None
    square_t = np.zeros(m)
    square_t[used] = (mean[used] / sd[used]) ** 2
    p = float(scipy.special.fdtrc(used.size, dof, square_t.sum() / used.size))
    name = f"{_COMMON} ({names[int(square_t.argmax())]})"
    return mean, sd, own, model_test_from_p_value(name, p)


def largest_change_test(
    change: Array, variance: Array, labels: Sequence[str], names: Sequence[str]
) -> ModelTest:
    """Return the test for the section that differs most from another part of its run.

    Parameters
    ----------
    change : (r, k) array
    variance : (r,) array
        Variance of each component.
    labels, names : sequence of r str
        Labels of the sections, and the name of the channel that changes most in each.
    """
    chi2 = np.sum(change**2, axis=1) / variance
    worst = int(np.argmax(chi2))
    p = len(chi2) * float(scipy.special.chdtrc(change.shape[1], float(chi2[worst])))
    return model_test_from_p_value(f"change within {labels[worst]} ({names[worst]})", p)


def model_test_from_p_value(name: str, p: float) -> ModelTest:
    """Return a test with this p-value, stated as a χ² with one degree of freedom."""
    p = min(max(p, _RAREST), 1.0)
    return ModelTest(name, float(scipy.special.chdtri(1, p)), 1)
