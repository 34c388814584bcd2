"""Uncertainty of means, of functions and of procedures."""

from inercal.estimation.uncertainty.monte_carlo import monte_carlo, nees
from inercal.estimation.uncertainty.propagation import jacobian, propagate
from inercal.estimation.uncertainty.type_a import BATCHES, pooled_mean_covariances

__all__ = [
    "BATCHES",
    "jacobian",
    "monte_carlo",
    "nees",
    "pooled_mean_covariances",
    "propagate",
]
