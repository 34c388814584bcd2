"""What the report shows of a rate platform: residuals of the straight line, directions at rest."""

import numpy as np

from inercal.benches.rate_platform.bench import RatePlatform
from inercal.benches.rate_platform.linearity import LineFit, straight_lines
from inercal.benches.rate_platform.sections import Pose, RateDwell
from inercal.benches.report_data import (
    MeasuredDirection,
    Panel,
    Plot,
    ReportInput,
    Series,
    measured_direction,
)

_PPM = 1e6


def plots(shown: ReportInput) -> tuple[Plot, ...]:
    """Return the residuals of each gyro's straight line, in ppm of full scale."""
    bench = shown.bench
    steps = [step for step in shown.steps if isinstance(step, RateDwell | Pose)]
    if not isinstance(bench, RatePlatform):
        return ()
    fits = straight_lines(shown.observations, shown.sensor, bench, steps)
    if not fits:
        return ()
    return (
        Plot(
            "linearity",
            "Residuals of the straight line of each gyro against the rate",
            "Readings of each gyro about its axis, minus the straight line by least squares "
            "(IEEE Std 528), in ppm of full scale, the largest rate; bars are ±2 standard "
            "deviations of a mean. A curve beyond the bars is a nonlinear term, a kink at zero an "
            "asymmetry; readings of one rate that differ are hysteresis or drift.",
            "residual, ppm of full scale",
            tuple(_panel(fit) for fit in fits),
        ),
    )


def _panel(fit: LineFit) -> Panel:
    rate = np.degrees(fit.rate)
    series = Series(rate, _PPM * fit.residual, "readings", _PPM * fit.sd)
    return Panel(fit.channel, "rate, °/s", (series,))


def directions(shown: ReportInput) -> tuple[MeasuredDirection, ...]:
    """Return the direction of the specific force at rest and in poses; none without a triad."""
    sensor = shown.sensor
    if len(sensor.select_axes("f").axes) < len("xyz"):
        return ()
    nominal, sensed = shown.bench.mean_motion(shown.steps, {}).f, shown.sensed_motion().f
    return tuple(
        measured_direction(step, sensed[k], nominal[k])
        for k, step in enumerate(shown.steps)
        if isinstance(step, Pose) or (isinstance(step, RateDwell) and step.rate == 0)
    )
