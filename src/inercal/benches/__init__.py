"""Benches: what moves the sensor, with their imperfections declared."""

from inercal.benches.hand import Hand

__all__ = ["Hand"]
