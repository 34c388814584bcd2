"""Benches: what moves the sensor, with their imperfections declared."""

from inercal.benches.centrifuge import Centrifuge
from inercal.benches.dividing_head import DividingHead
from inercal.benches.hand import Hand

Bench = Hand | Centrifuge | DividingHead

__all__ = ["Bench", "Centrifuge", "DividingHead", "Hand"]
