"""Tests of sections against themselves: changes, correlated noise, and a trend that all share.

A section of T seconds is cut into batches of equal length, and the batch means y into Haar
contrasts: the first half against the second (level 1), each half's halves (level 2), and so on.
With blocks of h = T/2^l seconds on either side and n_h samples in each::

    z = √(n_h/2) (ȳ_left − ȳ_right)

White noise gives z the same variance on all levels. Noise that adds a first-order Gauss–Markov
process of correlation time τ gives, with a = 1 − exp(−h/τ)::

    var z = w (1 + ρ (1 − (τ/h) a − (τ/2h) a²))

and the mean of the section the density w (1 + ρ (1 − (τ/T)(1 − exp(−T/τ)))), over the number of
samples. ρ and τ are common to all sections, w is each section's own; they maximise the likelihood,
and are kept where twice its logarithm rises by more than the 99 % bound, whichever section is left
out: one disturbed section is no correlation. τ is at most T/2. Where likelihood ratios exclude all
τ below T/9 and do not exclude a random walk (τ = 4 T), no statistic within sections tells how far
the noise wanders from one to the next: the model, in which the noise of sections is independent, is
rejected with the p-value of the correlation.

* Change within a section: the contrast of its halves, and those of the halves' halves, against the
  section's own scatter on the finer levels (F), by the correlation that the other sections show.
* Burst within a section: the one or two largest contrasts of the finest level against the others.
* Trend common to all sections that do not change: the mean of their slopes against the scatter of
  the slopes and of the contrasts of levels 2 and 3.
* Scatter of each section: its variance on the finer levels, drawn to that of all (empirical Bayes)
  as far as sections of one variance would scatter.

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
from numpy.typing import NDArray

from inercal.basics.arrays import Array
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
_OF_SLOPES = 3  # levels whose scatter is nearly that of slopes
_LEVEL = 0.01  # of the tests within, below which a change is counted
_RAREST = 1e-290
_ROUNDING = 16 * float(np.finfo(float).eps)  # of a reading
_COMMON = "drift common to all sections"
_BEYOND = 0.05  # of the test of a common trend, below which the trend counts
_LONG = "noise slower than the sections"


@dataclass(frozen=True, eq=False)
class SectionStatistics:
    """Noise, trends and disturbances of sections, from their samples.

    Parameters
    ----------
    correlation : NoiseCorrelation
        `WHITE` where none is significant.
    scale : (r,) array
        Variance of each section's noise over that of all.
    trend, trend_sd : (m,) arrays
        Per second, of the mean slope; NaN of fewer than three sections.
    slope_sd : (m,) array
        Of `Contrasts.slope` of one section; NaN of fewer than three sections.
    disturbance_variance : (r, m) array
        Variance of each mean by a change or a burst that is found in its section: the square of
        how far that moved the mean. Zero of all other sections.
    within, trend_test, long_test : ModelTest, optional
        Of a change within a section, of a trend common to all, and of noise that may be slower
        than the sections; the first two name the worst section or channel.
    shape : "change" or "burst"
        Of the worst change within a section.
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
        """The tests that exist."""
        every = (self.within, self.trend_test, self.long_test)
        return tuple(test for test in every if test is not None)

    @property
    def significant_trend_sd(self) -> Array:
        """Standard deviation of the channels' trends beyond the effect of noise, per second.

        Of all channels together, in units of what noise makes of each, by moments. Zero where their
        test does not reject at 5 %, the level at which residuals enlarge uncertainties too: slopes
        of short sections are known too badly for their chance size to count.
        """
        if self.trend_test is None or self.trend_test.p_value >= _BEYOND:
            return np.zeros(len(self.trend))
        known = (self.trend_sd > 0) & np.isfinite(self.trend_sd)
        if not known.any():
            return np.zeros(len(self.trend))
        beyond = float(np.mean((self.trend[known] / self.trend_sd[known]) ** 2)) - 1
        return np.where(known, self.trend_sd, 0.0) * np.sqrt(max(beyond, 0.0))


def haar_contrasts(section: Array, seconds: float) -> Contrasts:
    """Return the contrasts of the (n, m) samples of a section; n is 8 or more.

    What is no larger than the rounding of the samples' numbers is zero: a section without noise
    has no scatter by which anything could be judged.
    """
    n = len(section)
    count = _BATCHES if n >= _FEW_SAMPLES else _FEW_BATCHES
    edges = np.arange(count) * n // count
    off = section - section[0]  # exactly zero where nothing changes
    means = np.add.reduceat(off, edges, axis=0) / np.diff(edges, append=n)[:, None]
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
    return Contrasts(
        seconds,
        n,
        tuple(reversed(levels)),
        place @ means / length * size,
        length * seconds / count * size,
    )


