"""Report for a rate platform: residuals of the straight lines, and directions at rest."""

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
    """Plot the residuals of each gyro's straight line, in ppm of full scale."""
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
            "Readings of each gyro minus its straight line, fitted by least squares (IEEE Std "
            "528), in ppm of full scale (the largest rate). Bars are ±2 standard deviations of a "
            "mean. A curve beyond the bars indicates a nonlinear term, and a kink at zero an "
            "asymmetry. Different readings at the same rate indicate hysteresis or drift.",
            "residual, ppm of full scale",
            tuple(_panel(fit) for fit in fits),
        ),
    )


def _panel(fit: LineFit) -> Panel:
    rate = np.degrees(fit.table.x)
    series = Series(rate, _PPM * fit.residual, "readings", _PPM * fit.sd)
    return Panel(fit.channel, "rate, °/s", (series,))


def directions(shown: ReportInput) -> tuple[MeasuredDirection, ...]:
    """Return the direction of the specific force at rest and in poses, if it is measured."""
    if shown.sensor.rank("f") < len("xyz"):
        return ()
    nominal, sensed = shown.bench.mean_motion(shown.steps, {}).f, shown.sensed_motion().f
    return tuple(
        measured_direction(step, sensed[k], nominal[k])
        for k, step in enumerate(shown.steps)
        if isinstance(step, Pose) or (isinstance(step, RateDwell) and step.rate == 0)
    )
