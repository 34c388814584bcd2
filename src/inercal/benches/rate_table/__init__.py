"""The bench of a plain rate table."""

from inercal.benches.rate_table.bench import RateTable

__all__ = ["RateTable"]
