"""Compute the Allan deviation of a recording with gaps, across the gaps or piece by piece.

All samples are placed on one time grid with the sampling interval. A difference between two means
over m grid places is used if at least half of the places of each mean have a sample::

    σ²(m Δ) = ½ mean of (mean of the later m − mean of the earlier m)²

The gaps are not filled. A mean over fewer samples contains more white noise, but with 20 gaps of 60
s the variance is still correct to 2 %. The equivalent degrees of freedom of the whole grid are
multiplied by the share of the differences that are used.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.noise.confidence import identify_noise, interval
from inercal.noise.deviations import (
    Deviations,
    Spacing,
    averaging_factors,
    cumulative_sum,
    stride_of,
    with_intervals,
)
from inercal.noise.pieces import Part

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
    factors: list[int] = []
    squares: list[float] = []
    counts: list[int] = []
    shares: list[float] = []
    every = spacing == "all"
    candidates = averaging_factors(n, spacing, _PHASES).tolist()
    strides = {m: 1 if every else stride_of(m) for m in candidates}
    for m in candidates:
        total, count, possible = _masked_sum(x, filled, m, strides[m])
        if count:
            factors.append(m)
            squares.append(total / (2.0 * count))
            counts.append(count)
            shares.append(count / possible)
    # The noise type is only a label and is identified from the samples as if there were no gaps.
    closed = cumulative_sum(np.concatenate([one.values for one in parts]))
    alphas = [identify_noise(closed, m) for m in factors]
    found = with_intervals(
        "oadev",
        np.array(factors),
        np.array(squares),
        counts,
        alphas,
        n,
        dt,
        np.array([strides[m] for m in factors]),
    )
    edf = np.maximum(found.edf * np.array(shares), 1.0)
    low, high = interval(found.value, edf)
    return replace(found, low=low, high=high, edf=edf)


def _masked_sum(x: Array, filled: Array, m: int, stride: int) -> tuple[float, int, int]:
    """Return Σ (mean − mean)² over the usable pairs, their number, and the number of all pairs."""
    starts: NDArray[np.int64] = np.arange(0, x.size - 2 * m, stride)
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
