"""Bare hands, as a kind of bench."""

from math import degrees

from inercal.benches.hand.bench import Hand
from inercal.benches.hand.report import directions
from inercal.benches.hand.settings import HandSection, build
from inercal.benches.hand.simulation import perform
from inercal.benches.kind import Effect, Kind, by_motion, when_called
from inercal.data import RestsSection
from inercal.plan import Hold, Turn

_READING = "inercal.benches.hand.reading"

KIND = Kind(
    "hand",
    Hand,
    HandSection,
    RestsSection,
    build,
    (Hold, Turn),
    when_called(_READING, "observe"),
    by_motion(perform, in_hand=True),
    # At the equator the earth does not turn about the vertical.
    effects=(Effect("earth's rate", "latitude", 0.0, "° of latitude", degrees(1), on_rates=True),),
    audit=when_called(_READING, "audit"),
    rests=when_called(_READING, "rests"),
    directions=directions,
)
