"""Estimate from residuals how much noise to add, or by which factor to scale the stated noise.

If observations scatter by more than their noise, they have errors that do not average out with more
samples: the means of two identical rests then differ by more than their noise. Enlarging every
variance by χ²/ν (Birge) would leave the longest observations with the largest weights. Adding the
same variance v to all observations avoids this. v is chosen so that χ² equals its expectation::

    χ²(v) = ν

If observations scatter by less than their noise, the samples contain motion that averages out in
the means, such as hand tremor. Then only a share s ≤ 1 of the noise counts::

    χ²(s) = ν − 2        since the mean of 1/χ² with ν degrees of freedom is 1/(ν − 2)

Variance is added if χ² exceeds its 95 % bound. The noise is reduced to a share if χ² is below its 1
% bound, but only if the noise was estimated from the samples. Stated noise is never reduced.

Source: Paule and Mandel 1982, J. Research NBS 87, 377–385, equations 8 to 10, for v in a weighted
mean, applied here to any linear model. χ² decreases with v and with s, so there is at most one
root.

To find the factor by which noise was stated too large or too small, assume that the noise of m
observations is s times the stated noise, while priors and other observations are unchanged. For
whitened residuals r and Jacobian A, restricted maximum likelihood then requires::

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
from inercal.estimation.scores import chi2_tail_probability
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
    s = float(
        np.exp(cast("float", scipy.optimize.brentq(beyond, -_RANGE, _RANGE, xtol=_EXACT_LOG)))
    )
    return NoiseScale(1 / s, dof, p_value)


_LEVEL = 0.95
_CALM = 0.99  # a share chosen by chance would understate the noise
_FEW = 8  # degrees of freedom; with so few, no share is estimated
_LEAST = -20 * np.log(2.0)  # lower bound of the logarithm of a variance, relative to the upper one
_EXACT = 1e-7  # tolerance for the root


class ScatterModel(NamedTuple):
    """The scatter of one kind of readings: a share of their noise, plus added noise."""

    share: float = 1.0  # share of the variance
    excess: float = 0.0  # standard deviation of each component

    def of(self, noise: Array, fixed: Array | None = None) -> Array:
        """Return the covariance `noise` (..., m, m) with the share and the excess applied.

        `fixed` contains variances (..., m) that are part of the noise but are not reduced.
        """
        added = self.excess**2 * np.eye(noise.shape[-1])
        if fixed is not None and self.share != 1:
            added = added + (1 - self.share) * fixed[..., None] * np.eye(noise.shape[-1])
        return self.share * noise + added


def chi_squared(residual: Array, jacobian: Array, whiten: Callable[[Array], Array]) -> float:
    """Return the minimum over the parameters of the sum of squared whitened residuals.

    Parameters
    ----------
    residual : (m,) array
    jacobian : (m, p) array
    whiten : callable
        Function that whitens an array (m, k).
    """
    both = whiten(np.column_stack([jacobian, residual]))
    both[:, :-1] /= column_lengths(both[:, :-1])
    triangle: Array = np.asarray(np.linalg.qr(both, mode="r"), dtype=np.float64)
    p = jacobian.shape[1]
    return float(np.sum(triangle[p:, p] ** 2))


def fit_scatter(
    residual: Array,
    jacobian: Array,
    whiten: Callable[[ScatterModel, Array], Array],
    dof: int,
    other_chi2: float = 0.0,
    least: float = 0.0,
    *,
    stated: bool = False,
) -> ScatterModel:
    """Return the scatter of the observations, estimated from their residuals.

    Parameters
    ----------
    residual : (m,) array
        Residuals at a solution.
    jacobian : (m, p) array
    whiten : callable
        Function of the spread and an array (m, k) that whitens the array for the noise with that
        spread.
    dof : int
        Degrees of freedom of the tested observations.
    other_chi2 : float
        χ² of the other observations in these rows.
    least : float
        Smallest share that can be estimated; below it, other noise in the same rows dominates.
    stated : bool
        Whether the noise was stated, not estimated from samples. Stated noise is not reduced.
    """
    if dof < 1:
        return ScatterModel()

    def off(found: ScatterModel) -> float:
        return chi_squared(residual, jacobian, lambda a: whiten(found, a)) - other_chi2

    by_noise = off(ScatterModel())
    if by_noise > float(scipy.special.chdtri(dof, 1 - _LEVEL)):
        high = float(np.mean(residual**2))
        while off(ScatterModel(excess=high**0.5)) > dof:
            high *= 4.0
        v = _falling_root(lambda v: off(ScatterModel(excess=v**0.5)) - dof, high)
        return ScatterModel(excess=v**0.5)
    if not stated and dof > _FEW and by_noise < float(scipy.special.chdtri(dof, _CALM)):
        share = _falling_root(lambda s: off(ScatterModel(share=s)) - (dof - 2), 1.0)
        return ScatterModel(share=min(max(share, least), 1.0))
    return ScatterModel()


def leave_one_out_factors(rows: Array, noise_dof: float = np.inf) -> Array:
    """Return factors, (r,), that rescale each whitened row by the scatter of the other rows.

    A factor is 1 if the scatter of the other rows is within its 95 % bound. Otherwise the ratio of
    the row's sum of squares to that of the others has an F distribution, and the factor converts it
    to the χ² with the same p-value.

    Parameters
    ----------
    rows : (r, q) array
    noise_dof : float
        Degrees of freedom of the noise estimate used for whitening.
    """
    r, q = rows.shape
    squares = np.sum(rows**2, axis=1)
    dof = q * (r - 1)
    factor = np.ones(r)
    if dof < 1:
        return factor
    others = squares.sum() - squares
    for k, beyond in enumerate(others.tolist()):
        if chi2_tail_probability(beyond, dof, noise_dof) > 1 - _LEVEL:
            continue
        ratio = float(squares[k]) / q / (float(others[k]) / dof)
        p = float(scipy.special.fdtrc(q, dof, ratio))
        equal = float(scipy.special.chdtri(q, p)) if p > 0 else np.inf
        whole = min(equal, q * ratio)
        factor[k] = np.sqrt(whole / float(squares[k])) if squares[k] > 0 else 1.0
    return factor


def _falling_root(falling: Callable[[float], float], high: float) -> float:
    """Return the root of a falling function, negative at `high`, but at least high / 2²⁰."""

    def at(log: float) -> float:
        return falling(high * float(np.exp(log)))

    if at(_LEAST) <= 0:
        return high * float(np.exp(_LEAST))
    log = cast("float", scipy.optimize.brentq(at, _LEAST, 0.0, xtol=_EXACT))
    return high * float(np.exp(log))
