"""Describe a dividing head as a bench."""

from inercal.benches.dividing_head.bench import DividingHead

__all__ = ["DividingHead"]
