"""The bench of a rate platform: constant rates about a vertical axis, and poses of known angles."""

from inercal.benches.rate_platform.bench import RatePlatform

__all__ = ["RatePlatform"]