def analyse_sections(
    sections: Sequence[Contrasts],
    labels: Sequence[str],
    names: Sequence[str],
    rounding: Array | None = None,
    *,
    coloured: bool = False,
) -> SectionStatistics:
    """Judge sections of channels of one kind, whose noise has one shape.

    Parameters
    ----------
    sections : sequence of r Contrasts
        Of m channels.
    labels : sequence of r str
        Of the sections.
    names : sequence of m str
        Of the channels.
    rounding : (m,) array, optional
        Variance that coarse steps add to each mean.
    coloured : bool
        The noise is known to have a slow part of any spectrum, such as flicker: each contrast and
        slope is tested against those of its own length alone.
    """
    r = len(sections)
    every = np.concatenate([level for one in sections for level in one.levels])
    size = np.sqrt(np.mean(every**2, axis=0))  # the rms contrast of each channel, (m,)
    used = np.flatnonzero(size > 0)
    if not used.size or not r:
        unknown, none = np.full(len(names), np.nan), np.zeros((r, len(names)))
        return SectionStatistics(WHITE, np.ones(r), unknown, unknown, unknown, none)
    correlations = fit_correlations(
        [contrast_powers(one, size, used) for one in sections], sections
    )
    fitted, others = correlations.whole, correlations.others
    distinct = {id(found): found for found in (fitted, *others)}  # nearly all are one
    moderated = {
        key: moderated_variances([fine_variance(one, size, used, found) for one in sections])
        for key, found in distinct.items()
    }
    changes = [
        _ReferenceNoise(label, found, *(float(part[k]) for part in moderated[id(found)]))
        for k, (label, found) in enumerate(zip(labels, others, strict=True))
    ]
    steps = np.zeros(len(names)) if rounding is None else rounding
    if coloured:
        seen = _changes_by_other_sections(sections, size, used)
    else:
        seen = _changes(sections, changes, size, used, steps)
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
    # Slow noise that is stated is part of the model.
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
    """One test within a section: its p-value, and what it would add to the mean's variance."""

    p: float
    section: int
    channel: int
    shape: Literal["change", "burst"]
    variance: float


class _ReferenceNoise(NamedTuple):
    """By what a section is judged: the others' correlation, its own white part, and its freedom."""

    label: str
    correlation: NoiseCorrelation
    white: float  # over all sections' scale
    dof: float


def _changes(
    sections: Sequence[Contrasts],
    judged: Sequence[_ReferenceNoise],
    size: Array,
    used: NDArray[np.intp],
    steps: Array,
) -> list[_DisturbanceTest]:
    """Return the tests of each section and channel for changes, by the section's own scatter."""
    found: list[_DisturbanceTest] = []
    for r, (one, by) in enumerate(zip(sections, judged, strict=True)):
        coarse = one.levels[:COARSE_LEVELS]
        shape = by.correlation.contrast_variance_ratio(
            block_durations(one.seconds, len(coarse))
        ).tolist()
        for k in used.tolist():
            # Both blocks have one rounding error each.
            of_steps = 0.5 * one.samples * float(steps[k]) / float(size[k]) ** 2
            for place, (level, part) in enumerate(zip(coarse, shape, strict=True)):
                square = float(np.mean((level[:, k] / size[k]) ** 2)) / (by.white * part + of_steps)
                p = float(scipy.special.fdtrc(len(level), by.dof, square))
                found.append(_DisturbanceTest(p, r, k, "change", _change_variance(one, place, k)))
    return found


def _changes_by_other_sections(
    sections: Sequence[Contrasts], size: Array, used: NDArray[np.intp]
) -> list[_DisturbanceTest]:
    """Return the same tests by the contrasts of the same level in the other sections."""
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
                found.append(_DisturbanceTest(p, r, k, "change", _change_variance(one, place, k)))
    return found


def _change_variance(one: Contrasts, place: int, k: int) -> float:
    """Return the square of how far a change of half a section, or of a quarter, moves its mean."""
    return float(np.sum(one.levels[place][:, k] ** 2)) / 2**place / one.samples


def _bursts(
    sections: Sequence[Contrasts], size: Array, used: NDArray[np.intp], steps: Array
) -> list[_DisturbanceTest]:
    """Return the tests of each section and channel for one batch, or two, unlike the others.

    The one or two largest of c contrasts against the others: F, times the number of choices.
    """
    found: list[_DisturbanceTest] = []
    for r, one in enumerate(sections):
        finest = one.levels[-1]
        c = len(finest)
        for k in used.tolist():
            squares = np.sort(finest[:, k] ** 2)[::-1]
            least = (
                one.samples / (2 * c) * float(steps[k]) + SMALLEST_VARIANCE * float(size[k]) ** 2
            )
            for few in (1, 2):
                largest = float(squares[:few].sum())
                rest = float(squares[few:].mean()) + least
                p = comb(c, few) * float(scipy.special.fdtrc(few, c - few, largest / few / rest))
                # Neighbours may have gone the same way: their shifts add up.
                found.append(_DisturbanceTest(p, r, k, "burst", few * largest / c / one.samples))
    return found


def _trend(
    sections: Sequence[Contrasts],
    names: Sequence[str],
    size: Array,
    used: NDArray[np.intp],
    correlation: NoiseCorrelation | None,
) -> tuple[Array, Array, Array, ModelTest | None]:
    """Return the mean trend, its deviation and that of one slope, (m,) each, and its test."""
    m, r = len(names), len(sections)
    if r < 3:
        return np.full(m, np.nan), np.full(m, np.nan), np.full(m, np.nan), None
    reach = np.array([one.slope_per_trend for one in sections])
    slope = np.stack([one.slope for one in sections])
    square = float(reach @ reach)
    mean = reach @ slope / square
    unit = np.where(size > 0, size, 1.0)
    # The channels' slopes scatter alike in units of their noise, and as contrasts of halves do.
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
    """Return the test of the section that differs most from another part of its run.

    Parameters
    ----------
    change : (r, k) array
    variance : (r,) array
        Of each component.
    labels, names : sequence of r str
        Of the sections, and of the channel that changes most in each.
    """
    chi2 = np.sum(change**2, axis=1) / variance
    worst = int(np.argmax(chi2))
    p = len(chi2) * float(scipy.special.chdtrc(change.shape[1], float(chi2[worst])))
    return model_test_from_p_value(f"change within {labels[worst]} ({names[worst]})", p)


def model_test_from_p_value(name: str, p: float) -> ModelTest:
    """Return a test of one degree of freedom with this p-value."""
    p = min(max(p, _RAREST), 1.0)
    return ModelTest(name, float(scipy.special.chdtri(1, p)), 1)
