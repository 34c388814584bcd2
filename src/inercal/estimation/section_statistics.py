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

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import comb, sqrt
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
    fine_variances,
    fit_correlations,
    moderated_variances,
)
from inercal.estimation.scores import BURST_AT, COMMON_DRIFT, SLOW_NOISE, ModelTest

_BATCHES, _FEW_BATCHES, _FEW_SAMPLES = 16, 8, 64
_OF_SLOPES = 3  # levels whose scatter is close to that of slopes
_LEVEL = 0.01  # p-value of the tests within sections, below which a change counts
_RAREST = 1e-290
_ROUNDING = 16 * float(np.finfo(float).eps)  # relative to a reading
_BEYOND = 0.05  # p-value of the common-trend test, below which the trend counts


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
    def drifts(self) -> bool:
        """Whether the trend test rejects at 5 %.

        At this level, residuals also enlarge uncertainties.
        """
        return self.trend_test is not None and self.trend_test.p_value < _BEYOND

    @property
    def significant_trend_sd(self) -> Array:
        """Standard deviation of the channels' trends in excess of noise, per second.

        The value is a moment estimate over all channels together, in units of each channel's noise
        effect. It is zero unless `drifts` is true: the slopes of short sections are so
        uncertain that random values must not count.
        """
        if not self.drifts:
            return np.zeros(len(self.trend))
        known = (self.trend_sd > 0) & np.isfinite(self.trend_sd)
        if not known.any():
            return np.zeros(len(self.trend))
        beyond = float(np.mean((self.trend[known] / self.trend_sd[known]) ** 2)) - 1
        return np.where(known, self.trend_sd, 0.0) * np.sqrt(max(beyond, 0.0))


