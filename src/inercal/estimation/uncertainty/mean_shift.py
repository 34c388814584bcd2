"""Test whether the mean of a series changed once, at an unknown place.

For each of the n − 1 places, the weighted means before and after are compared. With the total sum
of squares S about the common mean and its part B between the two means::

    B = W₁ W₂/(W₁ + W₂) (m₂ − m₁)²,   F = B (n − 2)/(S − B) ~ F(1, n − 2)

The variances need to be known only up to a factor. The probability is multiplied by the number of
places (Bonferroni), so a series without a change exceeds a limit at most as often as stated.
"""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false

from typing import NamedTuple

import numpy as np
from scipy.special import fdtrc

from inercal.basics.arrays import Array


class MeanShift(NamedTuple):
    """The most significant change of the mean.

    Parameters
    ----------
    column : int
        Index of the series.
    place : int
        Index of the first point after the change.
    shift : float
        Mean after the change minus mean before it, in the unit of the series.
    probability : float
        Probability that any of the series shows such a change by chance, at most 1.
    """

    column: int
    place: int
    shift: float
    probability: float


def largest_mean_shift(values: Array, variance: Array) -> MeanShift:
    """Return the most significant change of the mean in several series.

    Parameters
    ----------
    values : (n, p) array
        Points of p series in time order; n is at least 3.
    variance : (n, p) array
        Variances of the points, up to a common factor for each series.
    """
    n, p = values.shape
    weight = 1 / variance
    before = np.cumsum(weight, axis=0)[:-1]
    total = weight.sum(axis=0)
    about = values - (weight * values).sum(axis=0) / total
    # The weighted sum about the mean before a place is minus the sum after it.
    shift = -np.cumsum(weight * about, axis=0)[:-1] * (1 / before + 1 / (total - before))
    between = shift**2 * before * (total - before) / total
    within = np.maximum((weight * about**2).sum(axis=0) - between, np.finfo(float).tiny)
    chance: Array = fdtrc(1, n - 2, between * (n - 2) / within)
    place, column = np.unravel_index(int(np.argmin(chance)), chance.shape)
    probability = min(1.0, float(chance[place, column]) * (n - 1) * p)
    return MeanShift(int(column), int(place) + 1, float(shift[place, column]), probability)
