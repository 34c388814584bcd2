"""The scatter of one coefficient that the uncertainties of its sessions do not explain.

Let V be the covariance of the k values of one coefficient due to their own uncertainties. The
variance σ² maximises the restricted likelihood of y ~ N(θ, V + σ²). Sessions are weighted by their
uncertainty, because a session with a large uncertainty cannot show a small scatter. If there is no
scatter, the weighted sum of squares about the mean follows χ² with k − 1 degrees of freedom. σ² is
only used if this sum is larger than expected by chance.
"""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.laboratory.repeatability.sessions import MatchedSessions

CHANCE = 0.05
"""If chance is less probable than this, the scatter increases U of the mean."""
CHANCE_IN_NEXT_USE = 0.2
"""The same for the next use; 0.05 would reduce coverage by 2 % if scatter equals noise."""
_STEPS = 81  # number of steps in a grid of σ
_REFINEMENTS = 3
_LEAST = 1e-3  # σ relative to the spread of the values, next to 0


@dataclass(frozen=True, eq=False)
class SingleScatter:
    """The scatter of each coefficient, estimated from its own values.

    Parameters
    ----------
    variance : (p,) array
        Variance σ² of the scatter.
    squares : (p,) array
        Weighted sum of squares about the mean, computed without scatter.
    chance : (p,) array
        Probability that the sum would be this large if there were no scatter.
    """

    variance: Array
    squares: Array
    chance: Array

    @property
    def counts(self) -> NDArray[np.bool_]:
        """Whether the sessions' own uncertainties do not explain the scatter, (p,)."""
        return self.chance < CHANCE

    @property
    def counts_in_next_use(self) -> NDArray[np.bool_]:
        """Whether the uncertainties hardly explain the scatter, (p,); used for the next use."""
        return self.chance < CHANCE_IN_NEXT_USE


def single_scatter(values: Array, covariance: Array) -> SingleScatter:
    """Estimate the scatter of each coefficient from its own values.

    Parameters
    ----------
    values : (k, p) array
    covariance : (p, k, k) array
        Covariance V of each coefficient.
    """
    k, size = values.shape
    found = np.zeros((3, size))
    for j in range(size):
        found[:2, j] = _restricted(values[:, j], covariance[j])
    found[2] = scipy.special.chdtrc(k - 1, found[1])
    return SingleScatter(found[0], found[1], found[2])


def covariances_by_coefficient(matched: MatchedSessions, own: Array, unit: Array) -> Array:
    """Return V of each coefficient, (p, k, k), including errors shared by only some sessions.

    Parameters
    ----------
    matched : MatchedSessions
    own : (k, p, p) array
        Covariances without shared errors, in the units `unit`, (p,).
    """
    k, size = own.shape[:2]
    result = np.zeros((size, k, k))
    result[:, np.arange(k), np.arange(k)] = np.diagonal(own, axis1=1, axis2=2).T
    for one in matched.shared:
        if not one.is_common:
            column = (one.column / unit).T
            result += column[:, :, None] * column[:, None, :]
    return result


def _restricted(y: Array, covariance: Array) -> tuple[float, float]:
    """Return σ², and the weighted sum of squares for σ² = 0."""
    eigenvalues, vectors = np.linalg.eigh(covariance)
    variance: Array = np.maximum(eigenvalues, 1e-12 * float(eigenvalues.max()))
    x: Array = vectors.sum(axis=0)
    z: Array = vectors.T @ (y - np.median(y))

    def likelihood(excess: Array) -> tuple[Array, Array]:
        total = variance + excess[:, None]
        information = (x**2 / total).sum(axis=1)
        mean = (x * z / total).sum(axis=1) / information
        squares = ((z - np.outer(mean, x)) ** 2 / total).sum(axis=1)
        return -0.5 * (np.log(total).sum(axis=1) + np.log(information) + squares), squares

    spread = float(np.ptp(y))
    squares = float(likelihood(np.zeros(1))[1][0])
    if spread == 0:
        return 0.0, squares
    sd: Array = np.zeros(_STEPS)
    logarithms: Array = np.linspace(float(np.log(_LEAST)), float(np.log(2.0)), _STEPS - 1)
    sd[1:] = spread * np.exp(logarithms)
    for _ in range(_REFINEMENTS):
        best = int(np.argmax(likelihood(sd**2)[0]))
        if best == 0 and sd[0] == 0:
            return 0.0, squares
        low, high = float(sd[max(best - 1, 0)]), float(sd[min(best + 1, sd.size - 1)])
        sd[:] = low + (high - low) * np.linspace(0.0, 1.0, _STEPS)
    return float(sd[int(np.argmax(likelihood(sd**2)[0]))]) ** 2, squares
