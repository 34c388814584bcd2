"""Rounding errors in the means of quantised readings, which more samples do not average out.

A reading is q·round(x/q), where x is μ plus noise with the standard deviation σ = s q. If the noise
is more than half a step, rounding averages out. With less noise, the mean has an error that depends
on the position of μ between two steps. Over all positions its variance is

    β² = q²/(2π²) Σ_j exp(−4π²j²s²)/j²,      q²/12 without noise

and the variance of the samples is v = σ² + q²/12 − β². Means whose true values differ by much less
than a step have the same position between two steps and therefore the same error. This applies to
gyros at rest in any attitude. Accelerometers in different attitudes have independent errors.

Only a lower bound is known for the noise of such readings. On a grid of s, the likelihood of the
counts at each level, with a separate μ for each rest, is

    P(level l) = Φ((l + ½ − μ)/s) − Φ((l − ½ − μ)/s)

and the bound is the smallest s with 2Δ ln L ≤ 4, minus one grid step. The scatter of the rests'
means must not be used instead: if they share a position between two steps, it reflects that
position and not the noise.

Sources: Widrow and Kollár, Quantization Noise, Cambridge 2008 (the characteristic function of
rounded readings); GUM F.2.2.1 for q²/12.
"""

# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Bools, Indices

_ORDERS = np.arange(1, 400)
_GRID = 0.02  # step in s
_LARGEST = 0.8  # s at which the error of a mean is below 1e-6 of a step
_LIKELY = 4.0  # 2Δ ln L at the bound
_SECTIONS = 40  # most sections to which the noise is fitted
_WIDEST = 32  # most levels in a section; the noise on the grid spans 8
_GOLDEN, _ROUNDS = (5**0.5 - 1) / 2, 24  # steps in the search for μ, down to 1e-5 of its range
_SAME = 1e-7  # fraction of the span: closer values count as one value
_SIMILAR = 1.5  # multiple of the smallest gap: gaps of one step in text with few digits
_PARTS = (1, 2, 3, 4)  # the step may be this fraction of the usual gap
_OFF, _OFF_BY_TEXT, _LARGEST_OFF = 0.02, 0.35, 0.2  # of the step, and of the last digit
_MOST_DIGITS = 9  # number of decimals that are tried
_CLOSE = 12  # number of adjacent levels for which steps are counted from one to the next


def mean_rounding_variance(noise: float) -> float:
    """Return β²/q², the relative variance of a mean's rounding error, as a function of s = σ/q."""
    return float(
        np.sum(np.exp(-((2 * np.pi * noise * _ORDERS) ** 2)) / _ORDERS**2) / (2 * np.pi**2)
    )


def last_digit(values: Array) -> float:
    """Return the unit of the last decimal place of the values, (...), or 0 if below 1e-9."""
    size = float(np.abs(values).max(initial=0.0))
    for digits in range(_MOST_DIGITS + 1):
        scaled = values * 10.0**digits
        if np.all(np.abs(scaled - np.rint(scaled)) <= 4e-16 * size * 10.0**digits + 1e-12):
            return 10.0**-digits
    return 0.0


class Ladder(NamedTuple):
    """Equally spaced levels of readings, a + k q.

    Parameters
    ----------
    step, first : float
        Step q and first level a, in the unit of the readings.
    off : float
        RMS deviation of the readings from the levels, caused by the number of written digits.
    """

    step: float
    first: float
    off: float

    def indices(self, readings: Array) -> Indices:
        """Return the level index k of each reading."""
        return np.rint((readings - self.first) / self.step).astype(np.int64)


def rounding_ladder(levels: Array) -> Ladder | None:
    """Return the equally spaced levels of rounded readings, or None if there is no common step.

    The values need not be exact multiples: a step of .02 °/s written in rad/s with four decimals
    has gaps of three and four units in the last place.

    Parameters
    ----------
    levels : (n,) array
        The distinct values of a channel, sorted.
    """
    if levels.size < 2:
        return None
    gaps = np.diff(levels)
    levels = levels[np.concatenate([[True], gaps > _SAME * (levels[-1] - levels[0])])]
    gaps = np.diff(levels)
    if not gaps.size:
        return None
    digit = last_digit(levels)
    small = gaps[gaps <= _SIMILAR * float(np.quantile(gaps, 0.05))]
    usual = float(small.mean())
    for part in _PARTS:
        found = _fitted_ladder(levels, usual / part, digit)
        if found is not None:
            return found
    return None


