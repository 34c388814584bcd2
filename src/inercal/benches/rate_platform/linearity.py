"""Linearity error, asymmetry, hysteresis and dead band in a rate test (IEEE Std 528 and 952).

The straight line y = c + K Ω is fitted by least squares with equal weights to all rests and rates
about an axis. The results hold for the range of rates in the test. If there are nonlinear terms, K
differs from 1 + scale.

* linearity error: the largest residual, divided by K times full scale (the largest rate);
* asymmetry: the difference between the slopes in both senses, each from its own line, divided by
  their mean;
* hysteresis: the largest difference between readings at the same rate and setting that was reached
  from a lower and from a higher rate, divided by K times full scale. Its standard deviation
  includes the noise of the means and the errors of single dwells that the bench states. The largest
  of many differences is not zero even with only noise, so a value below three standard deviations
  is not significant.

The dead band of a gyro about zero rate is found from the slowest rates (IEEE Std 952)::

    y = b + K sgn(ω) max(|ω| − d, 0)

For each d, b and K are fitted by weighted least squares. The result is the d with the least χ², and
the interval in which χ² rises by up to 4. ω includes the vertical earth rate. Only rates up to
2 °/s are used, because at higher rates a nonlinear term may look like a dead band. A dead band is
reported only if it reduces χ² by at least 16; a smaller reduction could be due to noise.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees, hypot, radians
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.units import format_quantity
from inercal.benches.rate_platform.bench import RatePlatform
from inercal.benches.rate_platform.sections import KnownTurn, PlatformStep, RateDwell
from inercal.physics.sensors import Axis, Sensor
from inercal.recordings import Observations

_FEWEST = 3  # rates needed for a line with residuals
_REST = 1e-3  # times full scale: slower rates are rests
_ALONG = 0.5  # cosine
_SHOWN = 3.0  # standard deviations: below this the largest difference is not significant


@dataclass(frozen=True, eq=False)
class LineFit:
    """The straight line fitted to the readings of one gyro.

    Parameters
    ----------
    channel : str
    rate : (n,) array
        Input rates, rad/s.
    residual : (n,) array
        Residuals divided by K times full scale.
    sd : (n,) array
        Standard deviations of the readings, divided by K times full scale.
    slope : float
        Slope K of the line.
    full_scale : float
        Largest input rate, rad/s.
    asymmetry, hysteresis : float
        Asymmetry and hysteresis as defined in the module; NaN if the rates cannot show them.
    hysteresis_sd : float
        Standard deviation of the hysteresis.
    """

    channel: str
    rate: Array
    residual: Array
    sd: Array
    slope: float
    full_scale: float
    asymmetry: float
    hysteresis: float
    hysteresis_sd: float

    @property
    def linearity(self) -> float:
        """Largest residual divided by K times full scale."""
        return float(np.abs(self.residual).max())


def straight_lines(
    observations: Observations, sensor: Sensor, bench: RatePlatform, steps: Sequence[PlatformStep]
) -> tuple[LineFit, ...]:
    """Return the line of each gyro that was tested at rest and at two or more rates."""
    motion = bench.mean_motion(steps, {})
    fits: list[LineFit] = []
    for k, axis in enumerate(sensor.axes):
        if axis.measures != "w":
            continue
        rows = [r for r, s in enumerate(steps) if is_rate_of_axis(axis, s)]
        dwells = [s for s in steps if isinstance(s, RateDwell)]
        rate = motion.w[rows] @ np.array(axis.i)
        if len({round(x, 9) for x in rate.tolist()}) < _FEWEST or not dwells:
            continue
        read = observations.mean[rows, k]
        sd = np.sqrt(observations.covariance[rows, k, k])
        own = [s for r in rows if isinstance(s := steps[r], RateDwell)]
        fits.append(_line_fit(axis.name, rate, read, sd, own, bench))
    return tuple(fits)


def is_rate_of_axis(axis: Axis, step: PlatformStep) -> bool:
    """Return whether a step is a rest or a rate about the input axis of a gyro."""
    dwell = isinstance(step, RateDwell) and not isinstance(step, KnownTurn)
    return dwell and bool(abs(np.array(step.up) @ np.array(axis.i)) > _ALONG)


def _line_fit(
    channel: str,
    rate: Array,
    read: Array,
    sd: Array,
    steps: Sequence[RateDwell],
    bench: RatePlatform,
) -> LineFit:
    slope, offset = np.polyfit(rate, read, 1).tolist()
    full = float(np.abs(rate).max())
    size = abs(slope) * full
    of_dwells = np.array([dwell_deviation(step, bench) for step in steps])
    hysteresis, hysteresis_sd = _hysteresis(rate, read, np.hypot(sd, of_dwells), steps)
    return LineFit(
        channel,
        rate,
        (read - offset - slope * rate) / size,
        sd / size,
        slope,
        full,
        _asymmetry(rate, read),
        hysteresis / size,
        hysteresis_sd / size,
    )


def dwell_deviation(step: RateDwell, bench: RatePlatform) -> float:
    """Return the standard deviation of a dwell's rate due to errors that vary between dwells."""
    if step.rate == 0:
        return 0.0
    read_back = (bench.angle_reading or 0.0) / step.seconds if step.seconds else 0.0
    return hypot((bench.rate_stability or 0.0) * step.rate, read_back)


