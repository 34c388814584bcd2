"""Benches: what moves the sensor, with its imperfections declared, and its qualification.

The names below are loaded when they are first used: a run names one kind of bench.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from inercal.benches.centrifuge import Centrifuge
    from inercal.benches.contract import Bench, MeanBench, MeanMotion
    from inercal.benches.dividing_head import DividingHead
    from inercal.benches.hand import Hand
    from inercal.benches.rate_platform import RatePlatform
    from inercal.benches.rate_table import RateTable
    from inercal.benches.turntable import Turntable

_MODULES = {
    "Bench": "contract",
    "Centrifuge": "centrifuge",
    "DividingHead": "dividing_head",
    "Hand": "hand",
    "MeanBench": "contract",
    "MeanMotion": "contract",
    "RatePlatform": "rate_platform",
    "RateTable": "rate_table",
    "Turntable": "turntable",
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)


__all__ = [
    "Bench",
    "Centrifuge",
    "DividingHead",
    "Hand",
    "MeanBench",
    "MeanMotion",
    "RatePlatform",
    "RateTable",
    "Turntable",
]
