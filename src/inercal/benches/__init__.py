"""Benches: what moves the sensor, with their imperfections declared."""

from inercal.benches.centrifuge import Centrifuge
from inercal.benches.hand import Hand

__all__ = ["Centrifuge", "Hand"]
