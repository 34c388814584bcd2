"""Bare hands, as a kind of bench."""

from math import degrees

from inercal.benches.hand.bench import Hand
from inercal.benches.hand.report import directions
from inercal.benches.hand.settings import HandSection, build
from inercal.benches.hand.simulation import simulate_hand_motion
from inercal.benches.kind_definition import (
    Effect,
    Kind,
    import_when_called,
    simulate_without_sensor,
)
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
    import_when_called(_READING, "observe"),
    simulate_without_sensor(simulate_hand_motion, in_hand=True),
    # At the equator the earth does not turn about the vertical.
    effects=(
        Effect("earth's rate", "latitude", 0.0, "° of latitude", degrees(1), affects_rates=True),
    ),
    audit=import_when_called(_READING, "audit"),
    rests=import_when_called(_READING, "refused_recording_rests"),
    directions=directions,
)
