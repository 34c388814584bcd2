"""Squared DCT-II coefficients of a recording, in bins; for any length, and with gaps.

A series of up to 2¹⁷ values is transformed at once. For a longer series, block means give the low
frequencies. The higher frequencies come from segments of at most 2¹⁷ samples; the squares of all
segments are averaged. Pieces between gaps are transformed separately, and their likelihoods are
added; gaps are not bridged. The orthonormal DCT-II coefficients c_k, k = 1 … n−1, of block means
with the variogram γ have exactly the expectation::

    E c_k² = −(2/n) [Σ_h (n−h) γ(h) cos(πkh/n) − Σ_h γ(h) sin(πkh/n)/sin(πk/n)],  h = 1 … n−1

The first sum is a DCT-I, and the second is a DST-I. Coefficient k = 0 is the bias and is omitted.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np

from inercal.basics.arrays import Array, Bools
from inercal.basics.errors import InputError
from inercal.noise.numerics import cosine_sums, dct2, sine_sums
from inercal.noise.output_filter import OutputFilter
from inercal.noise.terms import TERMS

Band = tuple[float, float]
"""Lowest and highest frequency of a band, Hz."""
LONGEST = 1 << 17  # largest number of values in one transform
SHORTEST_PIECE = 16
_SINGLE = 64  # the first coefficients each have a separate bin
_LOGARITHMIC = 160  # number of bins above them, with logarithmic spacing
_LEAKAGE, _STRONGEST = 1e-5, 0.9  # fractions of the level that a tenth of the bins exceed
_FINE = 300  # fine bins contain at most 1/300 of the coefficients
_TIMES = 24  # values of T for a Gauss–Markov process
_BLOCK_SHARE = 0.1  # share of the block means' frequencies used next to segments


@lru_cache(maxsize=64)  # each entry takes up to 1 MB
def expected_periodogram(symbol: str, n: int, dt: float, markov_time: float = 1.0) -> Array:
    """Return the expected c_k² for k = 1 … n−1, (n−1,), of a term with a coefficient of 1.

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
    # A line a + b h has closed-form sums. It is subtracted because the transforms are then more
    # precise.
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
    """Squared coefficients of block means, of which k = first … last − 1 are used.

    Parameters
    ----------
    n : int
        Number of values in each transform.
    dt : float
        Time Δ between successive values, s.
    power : (n−1,) array
        Squares c_k², k = 1 … n−1, averaged over the segments.
    segments : int
    first, last : int
        Half-open range of the coefficients that are used.
    kept : (n−1,) array of bool
        Mask that is false at the lines that were removed.
    """

    n: int
    dt: float
    power: Array
    segments: int
    first: int
    last: int
    kept: Bools


