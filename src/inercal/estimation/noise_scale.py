"""By what factor the noise of some observations was stated too large, or too small.

With the observations' noise s times as stated, priors and other observations unchanged, whitened
residuals r of m observations with Jacobian A have, for restricted maximum likelihood::

    |r(s)|²/s² = ν(s)        ν(s) = m − tr(C(s) AᵀA)/s²,   C(s) = (AᵀA/s² + M)⁻¹

where M is the information of all else and r(s) are the residuals after the fit with this s. The
stated noise over that found is 1/s. At s = 1 the sum of squares q = |r|² has the mean ν = tr T and
the variance 2 tr T², T = 1 − A C Aᵀ; q tr T / tr T² is nearly χ² with (tr T)² / tr T² degrees of
freedom. Where priors explain all residuals, nothing can be said, and ν is near 0.

Sources: Patterson and Thompson 1971, Biometrika 58, 545–554 (restricted likelihood); Satterthwaite
1946, Biometrics Bulletin 2, 110–114.
"""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false

from collections.abc import Callable
from typing import NamedTuple, cast

import numpy as np
import scipy
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.estimation.singular_values import column_lengths

_RANGE = float(np.log(1e4))  # of s, either way
_EXACT = 1e-6  # of ln s
_FEWEST = 1.0  # degrees of freedom


class WhitenedRows(NamedTuple):
    """A problem linearised at its solution: m observations and b rows of priors, k coordinates."""

    residual: Array  # (m,)
    jacobian: Array  # (m, k)
    prior: Array  # (b,), of the priors
    prior_jacobian: Array  # (b, k)
    whiten: Callable[[Array], Array]  # from changes of the observations, (m, q), to whitened ones

    def effects(self, change: Array) -> tuple[Array, Array]:
        """Return the effects of changes of the observations that the model does not contain.

        Parameters
        ----------
        change : (m, q) array
            Of the observations, in their units.

        Returns
        -------
        shift : (k, q) array
            Of the estimate, by the unit of each change.
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
    """Noise that was stated, over that found in the residuals.

    Parameters
    ----------
    ratio : float
        Stated standard deviation over that found.
    dof : float
        Degrees of freedom that the residuals have for it.
    p_value : float
        Probability of residuals as small as these if the noise is as stated.
    """

    ratio: float
    dof: float
    p_value: float


def noise_scale(
    rows: WhitenedRows, chosen: NDArray[np.bool_], level: float = 1.0
) -> NoiseScale | None:
    """Return how the noise of some observations was stated.

    Parameters
    ----------
    rows : WhitenedRows
    chosen : (m,) array of bool
        The observations whose noise is judged together.
    level : float, optional
        Probability of smaller residuals, above which nothing is looked for.

    Returns
    -------
    NoiseScale or None
        None if the residuals of these observations do not depend on their noise, or are as large as
        chance makes them at this level.
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
    s = float(np.exp(cast("float", scipy.optimize.brentq(beyond, -_RANGE, _RANGE, xtol=_EXACT))))
    return NoiseScale(1 / s, dof, p_value)
