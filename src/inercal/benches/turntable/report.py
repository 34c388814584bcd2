"""What a turntable shows of a calibration: what was up in each hold, and the axis of each turn."""

import numpy as np

from inercal.benches.report import Direction, Shown, direction
from inercal.benches.turntable.attitude import reference
from inercal.plan import Position, Rotation


def directions(shown: Shown) -> tuple[Direction, ...]:
    """Return the measured direction of each hold and of each turn."""
    sensed = shown.sensed_motion()
    found: list[Direction] = []
    for k, step in enumerate(shown.steps):
        if isinstance(step, Position):
            up = reference(shown.bench, np.array([step.angles]))[0, 2]
            found.append(direction(step, sensed.f[k], up))
        elif isinstance(step, Rotation):
            found.append(direction(step, sensed.w[k] * np.sign(step.angle), None))
    return tuple(found)
