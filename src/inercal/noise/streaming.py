"""Collect the data for the noise analysis of a channel that is read piece by piece.

The memory is limited: for 10⁸ samples, it is about 30 MB. The following data are stored: the sums
of squared differences at averaging factors up to 1024, every 64th cumulative sum, the current
segment of 2¹⁷ samples, the averaged spectrum of the earlier segments, and sums of squared
differences between neighbours over 5 s (half a window). The stored cumulative sums give the longer
averaging times, the block means for the low frequencies, and changes of the mean.

For an accompanying series such as the temperature, `StreamedMeans` stores block means at the same
times as the block means of the channel.
"""

import numpy as np

from inercal.basics.arrays import Array
from inercal.noise import spectrum
from inercal.noise.confidence import identify_noise
from inercal.noise.deviations import (
    ALLAN,
    FULL_OVERLAP,
    Deviations,
    stride_of,
    sum_of_squared_differences,
    with_intervals,
)
from inercal.noise.disturbances import (
    WINDOW,
    Disturbance,
    bursts_of_windows,
    clipping_level,
    find_changes,
    samples_per_degree,
)
from inercal.noise.recording_checks import check_rounding, rounding_step
from inercal.noise.spectrum import Spectrum

KEPT_EVERY = 64
_MANY = 4  # with this many segments, samples that do not fill a segment are omitted
_FIRST = 4096  # number of squared differences that determine the clipping level
_SHORT = 2 ** np.arange(int(np.log2(FULL_OVERLAP)) + 1, dtype=np.int64)


