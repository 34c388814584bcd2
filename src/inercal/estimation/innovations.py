"""Tests of a filter's innovations by groups of epochs, where a sum of squares hides a small bias.

Divided by their standard deviations, the innovations of a filter whose model holds are independent
and N(0, 1). Of a group of n epochs the sum over √n is N(0, 1) again, and a bias b of each grows to
√n b there. Over g groups and m components::

    means       Σ z²                                          χ² of m g degrees of freedom
    whiteness   (Σ z_i · z_i+1)² / Σ_odd |z_i−1 + z_i+1|²     χ² of one

(Bar-Shalom, Li and Kirubarajan 2001, Estimation with Applications to Tracking and Navigation,
section 5.4). The second is exact however few the groups are: given the even z, the sum of the
products of neighbours is normal in the odd z, with the denominator as its variance. Over its mean
variance, as usual, it exceeds the .001 quantile ten times too often where there are ten groups.

Whitened residuals of a fit of Jacobian J and covariance C of its estimate, priors included, are not
independent: sums A r over groups have the covariance A Aᵀ − (A J) C (A J)ᵀ.
"""

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.estimation.scores import ModelTest

_FEWEST = 8  # groups that a correlation is computed from
_LEFT = 1e-6  # least variance of a group's mean after the fit; below, the fit determines it


def standardised_innovations(off: Array, s: Array) -> Array:
    """Return innovations (e, m) over their standard deviations; NaN if none was observed."""
    return np.divide(off, np.sqrt(s), out=np.full(off.shape, np.nan), where=s > 0)


def epoch_groups(time: Array, middle: Array, duration: Array) -> NDArray[np.int64]:
    """Return for each epoch the number of the step that it is in, (e,); -1 for none.

    Parameters
    ----------
    time : (e,) array
        s, of the epochs.
    middle, duration : (r,) arrays
        s, of the steps.
    """
    group = np.full(time.size, -1)
    for number, (centre, seconds) in enumerate(zip(middle, duration, strict=True)):
        group[np.abs(time - centre) <= seconds / 2] = number
    return group


def group_innovations(standard: Array, group: NDArray[np.int64]) -> Array:
    """Return z of each group, (g, m): the sum of its innovations over the root of their number.

    Parameters
    ----------
    standard : (e, m) array
        NaN if nothing was observed.
    group : (e,) array of int
        Of each epoch, from 0 on; an epoch with a negative number is in no group. Groups without an
        epoch are omitted.
    """
    kept = (group >= 0) & np.isfinite(standard).all(axis=1)
    at = group[kept]
    number = np.bincount(at)
    total = np.stack([np.bincount(at, column) for column in standard[kept].T], axis=-1)
    return total[number > 0] / np.sqrt(number[number > 0])[:, None]


def mean_and_whiteness_tests(z: Array, means: str, whiteness: str) -> tuple[ModelTest, ...]:
    """Return the tests of the groups' means, and of their correlation in the order of time.

    Parameters
    ----------
    z : (g, m) array
        As for `group_innovations`.
    means, whiteness : str
        Names of the tests.
    """
    g, m = z.shape
    result = [ModelTest(means, float(np.sum(z**2)), g * m)] if g else []
    if g >= _FEWEST:
        beside = z[:-1:2][: g // 2].copy()
        after = z[2::2]
        beside[: len(after)] += after
        variance = float(np.sum(beside**2))
        result.append(ModelTest(whiteness, float(np.sum(z[1::2] * beside)) ** 2 / variance, 1))
    return tuple(result)


def residual_mean_test(z: Array, slope: Array, covariance: Array, means: str) -> ModelTest:
    """Return the test of the means of a fit's residuals over groups.

    Parameters
    ----------
    z : (k,) array
        Sums over groups as for `group_innovations`, in any order.
    slope : (k, p) array
        The same sums of the whitened Jacobian.
    covariance : (p, p) array
        Of the estimate, by data and priors.
    means : str
        Name of the test.
    """
    spread = np.eye(len(z)) - slope @ covariance @ slope.T
    values, vectors = np.linalg.eigh(spread)
    kept = values > _LEFT
    t = vectors[:, kept].T @ z / np.sqrt(values[kept])
    return ModelTest(means, float(t @ t), int(kept.sum()))
