"""Report for a dividing head: the estimated angles, and a description of each row."""

from math import degrees, pi

import numpy as np

from inercal.basics.arrays import Array
from inercal.benches.dividing_head.head_angles import sensor_angles
from inercal.benches.dividing_head.passes import pass_names, pass_numbers
from inercal.benches.report_data import MeasuredDirection, Panel, Plot, ReportInput, Series
from inercal.physics.plan import Index, Step
from inercal.physics.sensors import G0

_ARCSEC = pi / 648_000
_APART = 3.0  # ° between passes in the figure


def directions(shown: ReportInput) -> tuple[MeasuredDirection, ...]:
    """Return no directions, because the head may carry only one accelerometer."""
    return ()


def angle_corrections(shown: ReportInput) -> tuple[Array, Array]:
    """Return the estimated minus the stated angles and their standard deviations, (r,) each, rad.

    The mean difference is subtracted, because it cannot be distinguished from the mounting angles.
    The arrays are empty if the estimator does not estimate angles.
    """
    steps, estimate = _steps(shown), shown.estimate
    weights = {
        n: w for n, w in sensor_angles(shown.bench, steps).weights.items() if n in estimate.names
    }
    if not weights:
        return np.zeros(0), np.zeros(0)
    rows = np.stack(list(weights.values()), axis=-1)
    rows = rows - rows.mean(axis=0)
    found = estimate.select(tuple(weights))
    variance = np.einsum("rk,kl,rl->r", rows, found.covariance, rows)
    return rows @ found.value, np.sqrt(variance)


def plots(shown: ReportInput) -> tuple[Plot, ...]:
    """Return a plot of the estimated corrections to the head's angles, pass by pass."""
    error, sd = angle_corrections(shown)
    steps = _steps(shown)
    which = np.array(pass_numbers(steps))
    turned = np.array([degrees(step.angle) % 360 for step in steps])
    names = pass_names(steps)
    series = tuple(
        Series(
            turned[which == k] + _APART * (k - (len(names) - 1) / 2),
            error[which == k] / _ARCSEC,
            name,
            sd[which == k] / _ARCSEC,
        )
        for k, name in enumerate(names)
        if error.size
    )
    text = (
        "Estimated minus stated angles of the head. Their mean is subtracted, because it cannot be "
        "distinguished from the mounting of the accelerometers. Bars are ±2 standard "
        "uncertainties; if passes differ by more, there is an error that is not modelled."
    )
    panel = Panel("", "angle of the head, °", series, tuple(range(0, 361, 30)))
    return (
        Plot(
            "head",
            "Estimated minus stated angles of the head, with bars of ±2 standard uncertainties",
            text if error.size else "The estimator does not estimate the angles of the head.",
            "estimated − stated, ″",
            (panel,) if error.size else (),
        ),
    )


def _steps(shown: ReportInput) -> list[Index]:
    return [step for step in shown.steps if isinstance(step, Index)]


def describe_position(step: Step, outcome: ReportInput, number: int) -> str:
    """Describe a position and its readings, such as "head at 30°, forward; a 0.5 g"."""
    assert isinstance(step, Index)
    text = step.describe()
    if step.level:
        text += f"; level {step.level / _ARCSEC:+.2f}″"
    if step.reading:
        text += f"; autocollimator {step.reading / _ARCSEC:+.2f}″"
    observed = outcome.observations
    readings = [
        f"{channel} {value / G0:.7f} g"
        for channel, value in zip(observed.channels, observed.mean[number].tolist(), strict=True)
    ]
    return f"{text}; {', '.join(readings)}"
