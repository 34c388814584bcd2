"""Find what is not noise in a recording at rest: steps, knocks, bursts and spectral lines.

(a) A step at time t changes the mean. The difference |mean after − mean before| over averaging
times of 1 to 128 s is compared with its scatter √2 σ(τ). This scatter is estimated robustly from
the median of all differences. (b) A burst increases the variance of the differences between
neighbouring samples in windows of 10 s. Both limits were chosen from simulations of undisturbed
recordings with white noise, flicker and random walk.

Lines (vibration, mains hum) are removed before the terms are fitted. The level of the spectrum at k
is the running median of c_k² divided by 0.455, the median of χ²₁. A coefficient belongs to a line
if c_k² divided by this level exceeds the χ²₁ quantile for the probability .0001/n. The window of
the median becomes wider with k: at high k, a narrow window would scatter, and at low k, a wide
window would not follow the spectrum of drift. A line includes two neighbours on each side, and a
strong line includes all coefficients that its leakage reaches. If the squares of several segments
are averaged, χ² has as many degrees of freedom as there are segments.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from inercal.basics.arrays import Array
from inercal.noise.numerics import chi_squared_above
from inercal.noise.spectrum import Spectrum, block_means

CHANGE_LIMIT = 6.0  # √2 σ(τ), for steps and knocks
BURST_LEVEL = 0.00003  # nominal probability per channel; the actual tail is heavier than χ²
WINDOW = 10.0  # s, for bursts
_LONGEST = 128.0  # s, over which means are compared
_SHORTEST = 1.0  # s
_MOST = 20  # largest number of disturbances in one channel
_CHI_SQUARED_MEDIAN = 0.455
_LARGEST_DIFFERENCE = 20.0  # times the usual square; larger squares are clipped in a window
_MEDIAN = 0.67449  # median absolute value of a normal deviate
_NO_SIZE = 0.1  # fraction of the detected change; smaller sizes are left over from a removal
_FEWEST = 8  # a scatter is only known if the recording is this many averaging times long
_MOST_SAMPLES = 1 << 20
_CORRELATED_SAMPLES, _CORRELATED_LAGS = 1 << 15, 64
_CORRELATED = 1.2  # times the white-noise samples per degree, above which samples are correlated
_WHITE_DIFFERENCES = 1.5  # samples per degree of freedom, for differences of white noise


@dataclass(frozen=True)
class Disturbance:
    """A step, a knock or a burst in one channel.

    Parameters
    ----------
    kind : "step", "knock" or "burst"
    time : float
        Start time, s after the first sample.
    seconds : float
        Duration, s; infinite for a step.
    size : float
        For a step or knock, the change of the mean in the unit of the series. For a burst, the
        standard deviation of its samples divided by the standard deviation of the recording.
    score : float
        Test statistic divided by its limit.
    """

    kind: Literal["step", "knock", "burst"]
    time: float
    seconds: float
    size: float
    score: float

    def shifted(self, seconds: float) -> "Disturbance":
        """Return the disturbance with `seconds` added to its time."""
        return replace(self, time=self.time + seconds)


def find_disturbances(y: Array, dt: float) -> tuple[Disturbance, ...]:
    """Return the disturbances in one channel without gaps, (n,), in time order.

    Parameters
    ----------
    y : (n,) array
        Samples in any unit.
    dt : float
        Sampling interval, s.
    """
    bursts = find_bursts(y, dt)
    changes = find_changes(_without_bursts(y, dt, bursts), dt)
    return tuple(sorted((*bursts, *changes), key=lambda one: one.time))


def _without_bursts(y: Array, dt: float, bursts: list[Disturbance]) -> Array:
    """Replace each burst by a straight line, because a burst would also look like knocks."""
    if not bursts:
        return y
    work = y.astype(np.float64, copy=True)
    around = max(1, round(WINDOW / dt))
    for one in bursts:
        start = max(round(one.time / dt) - around // 4, 0)
        stop = min(round((one.time + one.seconds) / dt) + around // 4 + 1, y.size)
        before, after = y[max(start - around, 0) : start], y[stop : stop + around]
        ends = [part.mean() if part.size else np.nan for part in (before, after)]
        first, last = np.where(np.isfinite(ends), ends, np.nanmean(ends))
        work[start:stop] = np.linspace(first, last, stop - start)
    return work


def mean_changes(y: Array, dt: float) -> list[tuple[int, Array, float]]:
    """Return factors m, each with the differences of means at each sample, and their scatter.

    The difference at i is mean(y[i : i+m]) − mean(y[i−m : i]), and 0 within m of both ends. If
    there is no scatter, it is returned as infinity.
    """
    low = max(1, round(_SHORTEST / dt))
    factors = [low]
    while factors[-1] * 2 * dt <= _LONGEST:
        factors.append(factors[-1] * 2)
    factors = [m for m in factors if y.size >= _FEWEST * m]
    x = np.concatenate([[0.0], np.cumsum(y - y.mean())])
    found: list[tuple[int, Array, float]] = []
    for m in factors:
        change = np.zeros(y.size)
        change[m : y.size - m + 1] = (x[2 * m :] - 2 * x[m:-m] + x[: -2 * m]) / m
        scale = float(np.median(np.abs(change[m : y.size - m + 1]))) / _MEDIAN
        found.append((m, change, scale if scale > 0 else np.inf))
    return found


def find_changes(y: Array, dt: float) -> list[Disturbance]:
    """Return the steps and knocks in a channel."""
    m = -(-y.size // _MOST_SAMPLES)
    if m > 1:
        y, dt = block_means(y, m), dt * m
    found: list[Disturbance] = []
    removed: set[tuple[int, int]] = set()
    work = y.astype(np.float64, copy=True)
    for _ in range(_MOST):
        changes = mean_changes(work, dt)
        if not changes:
            break
        # Extremes are compared first, because arrays of scores would need as much memory as all
        # changes.
        scores = [max(float(one.max()), -float(one.min())) / scatter for _, one, scatter in changes]
        best = int(np.argmax(scores))
        if scores[best] <= CHANGE_LIMIT:
            break
        one, start, stop, size = _describe(work, dt, *changes[best])
        if (start, stop) in removed:  # this change was already removed, and a rest remains
            break
        work[start:stop] -= size
        removed.add((start, stop))
        if abs(one.size) > _NO_SIZE * float(np.abs(changes[best][1]).max()):
            found.append(one)
    return found


def _describe(
    y: Array, dt: float, m: int, change: Array, scatter: float
) -> tuple[Disturbance, int, int, float]:
    """Describe the largest change, and return the samples and the value to subtract from them.

    The change is a knock if the mean returns: within 128 s, there is an opposite change that is at
    least half as large. The two changes are compared at the averaging time m that shows them best.
    """
    peak = int(np.argmax(np.abs(change)))
    k = _change_place(y, peak, m)
    score = abs(float(change[peak])) / scatter / CHANGE_LIMIT
    # Near an end of the recording, fewer than m samples are available for a mean.
    size = float(y[k : k + m].mean() - y[max(k - m, 0) : k].mean())
    reach = round(_LONGEST / dt)
    low, high = max(k - reach, 0), min(k + reach + 1, y.size)
    opposite = -np.sign(size) * change[low:high]
    j = low + int(np.argmax(opposite))
    back = float(opposite[j - low])
    weak = abs(float(change[j])) / scatter < 0.6 * CHANGE_LIMIT
    if back < 0.5 * abs(size) or abs(j - k) < 1 or weak:
        return Disturbance("step", k * dt, np.inf, size, score), k, y.size, size
    start, stop = min(k, j), max(k, j)
    level = size if start == k else -size
    inside = y[start:stop]
    around = np.concatenate([y[max(start - reach, 0) : start], y[stop : stop + reach]])
    level = float(inside.mean() - around.mean()) if around.size else level
    if abs(level) < 0.1 * abs(size):  # the two changes do not belong to one knock
        return Disturbance("step", k * dt, np.inf, size, score), k, y.size, size
    one = Disturbance("knock", start * dt, (stop - start) * dt, level, score)
    return one, start, stop, level


def _change_place(y: Array, k: int, m: int) -> int:
    """Return the sample near k ± m/2 that best divides samples k − m … k + m into two levels.

    A change that is less than m from an end of the recording appears largest at the distance m from
    this end. The search therefore extends to the end.
    """
    start, stop = max(k - m, 0), min(k + m, y.size)
    z = y[start:stop] - y[start:stop].mean()
    before = np.arange(1, z.size, dtype=np.int64)
    gain: Array = np.cumsum(z)[:-1] ** 2 / (before * (z.size - before))
    first = start if k <= m else k - m // 2
    last = stop if k >= y.size - m else k + m // 2
    near = (before + start >= first) & (before + start <= last)
    return start + int(before[near][np.argmax(gain[near])]) if near.any() else k


def window_variances(y: Array, dt: float) -> tuple[Array, int]:
    """Return the variance of differences in windows of 10 s, (w,), and the samples per window.

    Neighbouring windows overlap by half.
    """
    size = max(2, round(WINDOW / dt))
    d = np.diff(y) ** 2
    d = np.minimum(d, clipping_level(d))
    half = max(1, size // 2)
    count = d.size // half
    if count < 2:
        return np.zeros(0), size
    halves = d[: count * half].reshape(count, half).sum(axis=1)
    return (halves[:-1] + halves[1:]) / (2 * half), 2 * half


def clipping_level(d: Array) -> float:
    """Return the limit at which squared differences between neighbours are clipped.

    A step or a knock produces only one or two larger differences. Clipping prevents them from
    looking like a burst.
    """
    return _LARGEST_DIFFERENCE * float(np.median(d)) / _CHI_SQUARED_MEDIAN


def find_bursts(y: Array, dt: float) -> list[Disturbance]:
    """Return the bursts in a channel, which are groups of windows with too large a variance."""
    variances, size = window_variances(y, dt)
    step = size // 2
    found: list[Disturbance] = []
    for first, last, ratio, limit in _loud_windows(variances, size / samples_per_degree(y)):
        start, stop = _extent(y, first * step, (last + 2) * step, size, ratio)
        found.append(_burst(start, stop, dt, ratio, limit))
    return found[:_MOST]


def samples_per_degree(y: Array) -> float:
    """Return the number of samples for each degree of freedom of a variance of differences.

    The number is 1 + 2 Σ r², where r is the autocorrelation of the differences. White noise gives
    1.5, and a low-pass filter increases it.
    """
    d = np.diff(y[:_CORRELATED_SAMPLES])
    largest = np.sqrt(clipping_level(d**2))
    d = np.clip(d, -largest, largest)
    power = float(d @ d)
    if power == 0:
        return _WHITE_DIFFERENCES
    lags = [k for k in range(1, _CORRELATED_LAGS + 1) if 4 * k < d.size]
    squares = [(float(d[k:] @ d[:-k]) / power) ** 2 - 1 / d.size for k in lags]
    found = 1 + 2 * float(np.sum(squares))
    return found if found > _CORRELATED * _WHITE_DIFFERENCES else _WHITE_DIFFERENCES


def bursts_of_windows(
    halves: Array, half: int, dt: float, per_degree: float = _WHITE_DIFFERENCES
) -> list[Disturbance]:
    """Return the bursts in a channel from sums of squares; a burst is as long as its windows.

    Parameters
    ----------
    halves : (w,) array
        Sums of `half` squared differences between neighbours, clipped at `clipping_level`.
    half : int
    dt : float
        Sampling interval, s.
    per_degree : float
        Samples per degree of freedom; see `samples_per_degree`.
    """
    variances = (halves[:-1] + halves[1:]) / (2 * half)
    return [
        _burst(first * half, (last + 2) * half, dt, ratio, limit)
        for first, last, ratio, limit in _loud_windows(variances, 2 * half / per_degree)
    ][:_MOST]


def _burst(start: int, stop: int, dt: float, ratio: float, limit: float) -> Disturbance:
    return Disturbance(
        "burst", start * dt, (stop - start) * dt, float(np.sqrt(ratio)), ratio / limit
    )


def _loud_windows(variances: Array, dof: float) -> list[tuple[int, int, float, float]]:
    """Return each loud group of windows as first, last and largest ratio, and the limit."""
    median = float(np.median(variances)) if variances.size >= _FEWEST else 0.0
    if median == 0:
        return []
    centre = chi_squared_above(dof, 0.5) / dof
    limit = chi_squared_above(dof, BURST_LEVEL / variances.size) / dof
    ratio = variances / median * centre
    above = np.flatnonzero(ratio > limit)
    if not above.size:
        return []
    groups = np.split(above, np.flatnonzero(np.diff(above) > 2) + 1)
    return [(int(g[0]), int(g[-1]), float(ratio[g].max()), limit) for g in groups]


def _extent(y: Array, start: int, stop: int, size: int, ratio: float) -> tuple[int, int]:
    """Return the part of samples start … stop that is most likely the burst with this ratio.

    A sample makes a variance that is r times as large more likely if its squared difference d²
    exceeds r ln r/(r − 1).
    """
    start, stop = max(start - size // 2, 0), min(stop + size // 2, y.size - 1)
    d = np.diff(y[start : stop + 1]) ** 2
    usual = float(np.median(np.diff(y) ** 2)) / _CHI_SQUARED_MEDIAN
    excess = np.concatenate([[0.0], np.cumsum(d / usual - ratio * np.log(ratio) / (ratio - 1))])
    lowest = np.minimum.accumulate(excess)
    end = int(np.argmax(excess - lowest))
    begin = int(np.argmin(excess[: end + 1]))
    return start + begin, start + max(end, begin + 1)


_FALSE = 0.0001  # expected number of false lines in a spectrum
_NARROWEST, _WIDEST = 101, 2001  # number of coefficients in the running median
_LOWEST = 128  # below this k, the spectrum of drift is too steep for a median
_NEIGHBOURS = 2
_LEAKAGE = 0.2  # of the level; a line with power P leaks P/(π d)² to a distance d
_JOINED = 32  # largest gap within a line; a short vibration widens a line


@dataclass(frozen=True)
class SpectralLine:
    """A line: the frequency of a sinusoid, Hz, and its amplitude in the unit of the series."""

    frequency: float
    amplitude: float


def take_out_lines(spectrum: Spectrum) -> tuple[Spectrum, tuple[SpectralLine, ...]]:
    """Return the spectrum without its lines, and the lines."""
    first = max(spectrum.first, _LOWEST)
    power = spectrum.power[first - 1 : spectrum.last - 1]
    if power.size < _NARROWEST:
        return spectrum, ()
    segments = spectrum.segments
    level = running_median(power, first) / (chi_squared_above(segments, 0.5) / segments)
    limit = chi_squared_above(segments, _FALSE / power.size) / segments
    above = np.flatnonzero(power > limit * level)
    if not above.size:
        return spectrum, ()
    kept = spectrum.kept.copy()
    lines: list[SpectralLine] = []
    for group in np.split(above, np.flatnonzero(np.diff(above) > _JOINED) + 1):
        peak = float((power[group] / level[group]).max())
        reach = max(_NEIGHBOURS, int(np.sqrt(_LEAKAGE * peak)))
        low, high = max(int(group[0]) - reach, 0), int(group[-1]) + reach + 1
        kept[first - 1 + low : first - 1 + high] = False
        excess = np.maximum(power[low:high] - level[low:high], 0.0)
        place = first + low + float(excess @ np.arange(excess.size) / excess.sum())
        amplitude = np.sqrt(2 * excess.sum() / spectrum.n)
        lines.append(SpectralLine(place / (2 * spectrum.n * spectrum.dt), float(amplitude)))
    return replace(spectrum, kept=kept), tuple(lines)


def running_median(power: Array, first: int) -> Array:
    """Return the running median around each value, interpolated in logarithms.

    Parameters
    ----------
    power : (m,) array
        Squared coefficients first, first + 1, ….
    first : int
        Number k of the first coefficient. A window contains k/2 coefficients, but at least 101 and
        at most 2001.
    """
    centres: list[int] = []
    medians: list[float] = []
    k = first
    while k < first + power.size:
        half = int(np.clip(k // 4, _NARROWEST // 2, _WIDEST // 2))
        window = power[max(k - half - first, 0) : k + half + 1 - first]
        centres.append(k if k - half >= first else first + window.size // 2)
        medians.append(float(np.median(window)))
        k += max(half // 2, 1)
    logs = np.interp(np.log(np.arange(first, first + power.size)), np.log(centres), np.log(medians))
    return np.exp(logs)