def _fitted_ladder(levels: Array, step: float, digit: float) -> Ladder | None:
    """Return the least-squares ladder for the levels, or None if the fit is not good enough.

    The fit starts where levels are closest together and doubles its range each time, because a
    roughly known step predicts only nearby levels.
    """
    few = min(_CLOSE, levels.size)
    densest = int(np.argmin(levels[few - 1 :] - levels[: levels.size - few + 1]))
    start, stop = densest, densest + few
    near = levels[start:stop]
    place = np.concatenate([[0.0], np.cumsum(np.rint(np.diff(near) / step))])
    while True:
        about = place - place.mean()
        length = float(about @ about)
        step = float(about @ near) / length if length else 0.0
        if not step > 0:
            return None
        first = float(near.mean() - step * place.mean())
        if near.size == levels.size:
            break
        reach = near[-1] - near[0]
        wider = np.searchsorted(levels, [near[0] - 0.5 * reach, near[-1] + 0.5 * reach]).tolist()
        if wider == [start, stop]:  # no more levels nearby
            wider = [max(start - 1, 0), min(stop + 1, levels.size)]
        start, stop = wider
        near = levels[start:stop]
        place = np.rint((near - first) / step)
    off = float(np.sqrt(np.mean((levels - first - step * place) ** 2)))
    allowed = max(_OFF * step, min(_OFF_BY_TEXT * digit, _LARGEST_OFF * step))
    return Ladder(step, first, off) if off <= allowed else None


def noise_lower_bound(sections: Sequence[Indices]) -> float:
    """Return a lower bound for s = σ/q from the readings within sections.

    Parameters
    ----------
    sections : sequence of (n,) arrays of int
        Level of each sample, in steps; each section has its own true value.
    """
    chosen = sections[:: max(1, -(-len(sections) // _SECTIONS))]
    # A section that spans many levels is moving, or its noise is beyond the grid.
    chosen = [one for one in chosen if int(one.max()) - int(one.min()) < _WIDEST]
    if not chosen:
        return _LARGEST
    lows = np.array([int(one.min()) for one in chosen])
    width = max(int(one.max()) - low for one, low in zip(chosen, lows.tolist(), strict=True)) + 1
    counts = np.stack(
        [np.bincount(one - low, minlength=width) for one, low in zip(chosen, lows, strict=True)]
    )
    grid = np.arange(_GRID, _LARGEST + _GRID / 2, _GRID)
    likelihood = _profile(counts.astype(np.float64), grid)
    near = np.flatnonzero(2 * (likelihood.max() - likelihood) <= _LIKELY)
    return float(grid[near[0]] - _GRID)


def _profile(counts: Array, grid: Array) -> Array:
    """Return ln L at each s on a grid, with the best μ for each section; it is concave in μ.

    Parameters
    ----------
    counts : (r, k) array
        Number of samples at each of k adjacent levels, starting at 0.
    grid : (g,) array
    """
    from scipy.special import log_ndtr  # imported here because checking a run file does not need it

    level: Array = np.arange(counts.shape[1], dtype=np.float64)

    def value(mu: Array) -> Array:
        low: Array = (level - 0.5 - mu[..., None]) / grid[:, None]
        high: Array = low + 1 / grid[:, None]
        flip = low > 0  # upper-tail probabilities lose no digits
        ends: Array = np.stack([np.where(flip, -low, high), np.where(flip, -high, low)])
        upper, lower = np.asarray(log_ndtr(ends), dtype=np.float64)
        log: Array = upper + np.log1p(-np.exp(np.minimum(lower - upper, -1e-300)))
        return np.sum(np.where(counts[:, None] > 0, counts[:, None] * log, 0.0), axis=-1)

    shape = (len(counts), grid.size)
    filled = counts > 0
    first = filled.argmax(axis=1) - 0.5
    last = counts.shape[1] - filled[:, ::-1].argmax(axis=1) - 0.5
    left = np.broadcast_to(first[:, None], shape).copy()
    right = np.broadcast_to(last[:, None], shape).copy()
    a, b = right - _GOLDEN * (right - left), left + _GOLDEN * (right - left)
    at_a, at_b = value(a), value(b)
    for _ in range(_ROUNDS):
        less: Bools = at_a < at_b
        left, right = np.where(less, a, left), np.where(less, right, b)
        a, b = right - _GOLDEN * (right - left), left + _GOLDEN * (right - left)
        at_a, at_b = value(a), value(b)
    return np.maximum(at_a, at_b).sum(axis=0)