def haar_contrasts(sections: Iterable[Array], seconds: Array) -> Contrasts:
    """Return the contrasts of r sections of samples, (n, m) each, n ≥ 8, with durations (r,) s.

    Contrasts no larger than the floating-point rounding of the samples are set to zero, because a
    section without noise has no scatter to compare with.
    """
    means: list[Array] = []
    slopes: list[Array] = []
    numbers: list[tuple[int, int, float]] = []
    for section in sections:
        n = len(section)
        count = _BATCHES if n >= _FEW_SAMPLES else _FEW_BATCHES
        edges = np.arange(count + 1) * n // count
        off = section - section[0]  # exactly zero if nothing changes
        mean = np.add.reduceat(off, edges[:-1], axis=0) / (edges[1:] - edges[:-1])[:, None]
        rounding = _ROUNDING * np.abs(section).max(axis=0)
        mean = np.where(np.ptp(mean, axis=0) > rounding, mean, 0.0)
        place = np.arange(count, dtype=np.float64) - (count - 1) / 2
        length = sqrt((count**3 - count) / 12)  # the norm of `place`
        slopes.append(place @ mean * (sqrt(n / count) / length))
        numbers.append((n, count, length / count * sqrt(n / count)))
        means.append(mean.repeat(_BATCHES // count, axis=0))
    samples, batches, reach = (np.array(part) for part in zip(*numbers, strict=True))
    merged, levels = np.stack(means), list[Array]()
    size = np.sqrt(samples / _BATCHES)[:, None, None]
    while merged.shape[1] > 1:
        left, right, width = merged[:, ::2], merged[:, 1::2], _BATCHES // merged.shape[1]
        levels.append((left - right) * (sqrt(width / 2) * size))
        merged = 0.5 * (left + right)
    coarsest_first, slope = tuple(levels[::-1]), np.stack(slopes)
    per_trend = np.repeat((reach * seconds)[:, None], slope.shape[1], axis=1)
    return Contrasts(seconds, samples, batches, coarsest_first, slope, per_trend)


def analyse_sections(
    sections: Contrasts,
    labels: Sequence[str],
    names: Sequence[str],
    rounding: Array | None = None,
) -> SectionStatistics:
    """Analyse sections of channels of one kind, which have the same shape of noise.

    Parameters
    ----------
    sections : Contrasts
        Contrasts of r sections in m channels.
    labels : sequence of r str
        Labels of the sections.
    names : sequence of m str
        Names of the channels.
    rounding : (m,) array, optional
        Variance that coarse quantisation steps add to each mean.
    """
    r = len(labels)
    # Levels that a short section does not have are zero.
    squares = sum(np.sum(level**2, axis=(0, 1)) for level in sections.levels)
    size = np.sqrt(squares / sections.counts.sum())  # the rms contrast of each channel
    used = np.flatnonzero(size > 0)
    if not used.size:
        unknown, none = np.full(len(names), np.nan), np.zeros((r, len(names)))
        return SectionStatistics(WHITE, np.ones(r), unknown, unknown, unknown, none)
    relative = [level[..., used] / size[used] for level in sections.levels]
    powers = np.stack([np.mean(level**2, axis=(1, 2)) for level in relative], axis=1)
    correlations = fit_correlations(powers, sections)
    fitted, others = correlations.whole, correlations.others
    distinct = {id(found): found for found in (fitted, *others)}  # usually only one
    moderated = {
        key: moderated_variances(*fine_variances(sections, powers, used.size, found))
        for key, found in distinct.items()
    }
    steps = np.zeros(used.size) if rounding is None else rounding[used] / size[used] ** 2
    scatters = np.array([[part[k] for part in moderated[id(o)]] for k, o in enumerate(others)])
    seen = _changes(sections, relative, others, scatters, steps)
    tests = [*_bursts(sections, relative, steps), *seen]
    p = np.stack([one.p for one in tests], axis=-1)
    section, channel, kind = (int(k) for k in np.unravel_index(np.argmin(p), p.shape))
    shape = tests[kind].shape
    where = "change within"
    if shape == "burst":
        where = _burst_name(
            [one[section, :, channel] for one in relative], sections.batches[section]
        )
    name = f"{where} {labels[section]} ({names[used[channel]]})"
    disturbance_variance = np.zeros((r, len(names)))
    for one in tests:
        shift = one.power / sections.samples[:, None] * size[used] ** 2
        disturbance_variance[:, used] += np.where(p.size * one.p < _LEVEL, shift, 0.0)
    steady = np.asarray(~disturbance_variance.any(axis=1))
    trend, sd, own, common = _trend(sections.of(steady), names, size, used, fitted)
    scale = moderated[id(fitted)][0]
    test = model_test_from_p_value(name, p.size * float(p[section, channel, kind]))
    return SectionStatistics(
        fitted,
        scale / scale.mean(),
        trend,
        sd,
        own,
        disturbance_variance,
        test,
        common,
        ModelTest(SLOW_NOISE, correlations.rise, 2) if correlations.long else None,
        shape,
    )


class _DisturbanceTests(NamedTuple):
    """One test within each of r sections and u used channels."""

    shape: Literal["change", "burst"]
    p: Array  # (r, u)
    power: Array  # (r, u), squared shift of the mean times its samples, relative to the noise


def _changes(
    sections: Contrasts,
    relative: Sequence[Array],
    others: Sequence[NoiseCorrelation],
    own: Array,
    steps: Array,
) -> list[_DisturbanceTests]:
    """Test each section and channel for changes, compared with the section's own scatter.

    `others` is the correlation in the other sections; `own` is the white noise of the section,
    relative to the common scale, and its degrees of freedom, (r, 2).
    """
    blocks = block_durations(sections.seconds, COARSE_LEVELS)
    found: list[_DisturbanceTests] = []
    shapes = [by.contrast_variance_ratio(h) for by, h in zip(others, blocks, strict=True)]
    # Both blocks have one rounding error each.
    of_steps = 0.5 * sections.samples[:, None] * steps
    for place, part in enumerate(np.stack(shapes, axis=1)):
        power, count = np.sum(relative[place] ** 2, axis=1), 2**place
        ratio = power / count / ((own[:, 0] * part)[:, None] + of_steps)
        p = scipy.special.fdtrc(count, own[:, 1:], ratio)
        found.append(_DisturbanceTests("change", p, power / count))
    return found


def _bursts(
    sections: Contrasts, relative: Sequence[Array], steps: Array
) -> list[_DisturbanceTests]:
    """Test each section and channel for one or two batches that differ from the others.

    An F test compares the one or two largest of c contrasts with the others; its p-value is
    multiplied by the number of possible choices.
    """
    p, power = np.empty((2, 2, *relative[0][:, 0].shape))
    for level in relative[-2:]:
        c = level.shape[1]
        own = sections.batches == 2 * c
        squares = np.sort(level[own] ** 2, axis=1)[:, ::-1]
        least = sections.samples[own, None] / (2 * c) * steps + SMALLEST_VARIANCE
        for few in (1, 2):
            largest = squares[:, :few].sum(axis=1)
            rest = squares[:, few:].mean(axis=1) + least
            tail = scipy.special.fdtrc(few, c - few, largest / few / rest)
            p[few - 1, own] = comb(c, few) * tail
            # Neighbours may have moved in the same direction: their shifts add up.
            power[few - 1, own] = few * largest / c
    return [_DisturbanceTests("burst", *one) for one in zip(p, power, strict=True)]


def _burst_name(levels: Sequence[Array], batches: int) -> str:
    """Return where the largest of a section's finest contrasts is, in the name of its test."""
    finest = next(one for one in levels if 2 * len(one) == batches)
    at = int(np.argmax(np.square(finest)))
    ends = {0: f"{BURST_AT}start of", len(finest) - 1: f"{BURST_AT}end of"}
    return ends.get(at, "burst within")


def _trend(
    sections: Contrasts,
    names: Sequence[str],
    size: Array,
    used: Indices,
    correlation: NoiseCorrelation,
) -> tuple[Array, Array, Array, ModelTest | None]:
    """Return the mean trend, its sd, the sd of one slope, (m,) each, and the trend test."""
    m, r = len(names), len(sections.seconds)
    if r < 3:
        return np.full(m, np.nan), np.full(m, np.nan), np.full(m, np.nan), None
    reach, slope = sections.slope_per_trend, sections.slope
    square = np.sum(reach**2, axis=0)
    mean = np.sum(reach * slope, axis=0) / square
    unit = np.where(size > 0, size, 1.0)
    # In units of their noise, the slopes of all channels scatter as much as contrasts of halves.
    left = ((slope - reach * mean) / unit)[:, used]
    total, dof = float(np.sum(left**2)), left.size - used.size
    blocks = block_durations(sections.seconds, _OF_SLOPES)
    shapes = correlation.contrast_variance_ratio(blocks)
    for place, level in enumerate(sections.levels[1:_OF_SLOPES], 1):
        squares = np.sum((level[..., used] / size[used]) ** 2, axis=(1, 2))
        total += float(np.sum(squares / (shapes[:, place] / shapes[:, 0])))
        dof += r * 2**place * used.size
    own = np.sqrt(total / dof) * size
    sd = own / np.sqrt(square)
    if not total > 0:
        return mean, sd, own, None
    square_t = np.zeros(m)
    square_t[used] = (mean[used] / sd[used]) ** 2
    p = float(scipy.special.fdtrc(used.size, dof, square_t.sum() / used.size))
    name = f"{COMMON_DRIFT} ({names[int(square_t.argmax())]})"
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
