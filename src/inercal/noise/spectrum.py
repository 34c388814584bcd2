"""Binned squares of DCT-II coefficients of a recording with any length and gaps.

A series of up to 2¹⁷ block means is transformed at once. For a longer series, block means give the
low frequencies. Segments of at most as many samples, whose squares are averaged, give the higher
ones. Pieces between gaps are transformed separately and their likelihoods are added; gaps are not
bridged. For the orthonormal DCT-II c_k, k = 1 … n−1, of block means with the variogram γ, exactly::

    E c_k² = −(2/n) [Σ_h (n−h) γ(h) cos(πkh/n) − Σ_h γ(h) sin(πkh/n)/sin(πk/n)],  h = 1 … n−1

The first sum is a DCT-I, the second a DST-I. Coefficient k = 0, the bias, is omitted.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.noise.numerics import cosine_sums, dct2, sine_sums
from inercal.noise.output_filter import OutputFilter
from inercal.noise.terms import TERMS

Band = tuple[float, float]
"""Lowest and highest frequency of a band, Hz."""
LONGEST = 1 << 17  # values in one transform
SHORTEST_PIECE = 16
_SINGLE = 64  # coefficients that each form their own bin
_LOGARITHMIC = 160  # bins above these
_LEAKAGE, _STRONGEST = 1e-5, 0.9  # of the level that a tenth of the bins exceed
_FINE = 300  # smallest number of bins in a band where a filter bends the spectrum
_TIMES = 24  # values of T for a Gauss–Markov process
_BLOCK_SHARE = 0.1  # share of the block means' frequencies that are used if there are segments


@lru_cache(maxsize=64)  # up to 1 MB each
def expected_periodogram(symbol: str, n: int, dt: float, markov_time: float = 1.0) -> Array:
    """Return E c_k² of a term with a coefficient of 1, (n−1,), k = 1 … n−1.

    Parameters
    ----------
    symbol : str
        One of `TERMS`.
    n : int
        Number of block means.
    dt : float
        Sampling interval Δ, s.
    markov_time : float
        Time constant T of a Gauss–Markov process, s.
    """
    h = np.arange(1, n, dtype=np.float64)
    gamma = TERMS[symbol].variogram(h, dt, markov_time)
    # A line a + b h has closed-form sums; without it the transforms are more precise.
    slope = (gamma[-1] - gamma[0]) / max(n - 2, 1)
    constant = gamma[0] - slope
    gamma = gamma - (constant + slope * h)
    weighted = np.zeros(n + 1)
    weighted[1:n] = (n - h) * gamma
    cosines = cosine_sums(weighted)
    sines = sine_sums(gamma)
    expected = -(2 / n) * (cosines - sines / np.sin(np.pi * h / n))
    expected += constant + slope / (2 * np.sin(np.pi * h / (2 * n)) ** 2)
    expected.flags.writeable = False
    return expected


def squared_coefficients(y: Array) -> Array:
    """Return the squares of the orthonormal DCT-II coefficients k = 1 … n−1 of y, (..., n)."""
    return dct2(y - y.mean(axis=-1, keepdims=True))[..., 1:] ** 2


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Squared coefficients k = first … last−1 of block means.

    Parameters
    ----------
    n : int
        Number of values in each transform.
    dt : float
        Time Δ between the values, s.
    power : (n−1,) array
        Squares c_k², k = 1 … n−1, averaged over the segments.
    segments : int
    first, last : int
        Half-open range of the coefficients that are used.
    kept : (n−1,) array of bool
        False at the lines that were removed.
    """

    n: int
    dt: float
    power: Array
    segments: int
    first: int
    last: int
    kept: NDArray[np.bool_]


@lru_cache(maxsize=256)
def bin_edges(first: int, last: int, *, fine: bool = False) -> tuple[int, ...]:
    """Return the first coefficient of each bin from `first` to `last`, followed by `last`.

    Fine bins contain at most 1/300 of the coefficients.
    """
    single = np.arange(first, min(max(_SINGLE, first), last))
    edges = np.geomspace(max(_SINGLE, first), max(last, _SINGLE + 1), _LOGARITHMIC + 1)
    if fine and (wide := np.flatnonzero(np.diff(edges) > last / _FINE)).size:
        start = float(edges[wide[0]])
        edges = np.concatenate(
            [edges[edges < start], np.arange(start, float(last), last / _FINE, dtype=np.float64)]
        )
    edges = np.unique(np.round(edges).astype(np.int64))
    return tuple(int(k) for k in (*single, *edges[edges < last], last) if k <= last)