class StreamedMeans:
    """Collect a series piece by piece; at the end, it returns the block means."""

    def __init__(self) -> None:
        self.count = 0
        self._origin = 0.0  # mean of the first piece; subtracted to keep cumulative sums small
        self._last = 0.0  # cumulative sum
        self._kept: list[Array] = [np.zeros(1)]
        self._first: list[Array] = []

    def add(self, y: Array) -> None:
        """Add the next values, (k,), k ≥ 1."""
        if not self.count:
            self._origin = float(y.mean())
        if self.count < spectrum.LONGEST:
            self._first.append(y[: spectrum.LONGEST - self.count].copy())
        sums = self._last + np.cumsum(y - self._origin)
        # sums[0] is the cumulative sum number count + 1.
        skip = (-(self.count + 1)) % KEPT_EVERY
        self._kept.append(sums[skip::KEPT_EVERY].copy())
        self._last = float(sums[-1])
        self.count += y.size

    def means(self) -> Array:
        """Return the values, or the means of at most 2¹⁷ blocks if there are more values."""
        if self.count <= spectrum.LONGEST:
            return np.concatenate([np.zeros(0), *self._first])
        means = self._origin + np.diff(np.concatenate(self._kept)) / KEPT_EVERY
        return spectrum.block_means(means, -(-means.size // spectrum.LONGEST))


class StreamedChannel:
    """Collect one channel piece by piece; at the end, return deviations, spectra, disturbances.

    Parameters
    ----------
    dt : float
        Sampling interval Δ, s.
    """

    def __init__(self, dt: float):
        self.dt = dt
        self.count = 0
        self.origin = 0.0  # mean of the first piece; subtracted to keep cumulative sums small
        self.total = 0.0
        self._tail = np.zeros(1)  # the last cumulative sums
        self._squares = np.zeros(_SHORT.size)
        self._terms = np.zeros(_SHORT.size, dtype=np.int64)
        self._kept: list[Array] = [np.zeros(1)]
        self._segment = np.empty(spectrum.LONGEST)
        self._filled = 0
        self._power = np.zeros(spectrum.LONGEST - 1)
        self._segments = 0
        self._half = max(1, max(2, round(WINDOW / dt)) // 2)
        self._differences = np.zeros(0)
        self._largest: float | None = None
        self._half_sums: list[Array] = []
        self._last = np.zeros(0)

    def add(self, y: Array) -> None:
        """Add the next samples, (k,), k ≥ 1."""
        if not self.count:
            self.origin = float(y.mean())
        y = y - self.origin
        self._add_sums(y)
        self._add_segments(y)
        self._add_differences(y)
        self.count += y.size
        self.total += float(y.sum())

    def remarks(self, channel: str, source: str) -> tuple[str, ...]:
        """Return remarks on the rounding of the readings.

        Raises
        ------
        InputError
            The readings are rounded too coarsely.
        """
        return check_rounding([self._samples()], channel, source)

    def rounding_step(self) -> float:
        """Return the step to which the readings are rounded; 0 if none is detected."""
        return rounding_step(self._samples())

    def _samples(self) -> Array:
        """Return all samples of the series, or 2¹⁷ samples if the series is longer."""
        kept = spectrum.LONGEST if self._segments else self._filled
        return self._segment[:kept] + self.origin

    @property
    def mean(self) -> float:
        """Mean of all samples."""
        return self.origin + self.total / max(self.count, 1)

    def _add_sums(self, y: Array) -> None:
        # Numba takes a second to load, which is only worthwhile for a long series.
        from inercal.noise._kernels import squared_second_differences

        x = np.concatenate([self._tail, self._tail[-1] + np.cumsum(y)])
        old = self._tail.size
        firsts = np.maximum(old - 2 * _SHORT, 0)
        self._squares += squared_second_differences(x, _SHORT, np.ones_like(_SHORT), firsts)
        self._terms += np.maximum(x.size - 2 * _SHORT - firsts, 0)
        # x[old] is the cumulative sum number count + 1.
        skip = (-(self.count + 1)) % KEPT_EVERY
        self._kept.append(x[old + skip :: KEPT_EVERY].copy())
        self._tail = x[-(2 * FULL_OVERLAP) :].copy()

    def _add_segments(self, y: Array) -> None:
        start = 0
        while start < y.size:
            take = min(spectrum.LONGEST - self._filled, y.size - start)
            self._segment[self._filled : self._filled + take] = y[start : start + take]
            self._filled += take
            start += take
            if self._filled == spectrum.LONGEST:
                self._power += spectrum.squared_coefficients(self._segment)
                self._segments += 1
                self._filled = 0

    def _add_differences(self, y: Array) -> None:
        d = np.diff(np.concatenate([self._last, y])) ** 2
        self._last = y[-1:].copy()
        self._differences = np.concatenate([self._differences, d])
        if self._largest is not None or self._differences.size >= _FIRST:
            self._sum_differences()

    def _sum_differences(self) -> None:
        d = self._differences
        if self._largest is None:
            self._largest = clipping_level(d)
        used = d.size // self._half * self._half
        shown = np.minimum(d[:used], self._largest)
        self._half_sums.append(shown.reshape(-1, self._half).sum(axis=1))
        self._differences = d[used:].copy()

    def cumulative_sums(self) -> Array:
        """Return every 64th cumulative sum, beginning with the first."""
        self._kept = [np.concatenate(self._kept)]
        return self._kept[0]

    def oadev(self) -> Deviations:
        """Return the overlapping Allan deviation at octaves."""
        n, kept = self.count, self.cumulative_sums()
        factors = 2 ** np.arange(int(np.log2(n // 2)) + 1)
        factors = factors[(factors <= FULL_OVERLAP) | (2 * factors // KEPT_EVERY < kept.size)]
        variances: list[float] = []
        counts: list[int] = []
        alphas: list[int] = []
        for j, m in enumerate(map(int, factors)):
            if m <= FULL_OVERLAP:
                total, terms = float(self._squares[j]), int(self._terms[j])
            else:
                stride = stride_of(m) // KEPT_EVERY
                total, terms = sum_of_squared_differences(kept, m // KEPT_EVERY, ALLAN, stride)
            variances.append(total / (2.0 * terms * float(m) ** 2))
            counts.append(terms)
            alphas.append(identify_noise(kept, m // KEPT_EVERY) if m >= KEPT_EVERY else 0)
        return with_intervals("oadev", factors, np.array(variances), counts, alphas, n, self.dt)

    def low_values(self) -> tuple[Array, float]:
        """Return block means of all samples, at most 2¹⁷, and the time Δ between them, s."""
        if self.count <= spectrum.LONGEST:
            return self._segment[: self._filled], self.dt
        means = np.diff(self.cumulative_sums()) / KEPT_EVERY
        m = -(-means.size // spectrum.LONGEST)
        return spectrum.block_means(means, m), self.dt * KEPT_EVERY * m

    def spectra(self) -> tuple[Spectrum, ...]:
        """Return the spectra for low and high frequencies."""
        values, dt = self.low_values()
        low = spectrum.whole_spectrum(values, dt)
        if not self._segments or self.count <= spectrum.LONGEST:
            return (low,)
        found = spectrum.join_long(low, self._power / self._segments, self._segments, self.dt)
        if self._segments >= _MANY or self._filled < spectrum.LONGEST // 8:
            return found
        # If there are few segments, the samples after the last segment are a large share of all
        # samples.
        rest = spectrum.squared_coefficients(self._segment[: self._filled])
        return *found, spectrum.join_long(low, rest, 1, self.dt)[1]

    def disturbances(self) -> tuple[Disturbance, ...]:
        """Return steps, knocks and bursts; times of steps and knocks are rounded to 64 samples."""
        self._sum_differences()
        means = np.diff(self.cumulative_sums()) / KEPT_EVERY
        halves = np.concatenate(self._half_sums)
        bursts = bursts_of_windows(halves, self._half, self.dt, samples_per_degree(self._samples()))
        changes = find_changes(means, self.dt * KEPT_EVERY)
        apart = [
            one
            for one in changes
            if all(abs(one.time - burst.time) > 2 * WINDOW for burst in bursts)
        ]
        return tuple(sorted((*bursts, *apart), key=lambda one: one.time))
