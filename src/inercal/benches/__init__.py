"""Benches: the equipment that moves the sensor, its stated imperfections, and its qualification.

The names below are loaded on first use, because a run needs only one kind of bench.
"""

from typing import TYPE_CHECKING

from inercal.basics.lazy_names import lazy_names

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


__getattr__ = lazy_names(__name__, _MODULES)


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
