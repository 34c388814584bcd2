"""What a turntable shows of a calibration: what was up in each hold, and the axis of each turn."""

import numpy as np

from inercal.benches.report_data import MeasuredDirection, ReportInput, measured_direction
from inercal.benches.turntable.attitude import reference_attitude
from inercal.plan import Position, Rotation


def directions(shown: ReportInput) -> tuple[MeasuredDirection, ...]:
    """Return the measured direction of each hold and of each turn."""
    sensed = shown.sensed_motion()
    found: list[MeasuredDirection] = []
    for k, step in enumerate(shown.steps):
        if isinstance(step, Position):
            up = reference_attitude(shown.bench, np.array([step.angles]))[0, 2]
            found.append(measured_direction(step, sensed.f[k], up))
        elif isinstance(step, Rotation):
            found.append(measured_direction(step, sensed.w[k] * np.sign(step.angle), None))
    return tuple(found)
