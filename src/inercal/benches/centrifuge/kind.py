"""A precision centrifuge, as a kind of bench."""

from collections.abc import Sequence
from math import degrees

import numpy as np

from inercal.basics.units import Measured
from inercal.benches.centrifuge.arm_motion import sensed_motion
from inercal.benches.centrifuge.bench import Centrifuge
from inercal.benches.centrifuge.settings import CentrifugeData, CentrifugeSection, build
from inercal.benches.centrifuge.sheet import sheet
from inercal.benches.centrifuge.simulation import arm_plan_duration, simulate_arm_motion
from inercal.benches.kind_definition import Effect, Kind, simulate_without_sensor
from inercal.benches.report_data import (
    MeasuredDirection,
    ReportInput,
    describe_spin,
    measured_direction,
)
from inercal.physics.plan import Spin
from inercal.physics.sensors import G0
from inercal.recordings.data import EstimatorInput, RunBase

_NONE = Measured(0.0, 0.0)


def _refuses_budget(bench: Centrifuge, steps: Sequence[Spin]) -> str:
    if bench.platform == "locked":
        return ""
    return "a budget cannot be computed for a counter-rotating platform; simulate its runs instead"


def directions(shown: ReportInput) -> tuple[MeasuredDirection, ...]:
    """Return the measured direction of the specific force during each dwell."""
    spins = [step for step in shown.steps if isinstance(step, Spin)]
    known = all(step.attitude is not None for step in spins)
    stated = {name: np.array(q.value) for name, q in shown.expected.items()}
    nominal = sensed_motion(shown.bench, spins, stated) if known else None
    sensed = shown.sensed_motion(None if nominal is None else nominal.w)
    return tuple(
        measured_direction(step, sensed.f[k], None if nominal is None else nominal.f[k])
        for k, step in enumerate(spins)
    )


def _observe(run: RunBase[CentrifugeData]) -> EstimatorInput:
    """Return the observations from a run; the reader is imported only when it is needed."""
    from inercal.benches.centrifuge.reading import observe

    return observe(run)


KIND = Kind(
    "centrifuge",
    Centrifuge,
    CentrifugeSection,
    CentrifugeData,
    build,
    (Spin,),
    _observe,
    simulate_without_sensor(simulate_arm_motion),
    arm_plan_duration,
    effects=(
        Effect("earth's rate", "latitude", _NONE, "° of latitude", degrees(1)),
        Effect("stretch of the arm", "stretch", _NONE, "ppm/g", 1e6 * G0),
    ),
    refuses_budget=_refuses_budget,
    rows_of_table=True,
    spins=True,
    sheet=sheet,
    directions=directions,
    row=describe_spin,
)
