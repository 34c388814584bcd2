"""Figures of a rate test by a straight line, as IEEE Std 528 and 952 define them.

The line y = c + K Ω by least squares with equal weights, over all rests and rates of an axis.
These figures are of the range that was turned; K is not 1 + scale where there are nonlinear terms.

* linearity error: largest residual over K times full scale, the largest rate;
* asymmetry: difference of the slopes of both senses, each by its own line, over their mean;
* hysteresis: largest difference of readings at one rate of a setting, over K times full scale.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees

import numpy as np

from inercal.arrays import Array
from inercal.benches.rate_platform.bench import RatePlatform
from inercal.benches.rate_platform.sections import KnownTurn, PlatformStep, RateDwell
from inercal.recording import Observations
from inercal.sensors import Sensor

_FEWEST = 3  # rates of a line with a residual
_REST = 1e-3  # of full scale


@dataclass(frozen=True, eq=False)
class LineFit:
    """The straight line of one gyro.

    Parameters
    ----------
    channel : str
    rate : (n,) array
        Input, rad/s.
    residual : (n,) array
        Over K times full scale.
    sd : (n,) array
        Standard deviation of each reading, over the same.
    slope : float
        K.
    full_scale : float
        Largest input, rad/s.
    asymmetry, hysteresis : float
        NaN where the rates do not show it.
    """

    channel: str
    rate: Array
    residual: Array
    sd: Array
    slope: float
    full_scale: float
    asymmetry: float
    hysteresis: float

    @property
    def linearity(self) -> float:
        """Largest residual over K times full scale."""
        return float(np.abs(self.residual).max())


def straight_lines(
    observations: Observations, sensor: Sensor, bench: RatePlatform, steps: Sequence[PlatformStep]
) -> tuple[LineFit, ...]:
    """Return the line of each gyro that was turned about at two rates or more and a rest."""
    motion = bench.mean_motion(steps, {})
    fits: list[LineFit] = []
    for k, axis in enumerate(sensor.axes):
        if axis.measures != "w":
            continue
        rows = [
            r
            for r, s in enumerate(steps)
            if isinstance(s, RateDwell)
            and not isinstance(s, KnownTurn)
            and abs(np.array(s.up) @ np.array(axis.i)) > 0.5
        ]
        dwells = [s for s in steps if isinstance(s, RateDwell)]
        rate = motion.w[rows] @ np.array(axis.i)
        if len({round(x, 9) for x in rate.tolist()}) < _FEWEST or not dwells:
            continue
        read = observations.mean[rows, k]
        sd = np.sqrt(observations.covariance[rows, k, k])
        places = [s.place for r in rows if isinstance(s := steps[r], RateDwell)]
        fits.append(_line_fit(axis.name, rate, read, sd, places))
    return tuple(fits)


def _line_fit(channel: str, rate: Array, read: Array, sd: Array, places: Sequence[str]) -> LineFit:
    slope, offset = np.polyfit(rate, read, 1).tolist()
    full = float(np.abs(rate).max())
    size = abs(slope) * full
    return LineFit(
        channel,
        rate,
        (read - offset - slope * rate) / size,
        sd / size,
        slope,
        full,
        _asymmetry(rate, read),
        _hysteresis(rate, read, places) / size,
    )


def _asymmetry(rate: Array, read: Array) -> float:
    """Return the relative difference of the slopes of both senses; each includes the rests."""
    full = np.abs(rate).max()
    slow = np.abs(rate) <= _REST * full
    sides = [(rate > 0) | slow, (rate < 0) | slow]
    if any(len(set((rate[side] / full).round(2).tolist())) < 2 for side in sides):
        return float("nan")
    plus, minus = (float(np.polyfit(rate[side], read[side], 1)[0]) for side in sides)
    return 2 * (plus - minus) / (plus + minus)


def _hysteresis(rate: Array, read: Array, places: Sequence[str]) -> float:
    """Return the largest difference of readings at one rate of a setting; NaN without any."""
    same: dict[tuple[str, float], list[float]] = {}
    least = _REST * float(np.abs(rate).max())
    for place, x, y in zip(places, rate.tolist(), read.tolist(), strict=True):
        if abs(x) > least:
            same.setdefault((place, round(x, 9)), []).append(y)
    spans = [max(own) - min(own) for own in same.values() if len(own) > 1]
    return max(spans) if spans else float("nan")


def linearity_notes(
    observations: Observations, sensor: Sensor, bench: RatePlatform, steps: Sequence[PlatformStep]
) -> tuple[str, ...]:
    """Return the figures of each gyro's line in words."""
    notes: list[str] = []
    for fit in straight_lines(observations, sensor, bench, steps):
        text = (
            f"{fit.channel}, straight line up to {degrees(fit.full_scale):.4g} °/s (IEEE Std 528): "
            f"linearity error {_ppm(fit.linearity)} of full scale"
        )
        for word, value in (("asymmetry", fit.asymmetry), ("hysteresis", fit.hysteresis)):
            if np.isfinite(value):
                text += f", {word} {_ppm(value)}"
        notes.append(text.replace("-", "−"))
    return tuple(notes)


def _ppm(value: float) -> str:
    """Return three digits of a ratio, without an exponent."""
    return f"{float(f'{1e6 * value:.3g}'):g} ppm"
