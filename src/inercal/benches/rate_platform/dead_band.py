"""The dead band of a gyro about zero rate, by the slowest rates of a test (IEEE Std 952).

y = b + K sgn(ω) max(|ω| − d, 0), with b and K by weighted least squares for each d: the d of least
χ², and the interval in which χ² rises by 4. ω includes the vertical part of the earth's rate. Only
rates up to 2 °/s count: at higher ones a nonlinear term may look like a dead band. One whose
χ² is less than 16 below that of none is not said: it would be that of noise.
"""

from collections.abc import Sequence
from math import degrees, radians
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.benches.rate_platform.bench import RatePlatform
from inercal.benches.rate_platform.linearity import dwell_deviation, is_rate_of_axis
from inercal.benches.rate_platform.sections import PlatformStep, RateDwell
from inercal.physics.sensors import Sensor
from inercal.recordings import Observations

_FASTEST = radians(2.0)  # rad/s
_FEWEST = 4  # rates other than zero
_STEPS = 200
_RISE = 4.0
_SHOWN = 16.0


class DeadBand(NamedTuple):
    """Half width of a dead band and its interval of two standard deviations, rad/s."""

    gyro: str
    width: float
    low: float
    high: float


def find_dead_band(
    observations: Observations, sensor: Sensor, bench: RatePlatform, steps: Sequence[PlatformStep]
) -> tuple[DeadBand, ...]:
    """Return the dead bands that show; without a trial axis."""
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
        if len({round(step.rate, 12) for _, step in slow if step.rate != 0}) < _FEWEST:
            continue
        of_dwells = [dwell_deviation(step, bench) for _, step in slow]
        sd = np.hypot(np.sqrt(observations.covariance[rows, k, k]), of_dwells)
        rate = nominal[rows] @ np.array(axis.i)
        one = _dead_band(axis.name, rate, observations.mean[rows, k], sd)
        if one is not None:
            found.append(one)
    return tuple(found)


def _dead_band(gyro: str, rate: Array, read: Array, sd: Array) -> DeadBand | None:
    """Return the dead band of least χ² on a grid that is refined once; None where none shows."""
    top = float(np.abs(rate).max())
    widths = np.linspace(0.0, 0.9 * top, _STEPS)
    chi2 = np.array([_chi2(d, rate, read, sd) for d in widths])
    best, step = float(widths[np.argmin(chi2)]), float(widths[1])
    if chi2[0] - chi2.min() < _SHOWN:
        return None
    fine = np.linspace(max(best - step, 0.0), best + step, _STEPS)
    near = np.array([_chi2(d, rate, read, sd) for d in fine])
    every, all_chi2 = np.concatenate([widths, fine]), np.concatenate([chi2, near])
    within = every[all_chi2 <= near.min() + _RISE]
    width = float(fine[np.argmin(near)])
    return DeadBand(gyro, width, float(within.min()), float(within.max()))


def _chi2(width: float, rate: Array, read: Array, sd: Array) -> float:
    """Return the least χ² over bias and scale factor at a half width."""
    sensed = np.sign(rate) * np.maximum(np.abs(rate) - width, 0.0)
    design = np.stack([np.ones_like(rate), sensed], axis=-1) / sd[:, None]
    off = read / sd
    return float(np.sum((off - design @ np.linalg.lstsq(design, off, rcond=None)[0]) ** 2))


def dead_band_notes(
    observations: Observations, sensor: Sensor, bench: RatePlatform, steps: Sequence[PlatformStep]
) -> tuple[str, ...]:
    """Return the dead bands in words."""
    return tuple(
        f"{band.gyro} has a dead band of ±{degrees(band.width):.4g} °/s about zero rate, by χ² "
        f"between {degrees(band.low):.4g} and {degrees(band.high):.4g} °/s: no coefficient "
        "corrects it"
        for band in find_dead_band(observations, sensor, bench, steps)
    )
