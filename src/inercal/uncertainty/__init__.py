"""Uncertainty: of means, of functions, of whole procedures, and how it is stated."""

from inercal.uncertainty.coverage import coverage_factor
from inercal.uncertainty.monte_carlo import mean_with_error, monte_carlo, nees
from inercal.uncertainty.propagation import jacobian, propagate
from inercal.uncertainty.type_a import BATCHES, mean_covariance, pooled_mean_covariances

__all__ = [
    "BATCHES",
    "coverage_factor",
    "jacobian",
    "mean_covariance",
    "mean_with_error",
    "monte_carlo",
    "nees",
    "pooled_mean_covariances",
    "propagate",
]
