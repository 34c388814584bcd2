"""Describe a rate platform: constant rates about a vertical axis, and poses at known angles."""

from inercal.benches.rate_platform.bench import RatePlatform

__all__ = ["RatePlatform"]
