"""The scale factor of each gyro at each speed, as a table that does not depend on the model.

For a speed that was measured in both senses in one setting (IEEE Std 952)::

    K = (y₊ − y₋) / (ω₊ − ω₋),   even part = (y₊ + y₋)/2 − K (ω₊ + ω₋)/2

Here ω includes the vertical earth rate, and readings at the same rate are averaged. The even part
consists of the bias, second-order nonlinearity and asymmetry. The standard deviations include the
noise of the means and the errors of single dwells that the bench states. They do not include the
scale error and the asymmetry of the bench's rates, which all speeds share.
"""

from collections.abc import Sequence
from math import degrees, hypot
from typing import NamedTuple

import numpy as np

from inercal.benches.rate_platform.bench import RatePlatform
from inercal.benches.rate_platform.linearity import dwell_deviation, is_rate_of_axis
from inercal.benches.rate_platform.sections import PlatformStep, Pose, RateDwell
from inercal.benches.rate_platform.settings import RatePlatformData
from inercal.benches.report_data import Columns, ReportInput
from inercal.physics.sensors import Sensor
from inercal.recordings import Observations
from inercal.recordings.data import RunBase

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
        "speed, °/s": [float(f"{degrees(row.speed):.9g}") for row in rows],
        "K": [round(row.scale, 9) for row in rows],
        "K_sd": [float(f"{row.scale_sd:.3g}") for row in rows],
        "even, °/h": [round(value, 4) for value in hourly[::2]],
        "even_sd, °/h": [float(f"{value:.3g}") for value in hourly[1::2]],
    }
    return {"scale_factors": columns}
