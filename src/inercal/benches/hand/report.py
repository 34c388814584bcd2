"""What bare hands show of a calibration: what was up in each hold, and the axis of each turn."""

import numpy as np

from inercal.benches.report_data import MeasuredDirection, ReportInput, measured_direction
from inercal.plan import Hold, Turn


def directions(shown: ReportInput) -> tuple[MeasuredDirection, ...]:
    """Return the measured direction of each hold and of each turn."""
    sensed = shown.sensed_motion()
    found: list[MeasuredDirection] = []
    for k, step in enumerate(shown.steps):
        if isinstance(step, Hold):
            found.append(measured_direction(step, sensed.f[k], np.array(step.up)))
        elif isinstance(step, Turn):
            found.append(
                measured_direction(step, sensed.w[k] * np.sign(step.angle), np.array(step.axis))
            )
    return tuple(found)
