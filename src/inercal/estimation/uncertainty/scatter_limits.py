"""Limits of a standard deviation that was estimated in the presence of known noise."""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false

from math import sqrt
from typing import NamedTuple

import scipy

from inercal.estimation.uncertainty.coverage import COVERAGE_PROBABILITY


class Limits(NamedTuple):
    """A standard deviation, and its limits."""

    sd: float
    low: float
    high: float


def scatter_limits(variance: float, variance_of_it: float, dof: int) -> Limits:
    """Return the limits of σ with 95.45 % coverage.

    σ² + s², s² the part of the noise, has the distribution of χ² with ν degrees of freedom, and so
    the variance 2 (σ² + s²)²/ν: from it follows s².

    Parameters
    ----------
    variance, variance_of_it : float
        σ² as estimated, and the variance of the estimate.
    dof : int
        ν.

    Examples
    --------
    >>> sd, low, high = scatter_limits(1.0, 2 / 9, 9)  # without noise
    >>> round(low, 2), round(high, 2)
    (0.68, 1.85)
    """
    total = max(sqrt(variance_of_it * dof / 2), variance)
    noise = total - variance
    tail = (1 - COVERAGE_PROBABILITY) / 2
    low, high = (
        max(total * dof / float(scipy.special.chdtri(dof, p)) - noise, 0.0)
        for p in (tail, 1 - tail)
    )
    return Limits(sqrt(variance), sqrt(low), sqrt(high))
