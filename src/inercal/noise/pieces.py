"""Recordings with gaps: their pieces, and Allan deviations across gaps or joined from pieces.

For a deviation across the gaps, all samples are placed on one time grid with the sampling interval.
A difference between two means over m grid places is used if at least half of the places of each
mean have a sample::

    σ²(m Δ) = ½ mean of (mean of the later m − mean of the earlier m)²

The gaps are not filled. A mean over fewer samples contains more white noise, but with 20 gaps of 60
s the variance is still correct to 2 %. The equivalent degrees of freedom of the whole grid are
multiplied by the share of the differences that are used.

All pieces have a common sampling interval. If only a few single samples are lost, the neighbouring
samples are joined without a gap; this changes K by 1.5 % if 1 % of the samples are lost. Larger
gaps split the recording, and each piece has a separate likelihood, because interpolation over the
gaps would change N by 10 % and K by a third. If time stamps jitter by less than 0.3 Δ, the samples
are treated as evenly spaced. Otherwise they are averaged over blocks of equal time.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.basics.errors import InputError
from inercal.basics.units import format_count, format_duration
from inercal.noise.confidence import identify_noise, interval
from inercal.noise.deviations import (
    Deviations,
    Spacing,
    averaging_factors,
    cumulative_sum,
    stride_of,
    with_intervals,
)
from inercal.noise.spectrum import SHORTEST_PIECE
from inercal.recordings import Recording

FEWEST = 64  # smallest number of samples in a recording
FEW_LOST, LOST_SHARE = 2, 0.02  # largest gap in samples, and lost share, that are ignored
JITTER = 0.3  # largest robust standard deviation of time steps, in Δ
_IRREGULAR_BLOCK = 4  # length of a block of equal time, in median time steps


@dataclass(frozen=True, eq=False)
class Part:
    """Successive samples of one channel or of all channels, without gaps.

    Parameters
    ----------
    values : (n,) or (n, m) array
        Readings of one channel in SI units, or of all channels in their units.
    start : float
        Start time, s after the first sample of the recording.
    temperature : (n,) array or None
        Temperature of each sample, K.
    """

    values: Array
    start: float
    temperature: Array | None = None

    def __len__(self) -> int:
        return len(self.values)

    def slice_samples(self, first: int, stop: int, dt: float) -> "Part":
        """Return the samples first … stop − 1."""
        warmth = None if self.temperature is None else self.temperature[first:stop]
        return Part(self.values[first:stop], self.start + first * dt, warmth)


@dataclass(frozen=True, eq=False)
class Pieces:
    """Series without gaps, cut from one recording.

    Parameters
    ----------
    dt : float
        Sampling interval Δ, s.
    parts : tuple of Part
        The pieces, with the readings of all channels, (n_i, m).
    remarks : tuple of str
        Remarks on data that were skipped or excluded, and on gaps.
    """

    dt: float
    parts: tuple[Part, ...]
    remarks: tuple[str, ...]


def split_at_gaps(recording: Recording) -> Pieces:
    """Split a recording at its gaps.

    Raises
    ------
    InputError
        There are fewer than 64 samples, or no piece has 64 samples.
    """
    time = recording.time - recording.time[0]
    where = f"{recording.source or 'recording'}: "
    if time.size < FEWEST:
        raise InputError(
            f"{where}{format_count(time.size, 'sample')} cannot show the noise; record "
            f"{FEWEST} or more",
            file=recording.source or None,
        )
    steps = np.diff(time)
    dt = recording.median_step
    lost = np.rint(steps / dt).astype(np.int64) - 1
    plain = lost < 1
    spread = 1.4826 * float(np.median(np.abs(steps[plain] - np.median(steps[plain]))))
    if spread > JITTER * dt:
        return _equal_blocks(recording, time, dt)
    # A median of rounded time stamps would be wrong by as much as their rounding.
    dt = float(steps[plain].mean())
    gaps = np.flatnonzero(lost >= 1)
    few = gaps[lost[gaps] <= FEW_LOST]
    remarks: list[str] = []
    if few.size:
        total = int(lost[few].sum())
        share = total / (time.size + total)
        if share <= LOST_SHARE:
            remarks.append(
                f"{format_count(total, 'lost sample')} ({100 * share:.2g} %) in "
                f"{format_count(few.size, 'gap')} of at most {FEW_LOST} samples were skipped"
            )
            gaps = np.setdiff1d(gaps, few)
    bounds = np.concatenate([[0], gaps + 1, [time.size]])
    return _cut(recording, time, dt, bounds, remarks)


def _cut(
    recording: Recording, time: Array, dt: float, bounds: Indices, remarks: list[str]
) -> Pieces:
    spans = [(int(a), int(b)) for a, b in pairwise(bounds)]
    kept = [(a, b) for a, b in spans if b - a >= SHORTEST_PIECE]
    if len(spans) > 1:
        lost = float(sum(time[b] - time[b - 1] - dt for _, b in spans[:-1]))
        remarks.append(
            f"the recording has {format_count(len(spans) - 1, 'gap')} ({format_duration(lost)} in "
            f"total), so it was split into {len(kept)} pieces, each with its own likelihood; the "
            f"Allan deviation uses means of which at least half the samples exist"
        )
    if len(kept) < len(spans):
        left = sum(b - a for a, b in spans) - sum(b - a for a, b in kept)
        remarks.append(f"{left} samples in pieces shorter than {SHORTEST_PIECE} were excluded")
    if not kept or max(b - a for a, b in kept) < FEWEST:
        raise InputError(
            f"{recording.source or 'recording'}: no piece between gaps has {FEWEST} samples; "
            "record without gaps",
            file=recording.source or None,
        )
    warmth = recording.temperature
    parts = [
        Part(recording.data[a:b], float(time[a]), None if warmth is None else warmth[a:b])
        for a, b in kept
    ]
    return Pieces(dt, tuple(parts), tuple(remarks))


def _equal_blocks(recording: Recording, time: Array, dt: float) -> Pieces:
    """Average readings over blocks of equal time, because the time stamps jitter."""
    block = _IRREGULAR_BLOCK * dt
    number = np.floor(time / block).astype(np.int64)
    count = np.bincount(number)

    def means(values: Array) -> Array:
        return np.bincount(number, weights=values) / np.maximum(count, 1)

    data = np.stack([means(column) for column in recording.data.T], axis=1)
    temperature = None if recording.temperature is None else means(recording.temperature)
    filled = np.flatnonzero(count > 0)
    blocks = Recording(
        (filled * block).astype(np.float64),
        data[filled],
        recording.channels,
        recording.units,
        temperature=None if temperature is None else temperature[filled],
        source=recording.source,
    )
    remark = (
        f"the time stamps jitter by more than {JITTER:g} of the sampling interval, so samples "
        f"were averaged over blocks of {block:.4g} s"
    )
    gaps = np.flatnonzero(np.diff(filled) > 1)
    bounds = np.concatenate([[0], gaps + 1, [filled.size]])
    return _cut(blocks, blocks.time, block, bounds, [remark])


_FULL = 0.5  # share of a mean's grid places that must have a sample
_LARGEST_GRID = 4  # largest number of grid places per sample
_BLOCK = 1 << 18  # differences that are processed at a time
_PHASES = 2


def fits_grid(parts: Sequence[Part], dt: float) -> bool:
    """Return whether the grid has at most four times as many places as there are samples."""
    return _offsets(parts, dt)[-1] + len(parts[-1]) <= _LARGEST_GRID * sum(map(len, parts))


def _offsets(parts: Sequence[Part], dt: float) -> list[int]:
    """Return the grid place of the first sample of each piece; pieces do not overlap."""
    found: list[int] = []
    free = 0
    for one in parts:
        found.append(max(round((one.start - parts[0].start) / dt), free))
        free = found[-1] + len(one)
    return found


def gap_oadev(parts: Sequence[Part], dt: float, spacing: Spacing) -> Deviations:
    """Return the overlapping Allan deviation across the gaps between pieces.

    Parameters
    ----------
    parts : sequence of Part
        Pieces in time order.
    dt : float
        Sampling interval, s.
    spacing : "octave", "decade" or "all"
    """
    offsets = _offsets(parts, dt)
    n = offsets[-1] + len(parts[-1])
    mean = sum(float(one.values.sum()) for one in parts) / sum(map(len, parts))
    x, filled = np.zeros(n + 1), np.zeros(n + 1)
    for at, one in zip(offsets, parts, strict=True):
        x[at + 1 : at + 1 + len(one)] = one.values - mean
        filled[at + 1 : at + 1 + len(one)] = 1.0
    np.cumsum(x, out=x)
    np.cumsum(filled, out=filled)
    every = spacing == "all"
    candidates = averaging_factors(n, spacing, _PHASES).tolist()
    strides = {m: 1 if every else stride_of(m) for m in candidates}
    sums = {m: _masked_sum(x, filled, m, strides[m]) for m in candidates}
    factors = [m for m, (_, count, _) in sums.items() if count]
    totals, counts, possible = np.array([sums[m] for m in factors]).T
    # The noise type is only a label and is identified from the samples as if there were no gaps.
    closed = cumulative_sum(np.concatenate([one.values for one in parts]))
    alphas = [identify_noise(closed, m) for m in factors]
    found = with_intervals(
        "oadev",
        np.array(factors),
        totals / (2.0 * counts),
        counts.astype(int).tolist(),
        alphas,
        n,
        dt,
        np.array([strides[m] for m in factors]),
    )
    edf = np.maximum(found.edf * (counts / possible), 1.0)
    low, high = interval(found.value, edf)
    return replace(found, low=low, high=high, edf=edf)


def _masked_sum(x: Array, filled: Array, m: int, stride: int) -> tuple[float, int, int]:
    """Return Σ (mean − mean)² over the usable pairs, their number, and the number of all pairs."""
    starts: Indices = np.arange(0, x.size - 2 * m, stride)
    total, count = 0.0, 0
    for first in range(0, starts.size, _BLOCK):
        i = starts[first : first + _BLOCK]
        early, late = filled[i + m] - filled[i], filled[i + 2 * m] - filled[i + m]
        good = (early >= _FULL * m) & (late >= _FULL * m)
        i, early, late = i[good], early[good], late[good]
        change = (x[i + 2 * m] - x[i + m]) / late - (x[i + m] - x[i]) / early
        total += float(change @ change)
        count += i.size
    return total, count, starts.size


def join_deviations(tables: Sequence[Deviations]) -> Deviations:
    """Join the deviations of several pieces; each is weighted by its number of differences."""
    if len(tables) == 1:
        return tables[0]
    longest = max(tables, key=lambda one: one.tau.size)
    square = np.zeros(longest.tau.size)
    edf, count = np.zeros(longest.tau.size), np.zeros(longest.tau.size)
    for one in tables:
        k = one.tau.size
        square[:k] += one.count * one.value**2
        count[:k] += one.count
        edf[:k] += one.edf
    value = np.sqrt(square / count)
    low, high = interval(value, edf)
    return replace(longest, value=value, low=low, high=high, edf=edf, count=count)
