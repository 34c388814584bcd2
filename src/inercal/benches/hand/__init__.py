"""A sensor turned by hand on a table, as a bench."""

from inercal.benches.hand.bench import Hand

__all__ = ["Hand"]
