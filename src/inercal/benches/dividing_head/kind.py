"""A dividing head, as a kind of bench."""

from collections.abc import Sequence

import numpy as np

from inercal.benches.contract import Kind, Simulated
from inercal.benches.dividing_head.bench import DividingHead
from inercal.benches.dividing_head.settings import DividingHeadSection, build
from inercal.benches.dividing_head.simulation import perform_on_head
from inercal.plan import Index
from inercal.sensors import Sensor


def _simulate(
    bench: DividingHead,
    steps: Sequence[Index],
    rate_hz: float,
    rng: np.random.Generator,
    trials: int,
    sensor: Sensor,
    carried: bool,
) -> Simulated:
    return perform_on_head(bench, steps, sensor, rate_hz, rng, trials)


def _seconds(bench: DividingHead, steps: Sequence[Index]) -> float:
    return sum(step.seconds for step in steps)


KIND = Kind(
    "dividing_head", DividingHead, DividingHeadSection, build, (Index,), _simulate, _seconds
)
