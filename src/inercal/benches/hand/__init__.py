"""The bench of bare hands."""

from inercal.benches.hand.bench import Hand

__all__ = ["Hand"]
