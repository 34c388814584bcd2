"""What a plan will give before anything is moved, and what its operator does."""

from inercal.design.by_hand import Expected, rehearse, typical

__all__ = ["Expected", "rehearse", "typical"]
