"""The bench of a dividing head."""

from inercal.benches.dividing_head.bench import DividingHead

__all__ = ["DividingHead"]
