"""A plain rate table, as a kind of bench."""

from collections.abc import Sequence

import numpy as np

from inercal.benches.contract import Kind, Simulated, Vocabulary
from inercal.benches.rate_table.bench import RateTable
from inercal.benches.rate_table.settings import RateTableSection, build
from inercal.benches.rate_table.simulation import perform_on_table, seconds_on_table
from inercal.plan import Spin
from inercal.sensors import Sensor


def _simulate(
    bench: RateTable,
    steps: Sequence[Spin],
    rate_hz: float,
    rng: np.random.Generator,
    trials: int,
    sensor: Sensor,
    carried: bool,
) -> Simulated:
    return Simulated(perform_on_table(bench, steps, rate_hz, rng, trials), sensor)


def _seconds(bench: RateTable, steps: Sequence[Spin]) -> float:
    return seconds_on_table(steps)


KIND = Kind(
    "rate_table",
    RateTable,
    RateTableSection,
    build,
    (Spin,),
    _simulate,
    _seconds,
    Vocabulary(row="state or mounting", turner="table", rows="states"),
)
