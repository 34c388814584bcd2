"""A precision centrifuge, as a kind of bench."""

from collections.abc import Sequence
from math import degrees

from inercal.benches.centrifuge.bench import Centrifuge
from inercal.benches.centrifuge.report import directions
from inercal.benches.centrifuge.settings import CentrifugeData, CentrifugeSection, build
from inercal.benches.centrifuge.simulation import perform_on_arm, seconds_on_arm
from inercal.benches.kind import Effect, Kind, by_motion, when_called
from inercal.benches.report import spin_in_words
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
    when_called("inercal.benches.centrifuge.reading", "observe"),
    by_motion(perform_on_arm),
    seconds_on_arm,
    effects=(
        Effect("earth's rate", "latitude", _NONE, "° of latitude", degrees(1)),
        Effect("stretch of the arm", "stretch", _NONE, "ppm/g", 1e6 * G0),
    ),
    refuses_budget=_refuses_budget,
    rows_of_table=True,
    directions=directions,
    row=spin_in_words,
)
