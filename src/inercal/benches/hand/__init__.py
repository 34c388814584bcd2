"""Describe a sensor that is turned by hand on a table as a bench."""

from inercal.benches.hand.bench import Hand

__all__ = ["Hand"]