@lru_cache(maxsize=4096)
def binned_basis(
    symbol: str, n: int, dt: float, first: int, last: int, markov_time: float, *, fine: bool = False
) -> Array:
    """Return E c_k² of a term, averaged over each bin."""
    edges = np.array(bin_edges(first, last, fine=fine))
    expected = expected_periodogram(symbol, n, dt, markov_time)[first - 1 : last - 1]
    means = np.add.reduceat(expected, edges[:-1] - first) / np.diff(edges)
    means.flags.writeable = False
    return means


@dataclass(frozen=True, eq=False)
class FilterEffect:
    """The effect of the sensor's own filter on the bins.

    Parameters
    ----------
    output : OutputFilter
    response : (b,) array
        Power response |H|² averaged over each bin.
    known : (b,) array
        Part of S that is not fitted.
    nuisance : (b, k) array
        Additional columns of S with coefficients ≥ 0: dS/d ln f_c, and the read-out floor.
    start : (k,) array
        Coefficients of these columns for the filter that was found.
    """

    output: OutputFilter
    response: Array
    known: Array
    nuisance: Array
    start: Array


@dataclass(frozen=True, eq=False)
class Bins:
    """Bins of one or more spectra, which are independent of each other.

    Parameters
    ----------
    power, weight, frequency : (b,) array
        Mean of c_k², number of coefficients in it, and mean frequency, Hz.
    spectra : tuple of Spectrum
    dt : float
        Sampling interval Δ, s.
    used : array of bool
        Mask of those bins in all spectra that contain at least one kept coefficient.
    fine : bool
        Whether the bins are fine, as needed for a filter.
    effect : FilterEffect or None
        Effect of the sensor's own filter.
    limit : float
        Frequency, Hz, above which bins are excluded.
    """

    power: Array
    weight: Array
    frequency: Array
    spectra: tuple[Spectrum, ...]
    dt: float
    used: NDArray[np.bool_] = field(repr=False)
    fine: bool = False
    effect: FilterEffect | None = None
    limit: float = np.inf

    @property
    def output(self) -> OutputFilter | None:
        """The sensor's own filter, or None."""
        return None if self.effect is None else self.effect.output

    @cached_property
    def ends(self) -> tuple[Array, Array]:
        """Lowest and highest frequency of each bin, Hz, extended by half a coefficient."""
        low: list[Array] = []
        high: list[Array] = []
        for one in self.spectra:
            edges = (np.array(bin_edges(one.first, one.last, fine=self.fine)) - 0.5) / (
                2 * one.n * one.dt
            )
            low.append(edges[:-1])
            high.append(edges[1:])
        return np.concatenate(low)[self.used], np.concatenate(high)[self.used]

    def take(self, chosen: NDArray[np.bool_]) -> "Bins":
        """Return the chosen bins, without a filter."""
        used = self.used.copy()
        used[np.flatnonzero(self.used)[~chosen]] = False
        return replace(
            self,
            power=self.power[chosen],
            weight=self.weight[chosen],
            frequency=self.frequency[chosen],
            used=used,
            effect=None,
        )

    def below(self, frequency: float) -> "Bins":
        """Return the bins whose mean frequency is below the given one, Hz, without a filter."""
        return replace(self.take(self.frequency < frequency), limit=frequency)

    def strong_bins(self) -> "Bins":
        """Return the bins that are not covered by leakage from the strongest frequencies.

        If the last value of a series differs from its first, its spectrum leaks into other bins by
        about 10⁻⁶ of the power. This is visible far above the cut-off of a filter.
        """
        level = self.power / self.basis("N")
        return self.take(level > _LEAKAGE * np.quantile(level, _STRONGEST))

    def bins_of(self, spectra: Sequence[Spectrum]) -> "Bins":
        """Return the corresponding bins of other spectra of the same recording."""
        bins = make_bins(spectra, self.dt, fine=self.fine)
        like = bins.take(self.used[np.flatnonzero(bins.used)])
        return replace(like, effect=self.effect, limit=self.limit)

    @cached_property
    def times(self) -> Array:
        """Values of T to try for a Gauss–Markov process, s: from 10 samples to 1/10 of the data.

        In the recording, a shorter T looks like white noise, and a longer one like a random walk.
        """
        longest = max(one.n * one.dt for one in self.spectra)
        return np.geomspace(10 * self.dt, max(longest / 10, 20 * self.dt), _TIMES)

    def markov_basis(self, markov_time: float) -> Array:
        """Return E in each bin for a Gauss–Markov process with sd 1, (b,), interpolated in ln T.

        The interpolation is cubic through four of `times`, because a transform for each T would
        take most of the time of a fit.
        """
        grid = np.log(self.times)
        place = (np.log(markov_time) - grid[0]) / (grid[1] - grid[0])
        if not 0 <= place <= grid.size - 1:
            return self.basis("G", markov_time)
        first = int(np.clip(np.floor(place) - 1, 0, grid.size - 4))
        x = place - first
        weights = [
            -(x - 1) * (x - 2) * (x - 3) / 6,
            x * (x - 2) * (x - 3) / 2,
            -x * (x - 1) * (x - 3) / 2,
            x * (x - 1) * (x - 2) / 6,
        ]
        logs = sum(
            w * np.log(self.basis("G", float(self.times[first + k]))) for k, w in enumerate(weights)
        )
        return np.exp(logs)

    def basis(self, symbol: str, markov_time: float = 1.0) -> Array:
        """Return E in each bin for a term with a coefficient of 1, (b,)."""
        parts = [
            binned_basis(symbol, one.n, one.dt, one.first, one.last, markov_time, fine=self.fine)
            for one in self.spectra
        ]
        expected = np.concatenate(parts)[self.used]
        if self.effect is None or symbol == "Q":  # Q is added after the filter by the read-out
            return expected
        return expected * self.effect.response


