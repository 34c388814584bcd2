"""What bare hands show of a calibration: what was up in each hold, and the axis of each turn."""

import numpy as np

from inercal.benches.report import Direction, Shown, direction
from inercal.plan import Hold, Turn


def directions(shown: Shown) -> tuple[Direction, ...]:
    """Return the measured direction of each hold and of each turn."""
    sensed = shown.sensed_motion()
    found: list[Direction] = []
    for k, step in enumerate(shown.steps):
        if isinstance(step, Hold):
            found.append(direction(step, sensed.f[k], np.array(step.up)))
        elif isinstance(step, Turn):
            found.append(direction(step, sensed.w[k] * np.sign(step.angle), np.array(step.axis)))
    return tuple(found)
