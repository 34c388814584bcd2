"""Fit the straight line of a rate test for each gyro, and tabulate its inputs and readings.

The line y = c + K Ω is fitted by least squares with equal weights to all rests and rates about an
axis (IEEE Std 528 and 952). If there are nonlinear terms, K differs from 1 + scale. The table also
contains the covariance of the readings due to noise and to all stated errors of the bench, from
which `inercal.benches.characteristics` finds the characteristics of the gyro. The effects of the
gyro's coefficients for other inputs, such as its g-sensitivity, are removed. Rates up to 2 °/s, or
up to 2 °/s beside a larger rate, are small inputs, which show threshold, dead band and resolution.

A second table, the scale factor of each gyro at each speed, does not depend on the model. For a
speed that was measured in both senses in one setting (IEEE Std 952)::

    K = (y₊ − y₋) / (ω₊ − ω₋),   even part = (y₊ + y₋)/2 − K (ω₊ + ω₋)/2

Here ω includes the vertical earth rate, and readings at the same rate are averaged. The even part
consists of the bias, g-sensitivity, second-order nonlinearity and asymmetry. The standard
deviations include the noise of the means and the errors of single dwells that the bench states.
They do not include the scale error and the asymmetry of the bench's rates, which all speeds share.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import degrees, hypot
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.basics.keys import CoefficientName
from inercal.benches.characteristics import Characteristic, error_covariance, table_characteristics
from inercal.benches.rate_platform.bench import RatePlatform
from inercal.benches.rate_platform.mean_motion import changes_of_rate
from inercal.benches.rate_platform.sections import (
    SMALL_RATE,
    KnownTurn,
    PlatformStep,
    Pose,
    RateDwell,
)
from inercal.benches.rate_platform.settings import RatePlatformData
from inercal.benches.report_data import Columns, ReportInput
from inercal.estimation.input_output_tests import InputOutput, line_residuals, scale_factor
from inercal.physics.motion import Motion
from inercal.physics.sensors import Axis, Sensor
from inercal.recordings import Observations
from inercal.recordings.data import RunBase
from inercal.recordings.temperature import temperature_varies

_FEWEST = 3  # rates needed for a line with residuals
_ALONG = 0.5  # cosine
_OTHER_INPUTS = ("fi", "fp", "fo", "wp", "wo")


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
    motion, observations = bench.mean_motion(steps, {}), observations.without_drift
    stated = bench.without_earth_rate().mean_motion(steps, {}).w
    declared = bench.nuisances(steps, sensor)
    noise = observations.full_covariance
    changes = changes_of_rate(steps)
    design = sensor.design(Motion(motion.f, motion.w), np.zeros(len(sensor.coefficients)))
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
        others = [
            c
            for c, name in enumerate(sensor.coefficients)
            if CoefficientName(name).axis == axis.name
            and sensor.coefficient(name).basis.uses(*_OTHER_INPUTS)
        ]
        places = [(s.place, round(s.rate, 9)) for _, s in own]
        table = InputOutput(
            rate,
            observations.mean[rows, k],
            noise[np.ix_(at, at)] + errors,
            errors,
            np.sign([changes[r] * float(np.dot(s.up, along)) for r, s in own]),
            _numbers(places),
            _numbers([place for place, _ in places]),
            design[rows, k][:, others] if others else None,
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


_DEG_PER_H = 3600.0  # °/h of a °/s


class SpeedScale(NamedTuple):
    """The scale factor of a gyro at one speed in a setting.

    Parameters
    ----------
    gyro, setting : str
    speed : float
        Speed, rad/s.
    scale, scale_sd : float
        Scale factor K and its standard deviation.
    even, even_sd : float
        Even part and its standard deviation, rad/s.
    """

    gyro: str
    setting: str
    speed: float
    scale: float
    scale_sd: float
    even: float
    even_sd: float


def speed_scales(
    observations: Observations, sensor: Sensor, bench: RatePlatform, steps: Sequence[PlatformStep]
) -> tuple[SpeedScale, ...]:
    """Return the scale factor of each gyro at each speed that was measured in both senses."""
    nominal = bench.mean_motion(steps, {}).w
    found: list[SpeedScale] = []
    for k, axis in enumerate(sensor.axes):
        if axis.measures != "w":
            continue
        sides: dict[tuple[str, float], tuple[list[int], list[int]]] = {}
        for r, step in enumerate(steps):
            if isinstance(step, RateDwell) and step.rate != 0 and is_rate_of_axis(axis, step):
                plus, minus = sides.setdefault((step.place, round(abs(step.rate), 9)), ([], []))
                (plus if step.rate > 0 else minus).append(r)
        along = nominal @ np.array(axis.i)
        deviations = [
            hypot(sd, dwell_deviation(step, bench) if isinstance(step, RateDwell) else 0.0)
            for step, sd in zip(
                steps, np.sqrt(observations.covariance[:, k, k]).tolist(), strict=True
            )
        ]
        for (place, speed), own in sides.items():
            if not all(own):
                continue
            y = [float(observations.mean[side, k].mean()) for side in own]
            w = [float(along[side].mean()) for side in own]
            sd = hypot(*(hypot(*(deviations[r] for r in side)) / len(side) for side in own))
            scale = (y[0] - y[1]) / (w[0] - w[1])
            even = (y[0] + y[1] - scale * (w[0] + w[1])) / 2
            scale_sd = sd / abs(w[0] - w[1])
            found.append(SpeedScale(axis.name, place, speed, scale, scale_sd, even, sd / 2))
    return tuple(found)


def output_tables(run: RunBase[RatePlatformData], shown: ReportInput) -> dict[str, Columns]:
    """Return the table "scale_factors" if two or more speeds were measured in both senses."""
    bench = shown.bench
    if not isinstance(bench, RatePlatform):
        return {}
    steps = [step for step in shown.steps if isinstance(step, RateDwell | Pose)]
    rows = speed_scales(shown.observations, shown.sensor, bench, steps)
    if len({row.speed for row in rows}) < 2:
        return {}
    hourly = [_DEG_PER_H * degrees(value) for row in rows for value in (row.even, row.even_sd)]
    columns: Columns = {
        "gyro": [row.gyro for row in rows],
        "setting": [row.setting for row in rows],
        "speed, °/s": [float(f"{degrees(row.speed):.7g}") for row in rows],
        "K": [round(row.scale, 9) for row in rows],
        "K_sd": [float(f"{row.scale_sd:.3g}") for row in rows],
        "even, °/h": [round(value, 4) for value in hourly[::2]],
        "even_sd, °/h": [float(f"{value:.3g}") for value in hourly[1::2]],
    }
    return {"scale_factors": columns}
