"""Test, by frequency and by averaging time, whether the fitted terms describe a recording.

A bin contains w squared coefficients with the mean I. If the model S is correct, w I/S is
distributed as χ² with w degrees of freedom. The residual of a bin is z = Φ⁻¹(F_w(w I/S)), which is
then a standard normal deviate. For large w, I/S − 1 could be used instead. For a single
coefficient, however, the square of I/S − 1 has such long tails that one bin in a thousand would
make a decade fail. Over a decade of frequency, the mean square of z must not exceed 1.5. If a
decade has few bins, the limit is higher (3.5 standard deviations), because they may exceed 1.5 by
chance. The overlapping Allan deviation must be within its 95 % band at four of five averaging
times.
"""

from dataclasses import dataclass

import numpy as np

from inercal.basics.arrays import Array
from inercal.noise.deviations import Deviations
from inercal.noise.likelihood import NoiseFit
from inercal.noise.numerics import normal_deviate
from inercal.noise.output_filter import filtered_model_avar
from inercal.noise.spectrum import Bins
from inercal.noise.terms import model_avar

_LARGEST = 1.5  # limit of the mean square in a decade
_QUANTILE = 3.5  # allowed standard deviations of a decade's mean square
_OUTSIDE = 0.2  # largest share of averaging times outside the band
_IN_BAND = 2.0  # neighbours of the worst bin above this residual belong to its band
_PASSED = 0.5  # an averaging time is tested if a filter passes this share
_CERTAIN = 3.0  # smallest edf of a tested averaging time


@dataclass(frozen=True)
class Decade:
    """Result of the test in one decade of frequency.

    Parameters
    ----------
    low, high : float
        Ends of the decade, Hz.
    mean_square : float
        Mean square of the residuals.
    limit : float
    worst_low, worst_high : float
        Band around the largest residual, Hz.
    level : float
        Measured power divided by the model's power in this band.
    """

    low: float
    high: float
    mean_square: float
    limit: float
    worst_low: float
    worst_high: float
    level: float

    @property
    def fits(self) -> bool:
        """Whether the model describes the decade."""
        return self.mean_square <= self.limit


@dataclass(frozen=True, eq=False)
class Goodness:
    """Result of testing a fit.

    Parameters
    ----------
    frequency, residual : (b,) array
        Frequency, Hz, and residual z of each bin.
    decades : tuple of Decade
    outside : int
        Number of averaging times at which the model is outside the 95 % band of the deviation.
    judged : int
        Number of averaging times that were tested.
    """

    frequency: Array
    residual: Array
    decades: tuple[Decade, ...]
    outside: int
    judged: int

    @property
    def fits(self) -> bool:
        """Whether the terms describe the recording."""
        return all(one.fits for one in self.decades) and self.within_band

    @property
    def within_band(self) -> bool:
        """Whether the model is within the band of the Allan deviation."""
        return self.outside <= max(1, int(_OUTSIDE * self.judged))

    @property
    def worst(self) -> Decade | None:
        """The decade with the worst fit, if any decade fails the test."""
        bad = [one for one in self.decades if not one.fits]
        return max(bad, key=lambda one: one.mean_square / one.limit, default=None)

    @property
    def worst_band(self) -> tuple[float, float] | None:
        """Ends of the band with the worst fit, Hz; None if it is a single frequency."""
        one = self.worst
        if one is None or one.worst_low == one.worst_high:
            return None
        return one.worst_low, one.worst_high

    @property
    def verdict(self) -> str:
        """A sentence that says whether the terms describe the recording, or where they do not."""
        worst = self.worst
        if worst is None and self.within_band:
            return "the model describes the recording"
        if worst is None:
            return (
                f"at {self.outside} of {self.judged} averaging times the measured Allan deviation "
                "is outside the range that the model predicts"
            )
        band = f"{worst.worst_low:.3g}–{worst.worst_high:.3g} Hz"
        if worst.worst_low == worst.worst_high:
            band = f"{worst.worst_low:.3g} Hz"
        return (
            f"the model does not describe {band}, where the power is {worst.level:.3g} times as "
            "large as predicted"
        )


def judge_fit(bins: Bins, fit: NoiseFit, oadev: Deviations) -> Goodness:
    """Test how well a fit describes its bins and the Allan deviation."""
    residual = normal_deviate(bins.weight, bins.weight * bins.power / fit.model)
    top = np.log10(bins.frequency.max()) + 1e-9
    number = np.floor(top - np.log10(bins.frequency)).astype(int)
    ratio = bins.power / fit.model
    decades: list[Decade] = []
    for k in range(number.max(), -1, -1):
        chosen = number == k
        if not chosen.any():
            continue
        frequency, z = bins.frequency[chosen], residual[chosen]
        spread = np.sqrt(2 / z.size)
        limit = max(_LARGEST, 1 + _QUANTILE * float(spread))
        decades.append(
            Decade(
                float(frequency.min()),
                float(frequency.max()),
                float(np.mean(z**2)),
                limit,
                *_worst_band(frequency, z, bins.weight[chosen], ratio[chosen]),
            )
        )
    judged = oadev.edf >= _CERTAIN
    known = fit.as_variances, oadev.tau, bins.dt, fit.markov_time
    variance = filtered_model_avar(*known, bins.output)
    # Averaging times that are shorter than the response of a filter all show the same noise.
    judged &= variance >= _PASSED * model_avar(*known)
    expected = np.sqrt(variance)
    outside = (expected < oadev.low) | (expected > oadev.high)
    count = int(np.count_nonzero(outside & judged))
    return Goodness(bins.frequency, residual, tuple(decades), count, int(judged.sum()))


def _worst_band(
    frequency: Array, residual: Array, weight: Array, ratio: Array
) -> tuple[float, float, float]:
    """Return the ends, Hz, and the relative power of the band around the largest residual.

    The band consists of neighbours whose residuals have the same sign and exceed 2 standard
    deviations.
    """
    order = np.argsort(frequency, kind="stable")
    z = residual[order]
    k = int(np.argmax(np.abs(z)))
    others = np.flatnonzero(z * np.sign(z[k]) <= _IN_BAND)
    below, above = others[others < k], others[others > k]
    first = int(below[-1]) + 1 if below.size else 0
    stop = int(above[0]) if above.size else z.size
    band = order[first:stop] if first < stop else order[k : k + 1]
    level = float(weight[band] @ ratio[band] / weight[band].sum())
    return float(frequency[band[0]]), float(frequency[band[-1]]), level
