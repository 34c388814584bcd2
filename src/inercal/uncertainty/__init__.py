"""Uncertainty: Type A evaluation and propagation."""

from inercal.uncertainty.propagation import propagate
from inercal.uncertainty.type_a import MeanCovariance, pooled_mean_covariance

__all__ = ["MeanCovariance", "pooled_mean_covariance", "propagate"]
