"""The noise that residuals show: variance beyond the stated noise, or a share of it.

Observations that scatter by more than their noise have errors that more samples do not average
out: the means of two equal rests differ by more than their noise. Enlarging every variance by χ²/ν
(Birge) leaves the longest observations with the largest weights; adding one variance v to all does
not. v is the value at which χ² has its expectation::

    χ²(v) = ν

Where observations scatter by less than their noise, the samples contain motion that averages out in
the means: the wobble of a hand. Then only a share s ≤ 1 of the noise counts::

    χ²(s) = ν − 2        since the mean of 1/χ² with ν degrees of freedom is 1/(ν − 2)

Variance is added where χ² exceeds its 95 % bound; a share is taken below its 1 % bound, and only of
noise that was found in the samples. Stated noise is not reduced.

Source: Paule and Mandel 1982, J. Research NBS 87, 377–385, equations 8 to 10, for v in a weighted
mean; here for any linear model. χ² falls with v and with s, so there is one root or none.
"""

# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false

from collections.abc import Callable
from typing import NamedTuple, cast

import numpy as np
import scipy

from inercal.basics.arrays import Array
from inercal.estimation.scores import chi2_tail_probability
from inercal.estimation.singular_values import column_lengths

_LEVEL = 0.95
_CALM = 0.99  # a share taken by chance would state too little
_FEW = 8  # degrees of freedom that cannot tell a share
_LEAST = -20 * np.log(2.0)  # of the logarithm of a variance, beside the most
_EXACT = 1e-7  # of the root


class ScatterModel(NamedTuple):
    """The scatter of a kind of readings: a share of their stated noise, plus added noise."""

    share: float = 1.0  # of the variance
    excess: float = 0.0  # standard deviation of each component

    def of(self, noise: Array, fixed: Array | None = None) -> Array:
        """Return the covariance with both, of `noise` (..., m, m).

        `fixed`: variances (..., m) that are part of the noise, and of which no share is taken.
        """
        added = self.excess**2 * np.eye(noise.shape[-1])
        if fixed is not None and self.share != 1:
            added = added + (1 - self.share) * fixed[..., None] * np.eye(noise.shape[-1])
        return self.share * noise + added


def chi_squared(residual: Array, jacobian: Array, whiten: Callable[[Array], Array]) -> float:
    """Return the least sum of squares of whitened residuals over moves of the parameters.

    Parameters
    ----------
    residual : (m,) array
    jacobian : (m, p) array
    whiten : callable
        From (m, k) to the same whitened.
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
    """Return how the observations scatter, by their residuals.

    Parameters
    ----------
    residual : (m,) array
        At a solution.
    jacobian : (m, p) array
    whiten : callable
        (spread, (m, k) array) to the array whitened by the noise with that spread.
    dof : int
        Degrees of freedom of the observations that are judged.
    other_chi2 : float
        χ² of others among the rows.
    least : float
        The share below which other noise of the same rows hides what it is.
    stated : bool
        Whether the noise was stated rather than found in samples: no share is taken of it.
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
    """Return factors on whitened rows by which each is judged by the others' scatter, (r,).

    One where the others do not scatter beyond their 95 % bound. Elsewhere a row's sum of squares
    over theirs is F, and the factor gives it the χ² of the same p-value.

    Parameters
    ----------
    rows : (r, q) array
    noise_dof : float
        Degrees of freedom behind the noise that whitened them.
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
    """Return where a function that is negative at `high` has its root, or high / 2²⁰ if lower."""

    def at(log: float) -> float:
        return falling(high * float(np.exp(log)))

    if at(_LEAST) <= 0:
        return high * float(np.exp(_LEAST))
    log = cast("float", scipy.optimize.brentq(at, _LEAST, 0.0, xtol=_EXACT))
    return high * float(np.exp(log))
