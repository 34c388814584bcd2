"""Predict the value of a new member of a population from measurements of other members (N ≥ 3).

Member i has the value θ_i ~ N(μ, τ²) and was measured as y_i = θ_i + e_i with known cov(e) = C. The
members may share errors, so C need not be diagonal. With V = τ² I + C, the weighted mean and the
sum of squares about it are::

    A = 1ᵀV⁻¹1,   μ̂ = 1ᵀV⁻¹y / A,   Q(τ²) = yᵀV⁻¹y − A μ̂²

At the true τ², Q has a χ² distribution with N − 1 degrees of freedom, and Q falls with τ². The
solutions of Q(τ²) = χ² for all quantiles of χ² are the confidence distribution of τ²; it has an
atom at τ² = 0 if the members scatter little. The new member follows the mixture of
N(μ̂, τ² + 1/A) over this distribution. If C = 0, this is Student's t with N − 1 degrees of freedom
and the variance (1 + 1/N) s². A plug-in of an estimate of τ² would be too narrow, because the
estimate is often 0, and a Bayesian reference prior of τ is too wide for three to five members.

Source: Nagashima, Noma and Furukawa 2019, Stat. Methods Med. Res. 28, 1689-1702.
"""

# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false

from collections.abc import Callable
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri, ndtr, stdtrit

from inercal.basics.arrays import Array
from inercal.estimation.uncertainty import COVERAGE, COVERAGE_PROBABILITY
from inercal.estimation.uncertainty.repeated_measurements import restricted_variances

_LOGITS = np.linspace(-18.0, 18.0, 181)  # nodes of the distribution of τ², dense in both tails
_TAIL = 1 / (1 + np.exp(_LOGITS))
_WEIGHTS = _TAIL * (1 - _TAIL) / np.sum(_TAIL * (1 - _TAIL))
_HALVINGS = 55
_LARGEST_SCATTER = int(np.argmin(np.abs(_TAIL - 0.999)))  # its upper confidence limit
_MOST_SHARE = 0.99  # two new members are never known to be equal
_ONE_SIGMA = 0.6827
_DOF = (0.5, 1e4)  # range of the degrees of freedom
_FLOOR = 1e-12  # smallest eigenvalue of C relative to its trace; C may be singular
_TINY = float(np.finfo(float).tiny)
_EM_STEPS = 400
_EM_CHANGE = 1e-7


class NewMember(NamedTuple):
    """Prediction of one value of a new member.

    Parameters
    ----------
    mean : float
    sd : float
        Half of the half-width that covers 95.45 %, so that U = 2 sd has this coverage.
    dof : float
        Degrees of freedom of the Student t distribution with the same widths at 68.27 % and
        95.45 %.
    between_sensors : float
        Standard deviation τ between members, estimated by REML; it may be 0.
    mean_share : float
        Fraction of sd² that is due to the mean and common to all new members, if the scatter is at
        its upper 99.9 % confidence limit. With a smaller scatter, few members that agree by chance
        would claim to know the difference of two new members exactly.
    """

    mean: float
    sd: float
    dof: float
    between_sensors: float
    mean_share: float


class _Mixture:
    """The mixture of normal distributions that a new member follows."""

    def __init__(self, y: Array, covariance: Array):
        n = len(y)
        self._values, self._vectors = np.linalg.eigh(covariance)
        floor = _FLOOR * (np.trace(covariance) / n + np.var(y) + _TINY)
        self._values = np.maximum(self._values, floor)
        self._one = self._vectors.sum(axis=0)
        self._centre = float(y.mean())
        self._y = self._vectors.T @ (y - self._centre)
        self.variance = self._confidence_quantiles(n)
        self.mean, self.mean_variance, _ = self._fit(self.variance)
        self.mean = self.mean + self._centre
        self.sd = np.sqrt(self.variance + self.mean_variance)

    def _fit(self, variance: Array) -> tuple[Array, Array, Array]:
        """Return μ̂ without the centre, 1/A and Q for each τ²."""
        weight = 1 / (variance[:, None] + self._values)
        total, product = weight @ self._one**2, weight @ (self._one * self._y)
        mean = product / total
        return mean, 1 / total, weight @ self._y**2 - product * mean

    def _confidence_quantiles(self, n: int) -> Array:
        """Return the solutions of Q(τ²) = χ² by bisection; 0 if there is none."""
        target = chdtri(n - 1, _TAIL)
        low, high = np.zeros_like(target), float(self._y @ self._y) / target
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            above = self._fit(middle)[2] > target
            low, high = np.where(above, middle, low), np.where(above, high, middle)
        return low

    @cached_property
    def centre(self) -> float:
        return float(_WEIGHTS @ self.mean)

    def half_width(self, coverage: float) -> float:
        """Return the half-width of the interval about the centre with this coverage."""
        off = self.mean - self.centre

        def excess(half: float) -> float:
            inside = ndtr((half - off) / self.sd) - ndtr((-half - off) / self.sd)
            return float(_WEIGHTS @ inside) - coverage

        high = float(np.median(self.sd))
        while excess(high) < 0:
            high *= 2
        return _zero(excess, 0.0, high)

    def p_value(self, value: float, variance: float, common: Array) -> float:
        """Return the two-sided probability that a measurement of a new member is further off.

        Parameters
        ----------
        value, variance : float
            The measured value and its own variance.
        common : (n,) array
            Covariance of the measurement with those of the other members.
        """
        weight = self._one / (self.variance[:, None] + self._values) * self.mean_variance[:, None]
        shared = weight @ (self._vectors.T @ common)
        total = np.maximum(self.sd**2 + variance - 2 * shared, _TINY)
        return float(_WEIGHTS @ (2 * ndtr(-np.abs(value - self.mean) / np.sqrt(total))))


