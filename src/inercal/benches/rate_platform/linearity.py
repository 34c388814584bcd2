"""The straight line of a rate test for each gyro, and its table of inputs and readings.

The line y = c + K Ω is fitted by least squares with equal weights to all rests and rates about an
axis (IEEE Std 528 and 952). If there are nonlinear terms, K differs from 1 + scale. The table also
contains the covariance of the readings due to noise and to all stated errors of the bench, from
which `inercal.benches.characteristics` finds the characteristics of the gyro. Rates up to 2 °/s, or
up to 2 °/s beside a larger rate, are small inputs, which show threshold, dead band and resolution.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import hypot

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.benches.characteristics import Characteristic, error_covariance, table_characteristics
from inercal.benches.rate_platform.bench import RatePlatform
from inercal.benches.rate_platform.mean_motion import changes_of_rate
from inercal.benches.rate_platform.sections import SMALL_RATE, KnownTurn, PlatformStep, RateDwell
from inercal.estimation.input_output_tests import InputOutput, line_residuals, scale_factor
from inercal.physics.sensors import Axis, Sensor
from inercal.recordings import Observations
from inercal.recordings.temperature import temperature_varies

_FEWEST = 3  # rates needed for a line with residuals
_ALONG = 0.5  # cosine


@dataclass(frozen=True, eq=False)
class LineFit:
    """The straight line fitted to the readings of one gyro.

    Parameters
    ----------
    channel : str
    table : InputOutput
        Input rates and readings, rad/s.
    sd : (n,) array
        Standard deviations of the readings due to noise, divided by K times full scale.
    rows : tuple of int
        Rows of the run in the table.
    stated : (n,) array
        Stated rates about the axis, which do not include the earth's rate, rad/s.
    """

    channel: str
    table: InputOutput
    sd: Array
    rows: tuple[int, ...]
    stated: Array

    @property
    def residual(self) -> Array:
        """Residuals divided by K times full scale, (n,)."""
        return line_residuals(self.table)[0]


def straight_lines(
    observations: Observations, sensor: Sensor, bench: RatePlatform, steps: Sequence[PlatformStep]
) -> tuple[LineFit, ...]:
    """Return the line of each gyro that was tested at rest and at two or more rates."""
    motion, observations = bench.mean_motion(steps, {}), observations.without_drift()
    stated = bench.without_earth_rate().mean_motion(steps, {}).w
    declared = bench.nuisances(steps, sensor)
    noise = observations.full_covariance
    changes = changes_of_rate(steps)
    fits: list[LineFit] = []
    for k, axis in enumerate(sensor.axes):
        if axis.measures != "w":
            continue
        own = [
            (r, s)
            for r, s in enumerate(steps)
            if isinstance(s, RateDwell) and is_rate_of_axis(axis, s)
        ]
        along = np.array(axis.i)
        rows = [r for r, _ in own]
        rate = motion.w[rows] @ along
        sd = np.sqrt(observations.covariance[rows, k, k])
        if len({round(x, 9) for x in rate.tolist()}) < _FEWEST or not sd.all():
            continue
        at = [r * len(sensor.axes) + k for r in rows]
        slopes = {name: by @ along for name, by in motion.dw.items()}
        errors = error_covariance(slopes, declared, rows)
        places = [(s.place, round(s.rate, 9)) for _, s in own]
        table = InputOutput(
            rate,
            observations.mean[rows, k],
            noise[np.ix_(at, at)] + errors,
            errors,
            np.sign([changes[r] * float(np.dot(s.up, along)) for r, s in own]),
            _numbers(places),
            _numbers([place for place, _ in places]),
        )
        size = abs(scale_factor(table).value) * table.full_scale
        fits.append(LineFit(axis.name, table, sd / size, tuple(rows), stated[rows] @ along))
    return tuple(fits)


def is_rate_of_axis(axis: Axis, step: PlatformStep) -> bool:
    """Return whether a step is a rest or a rate about the input axis of a gyro."""
    dwell = isinstance(step, RateDwell) and not isinstance(step, KnownTurn)
    return dwell and bool(abs(np.array(step.up) @ np.array(axis.i)) > _ALONG)


def dwell_deviation(step: RateDwell, bench: RatePlatform) -> float:
    """Return the standard deviation of a dwell's rate due to errors that vary between dwells."""
    if step.rate == 0:
        return 0.0
    read_back = (bench.angle_reading or 0.0) / step.seconds if step.seconds else 0.0
    return hypot((bench.rate_stability or 0.0) * step.rate, read_back)


def _numbers(names: Sequence[object]) -> Indices:
    """Return a number for each name, the same for equal names, (n,)."""
    known = list(dict.fromkeys(names))
    return np.array([known.index(name) for name in names], dtype=np.int64)


def gyro_characteristics(
    observations: Observations, sensor: Sensor, bench: RatePlatform, steps: Sequence[PlatformStep]
) -> tuple[Characteristic, ...]:
    """Return the characteristics of each gyro; none if the temperature varied in the run."""
    if temperature_varies(observations.temperature):
        return ()
    return tuple(
        replace(
            one,
            rows=tuple(fit.rows[k] for k in one.rows),
            about=None
            if one.about is None
            else float(fit.stated[np.argmin(np.abs(fit.table.x - one.about))]),
        )
        for fit in straight_lines(observations, sensor, bench, steps)
        for one in table_characteristics(fit.channel, fit.table, SMALL_RATE, "°/h")
    )
