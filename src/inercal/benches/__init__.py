"""Benches: what moves the sensor, with their imperfections declared."""

from inercal.benches.centrifuge import Centrifuge
from inercal.benches.contract import Bench, MeanBench, MeanMotion
from inercal.benches.dividing_head import DividingHead
from inercal.benches.hand import Hand
from inercal.benches.rate_platform import RatePlatform
from inercal.benches.rate_table import RateTable
from inercal.benches.turntable import Turntable

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
