"""Describe a plain rate table as a bench."""

from inercal.benches.rate_table.bench import RateTable

__all__ = ["RateTable"]
