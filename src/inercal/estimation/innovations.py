"""A filter's estimates and innovations by epoch, and tests in groups that reveal small biases.

A sum of squares over all epochs can hide a small bias. If the filter's model is right, its
innovations divided by their standard deviations are independent and N(0, 1). The sum over a group
of n epochs divided by √n is again N(0, 1), but a bias b in each of them grows to √n b. For g groups
and m components::

    means       Σ z²                                          χ² of m g degrees of freedom
    whiteness   (Σ z_i · z_i+1)² / Σ_odd |z_i−1 + z_i+1|²     χ² of one

(Bar-Shalom, Li and Kirubarajan 2001, Estimation with Applications to Tracking and Navigation,
section 5.4). The second test is exact for any number of groups: given the even z, the sum of the
products of neighbours is normal in the odd z, with the denominator as its variance. If it is
divided by its mean variance instead, as is usual, it exceeds the .001 quantile ten times too often
with ten groups.

The whitened residuals of a fit are not independent. If J is the Jacobian and C the covariance of
the estimate, including priors, sums A r over groups have the covariance A Aᵀ − (A J) C (A J)ᵀ.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.estimation.lazy_value import LazyValue
from inercal.estimation.scores import ModelTest


class StateEstimate(NamedTuple):
    """The current estimate of a filter's states, or of its constants."""

    value: Array  # (s,)
    covariance: Array  # (s, s)


@dataclass(frozen=True, eq=False)
class SmoothedStates:
    """Smoothed estimates, from all epochs, of states that vary with time.

    Parameters
    ----------
    names : tuple of r str
    value, std : (k, r) arrays
        Estimates and standard deviations at the epochs `FilterHistory.shown`.
    """

    names: tuple[str, ...]
    value: Array
    std: Array


@dataclass(frozen=True, eq=False)
class FilterHistory:
    """The estimates and innovations of one filter over a run.

    Parameters
    ----------
    name : str
        Name of the filter.
    names : tuple of n str
        Names of the estimated states.
    time : (e,) array
        Time of each epoch, s.
    value, std : (k, n) arrays
        Estimates and standard deviations after the epochs `shown`.
    innovation : (e, q) array
        Observation minus prediction.
    nis : (e,) array
        Normalised innovation squared over q components; its mean is q if the model is right.
    smoothing : LazyValue of SmoothedStates or None
        None if no state is smoothed.
    shown : (k,) array of int or None
        Epochs whose estimates are kept: evenly spaced ones and the last; None means all epochs.
    """

    name: str
    names: tuple[str, ...]
    time: Array
    value: Array
    std: Array
    innovation: Array
    nis: Array
    smoothing: LazyValue[SmoothedStates] | None = None
    shown: Indices | None = None

    @property
    def smoothed(self) -> SmoothedStates | None:
        """The smoothed states; None if no state is smoothed."""
        return self.smoothing and self.smoothing()

    @property
    def shown_time(self) -> Array:
        """Times of the epochs whose estimates are kept, (k,) s."""
        return self.time if self.shown is None else self.time[self.shown]


_FEWEST = 8  # least number of groups for a correlation
_LEFT = 1e-6  # least variance of a group's mean after the fit; below, the fit determines it


def standardised_innovations(off: Array, s: Array) -> Array:
    """Return innovations (e, m) divided by their standard deviations; NaN if none was observed."""
    return np.divide(off, np.sqrt(s), out=np.full(off.shape, np.nan), where=s > 0)


def epoch_groups(time: Array, middle: Array, duration: Array) -> Indices:
    """Return the index of the step that contains each epoch, (e,), or -1 if there is none.

    Parameters
    ----------
    time : (e,) array
        Times of the epochs, s.
    middle, duration : (r,) arrays
        Middle time and duration of each step, s.
    """
    group = np.full(time.size, -1)
    for number, (centre, seconds) in enumerate(zip(middle, duration, strict=True)):
        group[np.abs(time - centre) <= seconds / 2] = number
    return group


def group_innovations(standard: Array, group: Indices) -> Array:
    """Return z for each group, (g, m): the sum of its n innovations divided by √n.

    Parameters
    ----------
    standard : (e, m) array
        Standardised innovations; NaN if nothing was observed.
    group : (e,) array of int
        Group of each epoch, counted from 0; a negative number means no group. Groups without epochs
        are omitted.
    """
    kept = (group >= 0) & np.isfinite(standard).all(axis=1)
    at = group[kept]
    number = np.bincount(at)
    total = np.stack([np.bincount(at, column) for column in standard[kept].T], axis=-1)
    return total[number > 0] / np.sqrt(number[number > 0])[:, None]


def mean_and_whiteness_tests(z: Array, means: str, whiteness: str) -> tuple[ModelTest, ...]:
    """Return the tests of the groups' means and of the correlation between successive groups.

    Parameters
    ----------
    z : (g, m) array
        Group sums as returned by `group_innovations`.
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
    """Return the test of the group means of a fit's residuals.

    Parameters
    ----------
    z : (k,) array
        Group sums as in `group_innovations`, in any order.
    slope : (k, p) array
        The same group sums for the whitened Jacobian.
    covariance : (p, p) array
        Covariance of the estimate from data and priors.
    means : str
        Name of the test.
    """
    spread = np.eye(len(z)) - slope @ covariance @ slope.T
    values, vectors = np.linalg.eigh(spread)
    kept = values > _LEFT
    t = vectors[:, kept].T @ z / np.sqrt(values[kept])
    return ModelTest(means, float(t @ t), int(kept.sum()))
