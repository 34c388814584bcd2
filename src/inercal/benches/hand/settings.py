"""[bench] of bare hands: its keys, and the bench in SI."""

from pathlib import Path
from typing import Literal

from inercal.benches.hand.bench import Hand
from inercal.benches.key_declarations import add_bench_keys, build_bench
from inercal.section_settings import BenchSection, BenchUsage, section_constant


@add_bench_keys(Hand)
class HandSection(BenchSection):
    """[bench]: bare hands. Gravity is given, or computed from latitude and height."""

    kind: Literal["hand"] = "hand"

    def unused_keys(self, use: BenchUsage) -> dict[str, str]:
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
    known = section.latitude is not None
    return build_bench(
        Hand, section, latitude=section_constant(section, "latitude", "°") if known else None
    )
