"""Remarks on a systematic calibration: the lag, navigation errors, rests that move, weak paths."""

from typing import Any

import numpy as np

from inercal.basics.units import format_quantity, format_value_and_uncertainty
from inercal.benches.report_data import Panel, Plot, Series
from inercal.benches.turntable.still_table import StillTable
from inercal.methods._base import Fit, Remarks
from inercal.methods.systematic.generalised_least_squares import LAG, estimated_attitudes
from inercal.methods.systematic.navigation_error import (
    VelocityErrors,
    position_drift,
    velocity_errors,
)
from inercal.methods.systematic.segment_tests import rest_change_deviations
from inercal.methods.systematic.segments import segments_of_track
from inercal.methods.systematic.vertical_turns import vertical_turn_messages
from inercal.recordings import Finding

_MOVED = 4.5  # standard deviations of the halves of one rest: chance in 114 is 8e-4


def remarks(fit: Fit[Any, Any]) -> Remarks:
    """Return the lag as a condition, and findings on rests."""
    if not np.all(fit.estimate.converged):
        return Remarks()
    known = StillTable.from_turntable(fit.bench)
    estimate, sensor = fit.estimate, fit.sensor
    k = estimate.names.index(LAG)
    lag = format_quantity(float(estimate.value[k]), float(estimate.std[k]), "ms")
    track = fit.observations.track
    assert track is not None  # the estimator refuses other data
    segments = segments_of_track(track, fit.observations.labels, sensor)
    z = rest_change_deviations(segments, sensor)
    findings: list[Finding] = []
    rest, axis = np.unravel_index(int(np.abs(z).argmax()), z.shape)
    if abs(z[rest, axis]) > _MOVED:
        text = (
            f"the two halves of rest {segments.labels[rest]} differ by {abs(z[rest, axis]):.1f} "
            f"standard deviations in {sensor.channels[axis]}: the table creeps or was knocked; "
            "wait longer after turns, or record again"
        )
        findings.append(Finding("warning", "moving", text))
    notes = (
        f"the accelerometers are late on the gyros by {lag} (negative: early)",
        "gravity and latitude as stated set the scale: 40 mGal of gravity are 40 ppm of all scale "
        "factors of accelerometers, which no residual shows",
    )
    p = len(sensor.coefficients)
    place = known.gravity.value, known.latitude.value
    drift = position_drift(sensor, estimate.value[:p], estimate.stated_covariance[:p, :p], *place)
    before, after = (float(np.hypot(*one)) for one in drift)
    notes += (
        "a navigation of one hour at rest, z up, from a true start, ends off by "
        f"{_kilometres(before)} without this calibration, and with it by U = "
        f"{_kilometres(after)} (k = 2; noise and later changes not counted)",
    )
    attitudes = estimated_attitudes(estimate, segments, sensor, place[1])
    errors = velocity_errors(segments, sensor, estimate.value[:p], attitudes, *place)
    findings += [
        Finding("warning", "path", text)
        for text in vertical_turn_messages(attitudes, segments.labels)
    ]
    return Remarks(
        tuple(findings), notes, {"lag of the accelerometers": lag}, (_velocity_plot(errors),)
    )


def _kilometres(metres: float) -> str:
    return f"{format_value_and_uncertainty(0.0, metres / 1e3)[1]} km"


def _velocity_plot(errors: VelocityErrors) -> Plot:
    number = np.arange(1.0, len(errors.before) + 1)
    series = tuple(
        Series(number, np.log10(np.maximum(1e3 * y, 1e-6)), name, hollow=name == "before")
        for name, y in (("before", errors.before), ("after", errors.after))
    )
    return Plot(
        "navigation",
        "Level velocity at the end of each rest, before and after calibration",
        "Level velocity error at the end of each rest, navigated from the rest's own attitude with "
        "nominal coefficients (before) and with the estimated ones (after), as log₁₀ of mm/s. "
        "After calibration all rests should be alike.",
        "log₁₀(mm/s)",
        (Panel("velocity over a rest", "rest", series),),
    )
