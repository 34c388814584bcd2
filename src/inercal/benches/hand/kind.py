"""Bare hands, as a kind of bench."""

from collections.abc import Sequence
from math import degrees
from typing import TYPE_CHECKING

import numpy as np

from inercal.benches.contract import Simulated
from inercal.benches.hand.bench import Hand
from inercal.benches.hand.report import directions
from inercal.benches.hand.settings import HandSection, build
from inercal.benches.hand.simulation import perform
from inercal.benches.kind import Effect, Kind
from inercal.data import Gathered, RestsSection, Source
from inercal.plan import HandStep, Hold, Turn
from inercal.recording import Recording
from inercal.sensors import Sensor

if TYPE_CHECKING:
    from inercal.segments import FoundRests


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


def _observe(run: Source[RestsSection]) -> Gathered:
    # Here and below: what finds sections comes with compiled kernels, which plans do without.
    from inercal.benches.hand.reading import observe

    return observe(run)


def _audit(recording: Recording, sensor: Sensor, bench: Hand) -> Recording:
    from inercal.benches.hand.reading import audit

    return audit(recording, sensor, bench)


def _rests(run: Source[RestsSection], recording: Recording) -> "FoundRests":
    from inercal.benches.hand.reading import rests

    return rests(run, recording)


KIND = Kind(
    "hand",
    Hand,
    HandSection,
    RestsSection,
    build,
    (Hold, Turn),
    _observe,
    _simulate,
    # At the equator the earth does not turn about the vertical.
    effects=(Effect("earth's rate", "latitude", 0.0, "° of latitude", degrees(1), on_rates=True),),
    audit=_audit,
    rests=_rests,
    directions=directions,
)
