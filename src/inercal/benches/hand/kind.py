"""Bare hands, as a kind of bench."""

from collections.abc import Sequence
from math import degrees

import numpy as np

from inercal.benches.contract import Simulated
from inercal.benches.hand.bench import Hand
from inercal.benches.hand.reading import audit, observe, rests
from inercal.benches.hand.report import directions
from inercal.benches.hand.settings import HandSection, build
from inercal.benches.hand.simulation import perform
from inercal.benches.kind import Effect, Kind
from inercal.data.section import RestsSection
from inercal.plan import HandStep, Hold, Turn
from inercal.sensors import Sensor


def _simulate(
    bench: Hand,
    steps: Sequence[HandStep],
    rate_hz: float,
    rng: np.random.Generator,
    trials: int,
    sensor: Sensor,
    carried: bool,
) -> Simulated:
    return Simulated(perform(bench, steps, rate_hz, rng, trials, carried=carried), sensor)


def _seconds(bench: Hand, steps: Sequence[HandStep]) -> float:
    return sum(step.seconds for step in steps)


KIND = Kind(
    "hand",
    Hand,
    HandSection,
    RestsSection,
    build,
    (Hold, Turn),
    observe,
    _simulate,
    _seconds,
    # At the equator the earth does not turn about the vertical.
    effects=(Effect("earth's rate", "latitude", 0.0, "° of latitude", degrees(1), on_rates=True),),
    audit=audit,
    rests=rests,
    directions=directions,
)