def _asymmetry(rate: Array, read: Array) -> float:
    """Return the relative difference between the slopes in both senses, each with the rests."""
    full = np.abs(rate).max()
    slow = np.abs(rate) <= _REST * full
    sides = [(rate > 0) | slow, (rate < 0) | slow]
    if any(len(set((rate[side] / full).round(2).tolist())) < 2 for side in sides):
        return float("nan")
    plus, minus = (float(np.polyfit(rate[side], read[side], 1)[0]) for side in sides)
    return 2 * (plus - minus) / (plus + minus)


def _hysteresis(
    rate: Array, read: Array, sd: Array, steps: Sequence[RateDwell]
) -> tuple[float, float]:
    """Return the largest difference between rising and falling rates, and its deviation, or NaN."""
    sides: dict[tuple[str, float], tuple[list[int], list[int]]] = {}
    full = float(np.abs(rate).max())
    before: dict[str, float] = {}
    for k, (step, x) in enumerate(zip(steps, rate.tolist(), strict=True)):
        last = before.get(step.place)
        before[step.place] = x
        if last is None or abs(x) <= _REST * full or abs(x - last) <= _REST * full:
            continue
        rising, falling = sides.setdefault((step.place, round(x, 9)), ([], []))
        (rising if x > last else falling).append(k)
    found = [
        (
            float(abs(read[rising].mean() - read[falling].mean())),
            hypot(*(float(np.sqrt((sd[side] ** 2).sum())) / len(side) for side in own)),
        )
        for own in sides.values()
        if all(own)
        for rising, falling in [own]
    ]
    return max(found) if found else (float("nan"), float("nan"))


def linearity_notes(
    observations: Observations, sensor: Sensor, bench: RatePlatform, steps: Sequence[PlatformStep]
) -> tuple[str, ...]:
    """Describe the straight line of each gyro in words."""
    notes: list[str] = []
    for fit in straight_lines(observations, sensor, bench, steps):
        text = (
            f"{fit.channel}, straight line up to {degrees(fit.full_scale):.4g} °/s (IEEE Std 528): "
            f"linearity error {_ppm(fit.linearity)} of full scale"
        )
        if np.isfinite(fit.asymmetry):
            text += f", asymmetry {_ppm(fit.asymmetry)}"
        if np.isfinite(fit.hysteresis):
            text += f", hysteresis {_ppm(fit.hysteresis)}, U {_ppm(2 * fit.hysteresis_sd)}"
            if fit.hysteresis < _SHOWN * fit.hysteresis_sd:
                text += ", which is not significant"
        notes.append(text.replace("-", "−"))
    return tuple(notes)


