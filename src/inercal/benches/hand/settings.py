"""[bench] of bare hands: its keys, and the bench in SI."""

from pathlib import Path
from typing import Literal

from inercal.benches.hand.bench import Hand
from inercal.settings import (
    BenchSection,
    Use,
    deviation,
    gravity_of,
    measured,
)


class HandSection(BenchSection):
    """[bench]: bare hands. Gravity is given, or computed from latitude and height."""

    kind: Literal["hand"] = "hand"
    tilt: str = "0.5 °"
    turn_angle: str = "1 °"
    turn_tilt: str = "0.5 °"
    timebase: str = "100 ppm"

    def idle(self, use: Use) -> dict[str, str]:
        """Return the keys that change no result of such a use, each with the reason."""
        found: dict[str, str] = {}
        if not use.attitudes:
            found["tilt"] = f"{use.method} finds the attitudes itself"
        if not use.turns:
            words = f"{use.method} makes no turns of a known angle"
            found |= {"turn_angle": words, "turn_tilt": words}
            if not use.gyros or use.attitudes:
                found["timebase"] = f"without turns nothing of {use.method} depends on time"
        return found


def build(section: HandSection, folder: Path) -> Hand:
    """Return the bench in SI; files that it names lie in `folder`."""
    place = None
    if section.latitude is not None:
        place = measured(section.latitude, "°", "[bench] latitude")
    return Hand(
        gravity=gravity_of(section),
        latitude=place,
        tilt=deviation(section, "tilt", "°"),
        turn_angle=deviation(section, "turn_angle", "°"),
        turn_tilt=deviation(section, "turn_tilt", "°"),
        timebase=deviation(section, "timebase", "1"),
    )