def predict_new_member(y: Array, covariance: Array) -> NewMember:
    """Return the prediction of a new member.

    Parameters
    ----------
    y : (n,) array
        Measured values of n ≥ 3 members.
    covariance : (n, n) array
        Covariance of the measurements, positive semidefinite.
    """
    n = len(y)
    unit = float(np.sqrt(np.var(y, ddof=1) + np.trace(covariance) / n))
    values, known = (y - y.mean()) / unit, covariance / unit**2
    found = _Mixture(values, known)
    width = found.half_width(COVERAGE_PROBABILITY)
    start = np.array([0.5 * float(np.var(values, ddof=1))])
    reml = restricted_variances(
        values, np.ones((n, 1)), known + _FLOOR * np.eye(n), [np.eye(n)], start
    )
    return NewMember(
        float(y.mean()) + unit * found.centre,
        unit * width / COVERAGE,
        _student_dof(width / found.half_width(_ONE_SIGMA)),
        unit * float(np.sqrt(reml.variance[0])),
        min(float((found.mean_variance / found.sd**2)[_LARGEST_SCATTER]), _MOST_SHARE),
    )


def _student_dof(ratio: float) -> float:
    """Return the degrees of freedom of t with this ratio of the widths at 95.45 % and 68.27 %."""

    def excess(log_dof: float) -> float:
        both = stdtrit(np.exp(log_dof), (1 + np.array([COVERAGE_PROBABILITY, _ONE_SIGMA])) / 2)
        return float(both[0] / both[1]) - ratio

    return float(np.exp(_zero(lambda log_dof: -excess(log_dof), *np.log(_DOF))))


def _zero(function: Callable[[float], float], low: float, high: float) -> float:
    """Return the zero of a rising function by bisection, or the end that is nearest to it."""
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if function(middle) < 0 else (low, middle)
    return high


def left_out_p_values(y: Array, covariance: Array) -> Array:
    """Return the p-value of each member, predicted from the others, (n,).

    The arguments are as for `predict_new_member`.
    """
    n = len(y)
    found = np.empty(n)
    for k in range(n):
        rest = np.arange(n) != k
        others = _Mixture(y[rest], covariance[np.ix_(rest, rest)])
        found[k] = others.p_value(float(y[k]), float(covariance[k, k]), covariance[rest, k])
    return found


def scatter_correlation(values: Array, own: Array, scatter: Array) -> tuple[Array, Array]:
    """Return the correlation of the scatter between members, and the covariance of the mean.

    The covariance T of the scatter is estimated by REML, by expectation and maximisation, with an
    inverse Wishart prior of p + 1 degrees of freedom about the uncorrelated T₀ = diag(`scatter`²).
    n members determine no full T if n ≤ p, and a poor one if n is a little larger. With exact
    measurements, the prior multiplies all correlations by (n − 1) / (n + p).

    Parameters
    ----------
    values : (n, p) array
    own : (n, p, p) array
        Covariances of the measurements, without errors that all members share.
    scatter : (p,) array
        Standard deviations; a coefficient with 0 is not correlated with any other.
    """
    n, p = values.shape
    correlation, mean_covariance = np.eye(p), np.zeros((p, p))
    unit = np.sqrt(np.linalg.diagonal(own).mean(axis=0) + scatter**2)
    known, square = own / np.outer(unit, unit), np.diag((scatter / unit) ** 2)
    y, seen = (values - values.mean(axis=0)) / unit, np.flatnonzero(scatter)
    t, prior = square.copy(), len(seen) + 1
    for _ in range(_EM_STEPS):
        weight = np.linalg.inv(t + known + _FLOOR * np.eye(p))
        mean_covariance = np.linalg.inv(weight.sum(axis=0))
        mean = mean_covariance @ np.einsum("nij,nj->i", weight, y)
        off = np.einsum("nij,nj->ni", weight, y - mean)
        projected = weight - weight @ mean_covariance @ weight
        step = (np.einsum("ni,nj->ij", off, off) - projected.sum(axis=0)) / n
        moved = (n * (t + t @ step @ t) + prior * square) / (n + prior)
        moved = (moved + moved.T) / 2  # an antisymmetric rounding error would grow
        change = np.abs(moved - t).max()
        t = moved
        if change < _EM_CHANGE:
            break
    sd = np.sqrt(np.diag(t)[seen])
    correlation[np.ix_(seen, seen)] = t[np.ix_(seen, seen)] / np.outer(sd, sd)
    return correlation, mean_covariance * np.outer(unit, unit)