def _ppm(value: float) -> str:
    return format_quantity(value, 0.0, "ppm", 3)


_FASTEST = radians(2.0)  # rad/s
_FEWEST_SLOW = 4  # rates other than zero that a dead band needs
_STEPS = 200
_RISE = 4.0
_BAND_SHOWN = 16.0  # smallest reduction of χ² for a significant dead band


class DeadBand(NamedTuple):
    """Half width of a gyro's dead band with its interval of two standard deviations, rad/s."""

    gyro: str
    width: float
    low: float
    high: float


def find_dead_band(
    observations: Observations, sensor: Sensor, bench: RatePlatform, steps: Sequence[PlatformStep]
) -> tuple[DeadBand, ...]:
    """Return the significant dead bands; the observations must have no trial axis."""
    nominal = bench.mean_motion(steps, {}).w
    found: list[DeadBand] = []
    for k, axis in enumerate(sensor.axes):
        if axis.measures != "w":
            continue
        slow = [
            (r, step)
            for r, step in enumerate(steps)
            if isinstance(step, RateDwell)
            and is_rate_of_axis(axis, step)
            and abs(step.rate) <= _FASTEST
        ]
        rows = [r for r, _ in slow]
        if len({round(step.rate, 12) for _, step in slow if step.rate != 0}) < _FEWEST_SLOW:
            continue
        of_dwells = [dwell_deviation(step, bench) for _, step in slow]
        sd = np.hypot(np.sqrt(observations.covariance[rows, k, k]), of_dwells)
        rate = nominal[rows] @ np.array(axis.i)
        one = _dead_band(axis.name, rate, observations.mean[rows, k], sd)
        if one is not None:
            found.append(one)
    return tuple(found)


def _dead_band(gyro: str, rate: Array, read: Array, sd: Array) -> DeadBand | None:
    """Return the dead band with the least χ² on a grid that is refined once, if significant."""
    top = float(np.abs(rate).max())
    widths = np.linspace(0.0, 0.9 * top, _STEPS)
    chi2 = np.array([_chi2(d, rate, read, sd) for d in widths])
    best, step = float(widths[np.argmin(chi2)]), float(widths[1])
    if chi2[0] - chi2.min() < _BAND_SHOWN:
        return None
    fine = np.linspace(max(best - step, 0.0), best + step, _STEPS)
    near = np.array([_chi2(d, rate, read, sd) for d in fine])
    every, all_chi2 = np.concatenate([widths, fine]), np.concatenate([chi2, near])
    within = every[all_chi2 <= near.min() + _RISE]
    width = float(fine[np.argmin(near)])
    return DeadBand(gyro, width, float(within.min()), float(within.max()))


def _chi2(width: float, rate: Array, read: Array, sd: Array) -> float:
    """Return the χ² for a half width, minimised over bias and scale factor."""
    sensed = np.sign(rate) * np.maximum(np.abs(rate) - width, 0.0)
    design = np.stack([np.ones_like(rate), sensed], axis=-1) / sd[:, None]
    off = read / sd
    return float(np.sum((off - design @ np.linalg.lstsq(design, off, rcond=None)[0]) ** 2))


def dead_band_notes(
    observations: Observations, sensor: Sensor, bench: RatePlatform, steps: Sequence[PlatformStep]
) -> tuple[str, ...]:
    """Describe the dead bands in words."""
    return tuple(
        f"{band.gyro} has a dead band of ±{degrees(band.width):.4g} °/s about zero rate (χ² allows "
        f"{degrees(band.low):.4g} to {degrees(band.high):.4g} °/s); no coefficient can correct it"
        for band in find_dead_band(observations, sensor, bench, steps)
    )