@lru_cache(maxsize=256)
def bin_edges(first: int, last: int, *, fine: bool = False) -> tuple[int, ...]:
    """Return the first coefficient of each bin between two coefficients, followed by the last.

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
    """Return the expected c_k² of a term, averaged over each bin."""
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
        Known part of S, which is not fitted.
    nuisance : (b, k) array
        Additional columns of S for dS/d ln f_c and the read-out floor; their coefficients are ≥ 0.
    start : (k,) array
        Coefficients of the additional columns for the filter that was found.
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
        Mean of c_k² in each bin, number of coefficients, and mean frequency, Hz.
    spectra : tuple of Spectrum
    dt : float
        Sampling interval Δ, s.
    used : array of bool
        Mask of the bins in all spectra; true if a bin contains at least one coefficient that is
        kept.
    fine : bool
        Whether the bins are fine, which is necessary for a filter.
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
    used: Bools = field(repr=False)
    fine: bool = False
    effect: FilterEffect | None = None
    limit: float = np.inf

    @property
    def output(self) -> OutputFilter | None:
        """The sensor's own filter; None if the bins are not filtered."""
        return None if self.effect is None else self.effect.output

    @cached_property
    def ends(self) -> tuple[Array, Array]:
        """Lowest and highest frequency of each bin, Hz, extended by half a coefficient."""
        edges = [
            (np.array(bin_edges(one.first, one.last, fine=self.fine)) - 0.5) / (2 * one.n * one.dt)
            for one in self.spectra
        ]
        low, high = ([one[:-1] for one in edges], [one[1:] for one in edges])
        return np.concatenate(low)[self.used], np.concatenate(high)[self.used]

    def take(self, chosen: Bools) -> "Bins":
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
        """Return the bins with a mean frequency below a given frequency, Hz, without a filter."""
        return replace(self.take(self.frequency < frequency), limit=frequency)

    def strong_bins(self) -> "Bins":
        """Return the bins in which leakage from the strongest frequencies does not dominate.

        If the last value of a series differs from the first, about 10⁻⁶ of the power leaks into
        other bins. Far above the cut-off of a filter, this leakage is visible.
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

        A process with a shorter T would look like white noise, and a process with a longer T like a
        random walk.
        """
        longest = max(one.n * one.dt for one in self.spectra)
        return np.geomspace(10 * self.dt, max(longest / 10, 20 * self.dt), _TIMES)

    def markov_basis(self, markov_time: float) -> Array:
        """Return the expected c_k² in each bin, (b,), for a Gauss–Markov process with sd 1.

        The values are interpolated in ln T, by a cubic through four of `times`, because a transform
        for each T would take most of the time of a fit.
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
        """Return the expected c_k² in each bin, (b,), for a term with a coefficient of 1."""
        parts = [
            binned_basis(symbol, one.n, one.dt, one.first, one.last, markov_time, fine=self.fine)
            for one in self.spectra
        ]
        expected = np.concatenate(parts)[self.used]
        if self.effect is None or symbol == "Q":  # the read-out adds Q after the filter
            return expected
        return expected * self.effect.response


def make_bins(spectra: Sequence[Spectrum], dt: float, *, fine: bool = False) -> Bins:
    """Return the bins of spectra, without bins that contain no kept coefficient."""
    parts: list[tuple[Array, Array, Array]] = []
    for one in spectra:
        edges = np.array(bin_edges(one.first, one.last, fine=fine))
        part = slice(one.first - 1, one.last - 1)
        kept = one.kept[part].astype(np.float64)
        starts = edges[:-1] - one.first
        count = np.add.reduceat(kept, starts)
        total = np.add.reduceat(one.power[part] * kept, starts)
        middle = (edges[:-1] + edges[1:] - 1) / 2 / (2 * one.n * one.dt)
        parts.append((total / np.maximum(count, 1), count * one.segments, middle))
    power, weight, frequency = (np.concatenate(column) for column in zip(*parts, strict=True))
    used = weight > 0
    return Bins(power[used], weight[used], frequency[used], tuple(spectra), dt, used, fine)


def require_bands(bands: Sequence[Band], dt: float) -> None:
    """Raise an error if a band is above half the sampling rate, where nothing can be excluded."""
    for low, high in bands:
        if low * dt >= 0.5:
            raise InputError(
                f"--skip-band {low:g}-{high:g}: the recording has no frequency above "
                f"{0.5 / dt:.5g} Hz, half its sampling rate; exclude a band below it",
                key="--skip-band",
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
    """Return the means of blocks of m values; values after the last full block are omitted."""
    count = y.size // m
    return y[: count * m].reshape(count, m).mean(axis=1)


def piece_spectra(y: Array, dt: float) -> tuple[Spectrum, ...]:
    """Return the spectra of one piece without gaps, (n,), n ≥ 16."""
    if y.size <= LONGEST:
        return (whole_spectrum(y, dt),)
    m = -(-y.size // LONGEST)
    blocks = whole_spectrum(block_means(y, m), dt * m)
    size = y.size // m  # with this size, few samples remain unused
    power = np.zeros(size - 1)
    for one in y[: m * size].reshape(m, size):
        power += squared_coefficients(one)
    return join_long(blocks, power / m, m, dt)


def join_long(blocks: Spectrum, power: Array, segments: int, dt: float) -> tuple[Spectrum, ...]:
    """Combine two spectra: block means for low frequencies, and segments for high frequencies.

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
