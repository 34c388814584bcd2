"""A precision centrifuge, as a kind of bench."""

from collections.abc import Sequence
from math import degrees

from inercal.benches.centrifuge.bench import Centrifuge
from inercal.benches.centrifuge.report import directions
from inercal.benches.centrifuge.settings import CentrifugeData, CentrifugeSection, build
from inercal.benches.centrifuge.simulation import arm_plan_duration, simulate_arm_motion
from inercal.benches.kind_definition import (
    Effect,
    Kind,
    import_when_called,
    simulate_without_sensor,
)
from inercal.benches.report_data import describe_spin
from inercal.plan import Spin
from inercal.sensors import G0
from inercal.units import Measured

_NONE = Measured(0.0, 0.0)


def _refuses_budget(bench: Centrifuge, steps: Sequence[Spin]) -> str:
    if bench.platform == "locked":
        return ""
    return "a budget of a counter-rotating platform is not there: simulate its runs instead"


KIND = Kind(
    "centrifuge",
    Centrifuge,
    CentrifugeSection,
    CentrifugeData,
    build,
    (Spin,),
    import_when_called("inercal.benches.centrifuge.reading", "observe"),
    simulate_without_sensor(simulate_arm_motion),
    arm_plan_duration,
    effects=(
        Effect("earth's rate", "latitude", _NONE, "° of latitude", degrees(1)),
        Effect("stretch of the arm", "stretch", _NONE, "ppm/g", 1e6 * G0),
    ),
    refuses_budget=_refuses_budget,
    rows_of_table=True,
    directions=directions,
    row=describe_spin,
)
