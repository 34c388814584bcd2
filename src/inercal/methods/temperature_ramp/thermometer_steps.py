"""Find the step of a coarse thermometer, and the instants at which its reading changes.

The readings of a thermometer that reports whole degrees contain little information. The instants at
which they change contain much more, because the temperature is then half way between two readings.
If the reading flips back and forth, the readings on either side are counted from the first flip to
the last.

The temperature curve of a coarse thermometer is a spline whose nodes are estimated. R(t) is a
natural cubic spline through the crossings, both ends of the recording, and free points between
crossings. It is linear in the values of its nodes, and so are its means over blocks. Each node has
a value with a standard uncertainty. For free points the value is that of the monotone cubic through
crossings and ends.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.interpolate  # pyright: ignore[reportMissingTypeStubs]

from inercal.basics.arrays import Array, Bools
from inercal.basics.units import ZERO_CELSIUS

_FREE, _FREE_AT_ENDS = 0.2, 0.4  # standard uncertainty of a free point, in spacings of crossings
_MOST_FREE_POINTS = 8  # in one interval
_LONG = 4.0  # times a neighbour; longer inner intervals get several free points
# A thermometer that truncates reads half a step less than one that rounds, and the data do not
# show which it does: 2 standard uncertainties are half a step.
TRUNCATION = 0.25
_FEW_CHANGES = 12
_QUIET = 0.1  # steps
_ONE_EXPONENTIAL = 3.0  # χ² per degree of freedom
_LEAST_READINGS_A_LEVEL = 4.0  # if fewer, a fine thermometer gives noise and rounding
_CLOSEST = 0.5  # K; between boundaries whose crossings are used
_DIGITS = 6  # largest number of digits in the text of a temperature
_FLIPS_BELONG_WITHIN = 60.0  # s; flips of a boundary that are further apart are separate crossings
_FLIP_TIME = 2.5  # σ/|Ṙ|: how long noise σ makes the reading flip


class Crossings(NamedTuple):
    """The c instants at which a thermometer's reading changed from one step to the next.

    Parameters
    ----------
    step : float
        Step of the thermometer, K.
    spacing : float
        Spacing between the boundaries whose crossings are used, K. Steps of a finer thermometer are
        combined, because more nodes would follow the readings' noise and bias the lag.
    noise : float
        Standard deviation of the thermometer's noise, K.
    refreshed : float
        Interval at which the reading is updated, s; the sampling interval if none is detected.
    time : (c,) array
        Times, s, ascending.
    kelvin : (c,) array
        Temperatures half way between two readings, K.
    sd : (c,) array
        Standard uncertainty of the temperature at these times, K.
    """

    step: float
    spacing: float
    noise: float
    refreshed: float
    time: Array
    kelvin: Array
    sd: Array

    def within(self, begin: float, end: float) -> "Crossings":
        """Return the crossings between two times, s."""
        own = (self.time > begin) & (self.time < end)
        return self._replace(time=self.time[own], kelvin=self.kelvin[own], sd=self.sd[own])


def thermometer_step(kelvin: Array) -> float | None:
    """Return a thermometer's step, K, or None if its readings are not multiples of a step.

    Parameters
    ----------
    kelvin : (n,) array
    """
    values = np.unique(kelvin)
    if values.size < 3 or kelvin.size < _LEAST_READINGS_A_LEVEL * values.size:
        return None
    gaps = np.diff(values)
    apart = gaps > 1e-7 * np.ptp(values)
    values, gaps = values[np.concatenate([[True], apart])], gaps[apart]
    step = float(np.median(gaps[gaps <= 1.5 * np.quantile(gaps, 0.05)]))
    index = np.zeros(values.size)
    for _ in range(20):
        before, index = index, np.concatenate([[0.0], np.cumsum(np.rint(gaps / step))])
        if np.array_equal(before, index):
            break
        step = float(np.polyfit(index, values, 1)[0])
    rest: Array = values - np.polyval(np.polyfit(index, values, 1), index)
    allowed = max(0.02 * step, min(0.35 * _text_resolution(values), 0.2 * step))
    return step if float(np.sqrt((rest**2).mean())) <= allowed else None


def _text_resolution(values: Array) -> float:
    """Return the last decimal of temperatures as they were written in °C, K."""
    celsius = values - ZERO_CELSIUS
    for digits in range(_DIGITS):
        if np.allclose(celsius, np.round(celsius, digits), rtol=0, atol=1e-7):
            return 10.0**-digits
    return 10.0**-_DIGITS


def find_crossings(time: Array, kelvin: Array, step: float) -> Crossings:
    """Return the crossings of a thermometer that reads in steps.

    Parameters
    ----------
    time, kelvin : (n,) arrays
        Times, s, and readings, K.
    step : float
        Step of the thermometer, K.
    """
    period = float(time[-1] - time[0]) / (time.size - 1)
    zero = float(kelvin[0])
    level = np.rint((kelvin - zero) / step).astype(np.int64)
    every = max(1, round(_CLOSEST / step))
    nearest = 0 if level[-1] > 0 else -1  # the boundary that is crossed first
    changes = time[1:][np.diff(level) != 0]
    refreshed = max(_refresh_interval(changes, period), period)
    found = [
        (*one, zero + step * (low + 0.5))
        for low in range(int(level.min()), int(level.max()))
        if (low - nearest) % every == 0
        for one in _of_boundary(time, level > low, period)
    ]
    found.sort()
    at, flip_time, flips, between = (np.array(one) for one in zip(*found, strict=True))
    at = at - 0.5 * (refreshed - period)
    # If one reading skips several steps, they count as one crossing, half way.
    jumped = np.unique(at)
    places = np.searchsorted(jumped, at)
    count = np.bincount(places)
    width, number, middle = (
        np.bincount(places, weights=one) / count for one in (flip_time, flips, between)
    )
    speed = np.abs(np.gradient(middle, jumped)) if jumped.size > 1 else np.zeros(jumped.size)
    noise = float(np.median(speed * width)) / _FLIP_TIME
    sd = np.hypot(speed * refreshed / np.sqrt(12), 1.25 * noise / np.sqrt(number))
    sd = np.hypot(sd, step * (count - 1) / np.sqrt(12))
    sd[[0, -1]] = np.hypot(sd[[0, -1]], noise)
    return Crossings(step, step * every, noise, refreshed, jumped, middle, sd)


def is_one_exponential(crossings: Crossings) -> bool:
    """Return whether a + b e^{−t/c} goes through all crossings within their uncertainties."""
    if crossings.noise > _QUIET * crossings.step:
        return False  # the difference cannot be detected
    time, weight = crossings.time - crossings.time[0], 1 / crossings.sd
    dof = time.size - 3
    if dof < 1:
        return True
    target: Array = weight * (crossings.kelvin - crossings.kelvin[0])

    def chi2(logarithm: float) -> float:
        decay = np.exp(-time / (time[-1] * np.exp(logarithm)))
        shape = np.stack([weight, weight * decay], axis=-1)
        basis: Array = np.linalg.qr(shape)[0]
        return float(target @ target - np.square(target @ basis).sum())

    low, high = -4.0, 3.0  # logarithm of c relative to the length
    least = np.inf
    for _ in range(8):
        grid = np.linspace(low, high, 41)
        found = np.array([chi2(one) for one in grid.tolist()])
        middle, width = float(grid[found.argmin()]), (high - low) / 20
        low, high, least = middle - width, middle + width, float(found.min())
    return least / dof < _ONE_EXPONENTIAL


def _of_boundary(time: Array, above: Bools, period: float) -> list[tuple[float, float, int]]:
    """Return time, duration of flips and number of flips for each crossing of a boundary."""
    flips = np.flatnonzero(np.diff(above)) + 1
    apart = np.flatnonzero(np.diff(time[flips]) > max(_FLIPS_BELONG_WITHIN, 3 * period)) + 1
    found: list[tuple[float, float, int]] = []
    for group in np.split(flips, apart):
        first, last = int(group[0]), int(group[-1])
        if group.size % 2 == 0:
            continue  # the reading came back, so the boundary was touched but not crossed
        short_of_it = int((above[first:last] != above[last]).sum())
        begin = 0.5 * float(time[first - 1] + time[first])
        duration = float(time[last] - time[first])
        share = short_of_it / max(last - first, 1)
        found.append((begin + share * duration, duration, group.size))
    return found


def _refresh_interval(changes: Array, period: float) -> float:
    """Return the longest interval that divides all change times, s; 0 if there is none.

    Changes are observed only at samples, so each is late by up to one sample period.
    """
    if changes.size < 8:
        return 0.0
    since = changes - changes[0]
    longest = float(np.quantile(np.diff(changes), 0.5))
    if longest <= 2 * period:
        return 0.0
    # An interval with this error has drifted by a quarter of a period at the end.
    points = int(np.log(longest / (2 * period)) * 4 * since[-1] / period) + 2
    best, few = 0.0, since[:: max(1, since.size // _FEW_CHANGES)]
    for interval in np.array_split(np.geomspace(2 * period, longest, points), points // 4096 + 1):
        # If all changes are within an angle of their middle, the mean of some is at least its
        # cosine. This excludes most intervals quickly.
        least = np.cos(np.minimum(1.5 * np.pi * period / interval, 0.5 * np.pi)) - 1e-9
        part = np.exp(2j * np.pi * few / interval[:, None]).mean(axis=1)
        interval = interval[np.abs(part) >= least]
        phase = np.exp(2j * np.pi * since / interval[:, None])
        middle = np.angle(phase.mean(axis=1))[:, None]
        off = np.abs(np.angle(phase * np.exp(-1j * middle))) / (2 * np.pi) * interval[:, None]
        fits = off.max(axis=1) <= 0.75 * period
        # Chance must not explain that so many changes lie in such a small part of the interval.
        likely = points * (1.5 * period / interval) ** (since.size - 1)
        fits &= likely < 1e-3
        if fits.any():
            best = float(interval[fits].max())
    return best


@dataclass(frozen=True, eq=False)
class CourseNodes:
    """The k nodes of a thermometer's temperature curve.

    Parameters
    ----------
    crossings : Crossings
        The crossings that the nodes were computed from.
    time : (k,) array
        Times, s, ascending.
    kelvin, sd : (k,) arrays
        Values before the fit and their standard uncertainties, K.
    """

    crossings: Crossings
    time: Array
    kelvin: Array
    sd: Array

    def means(self, edges: Array) -> tuple[Array, Array]:
        """Return the sensitivity of the means of R and dR/dt over b blocks to node values, (b, k).

        Parameters
        ----------
        edges : (b + 1,) array
            Boundaries of the blocks, s.
        """
        spline = scipy.interpolate.CubicSpline(self.time, np.eye(self.time.size), bc_type="natural")
        seconds = np.diff(edges)[:, None]
        values: Array = np.asarray(spline(edges), dtype=np.float64)
        integral: Array = np.asarray(spline.antiderivative()(edges), dtype=np.float64)
        return np.diff(integral, axis=0) / seconds, np.diff(values, axis=0) / seconds


def course_nodes(crossings: Crossings, ends: tuple[float, float], first: float, last: float):
    """Return the nodes of a temperature curve.

    Parameters
    ----------
    crossings : Crossings
        Two or more crossings.
    ends : (float, float)
        Start and end of the recording, s.
    first, last : float
        Readings at the start and end, K.

    Returns
    -------
    CourseNodes
    """
    step = crossings.step
    fixed = np.array([ends[0], *crossings.time, ends[1]])
    values = np.array([first, *crossings.kelvin, last])
    sd = np.hypot(
        np.array([step / np.sqrt(12), *crossings.sd, step / np.sqrt(12)]),
        np.array([crossings.noise, *np.zeros(crossings.time.size), crossings.noise]),
    )
    length = np.diff(fixed)
    free: list[float] = []
    width: list[float] = []
    beyond: list[float] = []
    for k, one in enumerate(length.tolist()):
        at_end = k in (0, length.size - 1)
        # Between two crossings of one boundary the temperature reverses before it reaches another
        # one.
        turns = not at_end and values[k] == values[k + 1]
        turn = 0.5 * crossings.spacing * float(np.sign(values[k] - values[k - 1])) if turns else 0.0
        neighbours = [float(length[n]) for n in (k - 1, k + 1) if 0 <= n < length.size]
        ratio = one / min(neighbours)
        many = ratio if at_end or ratio > _LONG else 1.0
        count = int(np.clip(round(many), 1, _MOST_FREE_POINTS))
        free += (fixed[k] + one * (np.arange(count) + 1) / (count + 1)).tolist()
        wide = _FREE_AT_ENDS if at_end or turns else _FREE
        width += [crossings.spacing * wide] * count
        beyond += [turn] * count
    between = scipy.interpolate.PchipInterpolator(fixed, values)(np.array(free)) + np.array(beyond)
    order = np.argsort(np.concatenate([fixed, free]))

    def ordered(*parts: Array | list[float]) -> Array:
        return np.concatenate(parts)[order]

    return CourseNodes(
        crossings, ordered(fixed, free), ordered(values, between), ordered(sd, width)
    )
