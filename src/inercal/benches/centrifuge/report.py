"""What a centrifuge shows of a calibration: the specific force in each dwell."""

import numpy as np

from inercal.benches.centrifuge.arm_motion import sensed_motion
from inercal.benches.report_data import MeasuredDirection, ReportInput, measured_direction
from inercal.plan import Spin


def directions(shown: ReportInput) -> tuple[MeasuredDirection, ...]:
    """Return the measured direction of the specific force in each dwell."""
    spins = [step for step in shown.steps if isinstance(step, Spin)]
    known = all(step.attitude is not None for step in spins)
    stated = {name: np.array(q.value) for name, q in shown.expected.items()}
    result = sensed_motion(shown.bench, spins, stated) if known else None
    sensed = shown.sensed_motion(None if result is None else result.w)
    return tuple(
        measured_direction(step, sensed.f[k], None if result is None else result.f[k])
        for k, step in enumerate(spins)
    )