def make_bins(spectra: Sequence[Spectrum], dt: float, *, fine: bool = False) -> Bins:
    """Return the bins of spectra, without those that contain no kept coefficient."""
    power: list[Array] = []
    weight: list[Array] = []
    frequency: list[Array] = []
    for one in spectra:
        edges = np.array(bin_edges(one.first, one.last, fine=fine))
        part = slice(one.first - 1, one.last - 1)
        kept = one.kept[part].astype(np.float64)
        starts = edges[:-1] - one.first
        count = np.add.reduceat(kept, starts)
        total = np.add.reduceat(one.power[part] * kept, starts)
        power.append(total / np.maximum(count, 1))
        weight.append(count * one.segments)
        frequency.append((edges[:-1] + edges[1:] - 1) / 2 / (2 * one.n * one.dt))
    weights = np.concatenate(weight)
    used = weights > 0
    return Bins(
        np.concatenate(power)[used],
        weights[used],
        np.concatenate(frequency)[used],
        tuple(spectra),
        dt,
        used,
        fine,
    )


def remove_band(spectrum: Spectrum, bands: Sequence[Band]) -> Spectrum:
    """Return a spectrum without the coefficients in some frequency bands."""
    frequency = np.arange(1, spectrum.n) / (2 * spectrum.n * spectrum.dt)
    kept = spectrum.kept.copy()
    for low, high in bands:
        kept &= (frequency < low) | (frequency > high)
    return replace(spectrum, kept=kept) if bands else spectrum


def whole_spectrum(y: Array, dt: float) -> Spectrum:
    """Return the spectrum of up to 2¹⁷ values, (n,)."""
    n = y.size
    return Spectrum(n, dt, squared_coefficients(y), 1, 1, n, np.ones(n - 1, dtype=bool))


def block_means(y: Array, m: int) -> Array:
    """Return the means of m values each; omit the remaining values."""
    count = y.size // m
    return y[: count * m].reshape(count, m).mean(axis=1)


def piece_spectra(y: Array, dt: float) -> tuple[Spectrum, ...]:
    """Return the spectra of one piece without gaps, (n,), n ≥ 16."""
    if y.size <= LONGEST:
        return (whole_spectrum(y, dt),)
    m = -(-y.size // LONGEST)
    blocks = whole_spectrum(block_means(y, m), dt * m)
    size = y.size // m  # chosen so that few samples remain unused
    power = np.zeros(size - 1)
    for one in y[: m * size].reshape(m, size):
        power += squared_coefficients(one)
    return join_long(blocks, power / m, m, dt)


def join_long(blocks: Spectrum, power: Array, segments: int, dt: float) -> tuple[Spectrum, ...]:
    """Combine two spectra: block means for low frequencies, and segments for the others.

    Parameters
    ----------
    blocks : Spectrum
        Spectrum of the block means of the series.
    power : (n − 1,) array
        Squared coefficients of segments of n values, averaged over the segments.
    segments : int
    dt : float
        Sampling interval in the segments, s.
    """
    limit = int(_BLOCK_SHARE * blocks.n)
    frequency = limit / (2 * blocks.n * blocks.dt)
    n = power.size + 1
    first = int(np.ceil(frequency * 2 * n * dt))
    kept = np.ones(n - 1, dtype=bool)
    high = Spectrum(n, dt, power, segments, max(first, 1), n, kept)
    return replace(blocks, last=limit), high
