"""Estimate the factor by which the noise of some observations was stated too large or too small.

Assume that the noise of m observations is s times the stated noise, while priors and other
observations are unchanged. For whitened residuals r and Jacobian A, restricted maximum likelihood
then requires::

    |r(s)|²/s² = ν(s)        ν(s) = m − tr(C(s) AᵀA)/s²,   C(s) = (AᵀA/s² + M)⁻¹

where M is the information from everything else and r(s) are the residuals after the fit with this
s. The ratio of stated to estimated noise is 1/s. At s = 1 the sum of squares q = |r|² has the mean
ν = tr T and the variance 2 tr T², where T = 1 − A C Aᵀ. Therefore q tr T / tr T² is nearly χ² with
(tr T)² / tr T² degrees of freedom. If priors explain all residuals, ν is near 0 and the noise
cannot be judged.

Sources: Patterson and Thompson 1971, Biometrika 58, 545–554 (restricted likelihood); Satterthwaite
1946, Biometrics Bulletin 2, 110–114.
"""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false

from collections.abc import Callable
from typing import NamedTuple, cast

import numpy as np
import scipy

from inercal.basics.arrays import Array, Bools
from inercal.estimation.whitened_problem import column_lengths

LEAST_RATIO = 1.3  # stated over observed; less is harmless, and 1.5 times always exceeds it
LEVEL = 1e-3  # significance level for all comparisons of a run together
_RANGE = float(np.log(1e4))  # s is between 1e-4 and 1e4
_EXACT_LOG = 1e-6  # tolerance for ln s
_FEWEST = 1.0  # degrees of freedom


class WhitenedRows(NamedTuple):
    """A problem linearised at its solution: m observations, b prior rows and k coordinates."""

    residual: Array  # (m,)
    jacobian: Array  # (m, k)
    prior: Array  # (b,), of the priors
    prior_jacobian: Array  # (b, k)
    whiten: Callable[[Array], Array]  # whitens changes of the observations, (m, q)

    def effects(self, change: Array) -> tuple[Array, Array]:
        """Return the effects of changes in the observations that the model does not include.

        Parameters
        ----------
        change : (m, q) array
            Changes of the observations, in their units.

        Returns
        -------
        shift : (k, q) array
            Shift of the estimate per unit of each change.
        visibility : (q,) array
            Norm of the whitened residual that each change leaves.
        """
        rows = np.concatenate([self.jacobian, self.prior_jacobian])
        size = column_lengths(rows)
        white = np.concatenate([self.whiten(change), np.zeros((len(self.prior), change.shape[1]))])
        q, triangle = np.linalg.qr(rows / size)
        taken = q.T @ white
        left = white - q @ taken
        shift = np.linalg.pinv(triangle) @ taken / size[:, None]
        return shift, np.linalg.norm(left, axis=0)


class NoiseScale(NamedTuple):
    """The ratio of the stated noise to the noise estimated from the residuals.

    Parameters
    ----------
    ratio : float
        Stated standard deviation divided by the estimated one.
    dof : float
        Degrees of freedom of the residuals for this comparison.
    p_value : float
        Probability of residuals as small as these if the noise is as stated.
    """

    ratio: float
    dof: float
    p_value: float


def noise_scale(rows: WhitenedRows, chosen: Bools, level: float = 1.0) -> NoiseScale | None:
    """Compare the stated noise of some observations with the noise in their residuals.

    Parameters
    ----------
    rows : WhitenedRows
    chosen : (m,) array of bool
        The observations whose noise is judged together.
    level : float, optional
        Significance level: the ratio is computed only if residuals this small are less probable
        than this.

    Returns
    -------
    NoiseScale or None
        None if the residuals of these observations do not depend on their noise, or if their size
        is plausible at this level.
    """
    size = column_lengths(np.concatenate([rows.jacobian, rows.prior_jacobian]))
    a, r = rows.jacobian[chosen] / size, rows.residual[chosen]
    other = np.concatenate([rows.jacobian[~chosen], rows.prior_jacobian]) / size
    left = np.concatenate([rows.residual[~chosen], rows.prior])
    own, rest = a.T @ a, other.T @ other
    pull, pulled = a.T @ r, other.T @ left
    m = len(r)

    def state(s: float) -> tuple[float, float, Array]:
        covariance = np.linalg.pinv(own / s**2 + rest, hermitian=True)
        move = covariance @ (pull / s**2 + pulled)
        square = float(np.sum((r - a @ move) ** 2)) / s**2
        shared: Array = np.asarray(covariance @ own / s**2, dtype=np.float64)
        return square, m - float(np.trace(shared)), shared

    square, trace, shared = state(1.0)
    second = m - 2 * float(np.trace(shared)) + float(np.sum(shared * shared.T))
    if trace < _FEWEST or second <= 0:
        return None
    dof = trace**2 / second
    p_value = float(scipy.special.chdtr(dof, square * trace / second))
    if p_value > level:
        return None

    def beyond(log: float) -> float:
        found, expected, _ = state(float(np.exp(log)))
        return found - expected

    if not beyond(-_RANGE) > 0 > beyond(_RANGE):
        return None
    s = float(np.exp(cast("float", scipy.optimize.brentq(beyond, -_RANGE, _RANGE, xtol=_EXACT_LOG))))
    return NoiseScale(1 / s, dof, p_value)
