"""Model how a coefficient changes over time: as a constant level, a line or a random walk.

Calibrations at times t_i have values with independent variances s_i² and a shared covariance S. In
addition, each calibration scatters with the standard deviation τ::

    y = X β + e,   cov(e) = V + S,   V = diag(s_i²) + τ² I [+ q W],   W_ij = min(t_i, t_j)

X contains a column of ones, or a column of ones and a column of times. τ² and q maximise the
restricted likelihood. With A = Xᵀ(V + S)⁻¹X and G = A⁻¹Xᵀ(V + S)⁻¹, the covariances due to scatter
and due to shared errors are stated separately::

    cov_A(β) = c G V Gᵀ,   cov_B(β) = G S Gᵀ,   c = max(1, χ²/ν),   ν = n − p
    U² of x β          = t_ν² x cov_A xᵀ + 4 x cov_B xᵀ
    U² of the next use = t_ν² (τ² + x cov_A xᵀ) + 4 x cov_B xᵀ

Errors that all calibrations share shift the level, but not the slope. Level, line and walk are
compared by the likelihood of the same contrasts, which are the deviations of the values from their
mean. Line and walk have one parameter more than the level.

A random walk can look like a line: if a slope is also fitted, the estimate of q is too small. The
slope b is therefore also judged with τ² and q of the walk, which were fitted without a slope. Let T
= b/u(b) be computed with these values. T² of n values cannot exceed n − 1, because a slope that is
not fitted increases τ² and q. Then ::

    t² = ν T²/(ν + 1 − T²),   ν = n − 2

follows Student's distribution if the whole variance is estimated, which is true for a level with
scatter and for a pure walk. To be called a drift, |t| must reach a fraction of t_ν. This fraction,
0.7 to 0.8, was determined by simulation; with it, 8 % of random walks are called drifts.

Sources: JCGM 100:2008, H.3 and G.4; Patterson and Thompson, Biometrika 58 (1971), 545–554.
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.estimation.uncertainty import COVERAGE
from inercal.estimation.uncertainty.conformity import expanded_uncertainty
from inercal.estimation.uncertainty.repeated_measurements import (
    restricted_likelihood,
    restricted_variances,
)

Course = Literal["level", "line", "walk"]
NEWEST = 100
"""Largest number of calibrations in a fit; they are the newest calibrations."""
LEAST_FOR_DRIFT = 5
"""With fewer calibrations, no drift is reported, because their scatter is not well known."""
_LEAST_FOR_LINE = 3
_BESIDE_WALK, _BESIDE_WALK_OF_FEW = 0.8, {5: 0.7, 6: 0.75}
"""Fraction of t_ν that |t| of a slope must reach, in general and for few values."""
_AHEAD = 2.0  # gain of 2 ln(likelihood) that justifies another parameter (Akaike 1974)


class SlopeStatement(NamedTuple):
    """Drift per year, its standard uncertainty due to scatter, and its U."""

    slope: float
    std: float
    expanded: float


@dataclass(frozen=True, eq=False)
class CourseFit:
    """A level or a line that was fitted to n calibrations.

    Parameters
    ----------
    time : float
        Time for which `beta` states the value, in years on the time scale of the data.
    beta : (p,) array
        Value at `time` and, for a line, the slope per year.
    scatter, shared : (p, p) arrays
        Covariances cov_A due to scatter and cov_B due to shared errors.
    tau : float
        Standard deviation of the scatter from one calibration to the next.
    walk : float
        Variance q per year of a random walk; 0 if none is fitted.
    chi2 : float
    dof : int
    count : int
        Number n of calibrations.
    factor : float
        Coverage factor t_ν that gives the same coverage as 2u.
    """

    time: float
    beta: Array
    scatter: Array
    shared: Array
    tau: float
    walk: float
    chi2: float
    dof: int
    count: int
    factor: float

    def evaluate(self, time: Array) -> Array:
        """Return the fitted values at some times in years."""
        return self._columns(time) @ self.beta

    def expanded(self, time: Array, *, next_use: bool = False) -> Array:
        """Return U of the mean, or of the next use, at some times in years."""
        x = self._columns(time)
        by_scatter = np.einsum("ni,ij,nj->n", x, self.scatter, x)
        if next_use:
            by_scatter = by_scatter + self.tau**2
        shared = np.einsum("ni,ij,nj->n", x, self.shared, x)
        return np.sqrt(self.factor**2 * by_scatter + COVERAGE**2 * np.maximum(shared, 0.0))

    def _columns(self, time: Array) -> Array:
        off = np.atleast_1d(np.asarray(time, dtype=float)) - self.time
        return np.stack([np.ones_like(off), off][: len(self.beta)], axis=1)

    @property
    def slope(self) -> SlopeStatement:
        """The drift per year, which is 0 for a level."""
        if len(self.beta) == 1:
            return SlopeStatement(0.0, 0.0, 0.0)
        by_scatter, shared = self.scatter[1, 1], max(float(self.shared[1, 1]), 0.0)
        expanded = float(np.sqrt(self.factor**2 * by_scatter + COVERAGE**2 * shared))
        return SlopeStatement(float(self.beta[1]), float(np.sqrt(by_scatter)), expanded)

    @property
    def is_significant(self) -> bool:
        """Whether the slope exceeds its U and there are enough calibrations."""
        return self.count >= LEAST_FOR_DRIFT and abs(self.slope.slope) > self.slope.expanded


@dataclass(frozen=True, eq=False)
class CourseComparison:
    """Level, line and random walk fitted to the same calibrations.

    Parameters
    ----------
    level, line, walk : CourseFit
        The three fits; the walk is fitted as a level plus a random walk with q.
    wandering_line : CourseFit
        A line plus a random walk with q. The uncertainty of its slope includes the effect of the
        walk.
    likelihood : mapping of "level", "line", "walk" to float
        Logarithm of the restricted likelihood, minus the value for the level.
    beside_walk : float
        |t| of the slope, computed with the variances of the walk.
    """

    level: CourseFit
    line: CourseFit
    walk: CourseFit
    wandering_line: CourseFit
    likelihood: dict[Course, float]
    beside_walk: float

    @property
    def best(self) -> Course:
        """The best model: the level, unless a gain by line or walk justifies another parameter."""
        best: Course = "line" if self.likelihood["line"] >= self.likelihood["walk"] else "walk"
        return best if 2 * self.likelihood[best] > _AHEAD else "level"

    @property
    def drifts(self) -> bool:
        """Whether the slope exceeds its U and a random walk does not explain it equally well."""
        return (
            self.line.is_significant
            and self.wandering_line.is_significant
            and self.likelihood["line"] >= self.likelihood["walk"]
            and self.beside_walk > self._least_beside_walk
        )

    @property
    def _least_beside_walk(self) -> float:
        part = _BESIDE_WALK_OF_FEW.get(self.line.count, _BESIDE_WALK)
        return part * self.line.factor


def compare_courses(
    time: Array, values: Array, own: Array, shared: Array
) -> CourseComparison | None:
    """Fit level, line and walk; None if there are fewer than three values or all times are equal.

    Parameters
    ----------
    time : (n,) array
        Times in years.
    values, own : (n,) arrays
        Values and their independent variances, without the shared errors.
    shared : (n, n) array
        Covariance due to shared errors.
    """
    if values.size < _LEAST_FOR_LINE or np.ptp(time) == 0:
        return None
    level, line = (fit_course(time, values, own, shared, slope=one) for one in (False, True))
    walk, wandering = (
        fit_course(time, values, own, shared, slope=one, walks=True) for one in (False, True)
    )
    ones = np.ones((time.size, 1))

    def likelihood(fit: CourseFit) -> float:
        v = _covariance(time, own, fit.tau, fit.walk) + shared
        return restricted_likelihood(values - fit.evaluate(time), ones, v)[0]

    base = likelihood(level)
    found: dict[Course, float] = {
        "level": 0.0,
        "line": likelihood(line) - base,
        "walk": max(likelihood(walk) - base, 0.0),
    }
    beside = _slope_beside_walk(time, values, _covariance(time, own, walk.tau, walk.walk) + shared)
    return CourseComparison(level, line, walk, wandering, found, beside)


def _slope_beside_walk(time: Array, values: Array, covariance: Array) -> float:
    """Return |t| of a slope, with a covariance that was estimated without the slope."""
    x = _columns(time, float(time.mean()), 2)
    weighted = np.linalg.solve(covariance, x)
    inverse = np.linalg.inv(x.T @ weighted)
    square = float((inverse @ weighted.T @ (values - values.mean()))[1] ** 2 / inverse[1, 1])
    dof = values.size - 2
    left = dof + 1 - square
    return float(np.sqrt(dof * square / left)) if left > 0 else float("inf")


def fit_course(
    time: Array, values: Array, own: Array, shared: Array, *, slope: bool = False,
    walks: bool = False,
) -> CourseFit:  # fmt: skip
    """Fit a level, or a line if `slope` is true; also fit a random walk if `walks` is true.

    The parameters are the same as in `compare_courses`. n must be at least 2, and at least 3 if
    `slope` is true.
    """
    n = values.size
    # The units are chosen so values and times are near 1.
    unit = float(np.sqrt(np.var(values, ddof=1) + np.mean(own + np.diag(shared))))
    span = float(np.ptp(time)) or 1.0
    y, own, shared = (values - values.mean()) / unit, own / unit**2, shared / unit**2
    at = (time - time[0]) / span
    tau2, q = _scatter(at, y, own, shared, slope=slope, walks=walks)
    scattered = _covariance(at, own, np.sqrt(tau2), q)
    total = np.linalg.inv(scattered + shared)
    middle = float(at.mean())
    if slope:  # at this time, value and slope are uncorrelated
        information = _columns(at, middle, 2).T @ total @ _columns(at, middle, 2)
        middle += information[0, 1] / information[0, 0]
    x = _columns(at, middle, 1 + slope)
    gain = np.linalg.inv(x.T @ total @ x) @ x.T @ total
    beta = gain @ y
    rest = y - x @ beta
    chi2, dof = float(rest @ total @ rest), n - 1 - slope
    by = unit * np.array([1.0, 1 / span][: 1 + slope])
    square = np.outer(by, by)
    beta = beta * by
    beta[0] += values.mean()
    return CourseFit(
        float(time[0]) + span * middle, beta,
        max(1.0, chi2 / dof) * square * (gain @ scattered @ gain.T),
        square * (gain @ shared @ gain.T),
        unit * float(np.sqrt(tau2)), unit**2 * q / span, chi2, dof, n,
        float(expanded_uncertainty(np.ones(1), np.array([float(dof)]))[0]),
    )  # fmt: skip


def _scatter(
    time: Array, y: Array, own: Array, shared: Array, *, slope: bool, walks: bool
) -> tuple[float, float]:
    """Estimate τ² and q."""
    n = y.size
    factors = [np.eye(n)]
    if walks:
        factors.append(np.tril(np.ones((n, n))) * np.sqrt(np.diff(time, prepend=time[0])))
    x = _columns(time, float(time.mean()), 1 + slope)
    start = np.full(len(factors), 0.5 * float(np.var(y, ddof=1)))
    variance = restricted_variances(y, x, np.diag(own) + shared, factors, start).variance
    return float(variance[0]), float(variance[1]) if walks else 0.0


def _columns(time: Array, middle: float, count: int) -> Array:
    return np.stack([np.ones_like(time), time - middle][:count], axis=1)


def _walk(time: Array) -> Array:
    since = time - time.min()
    return np.minimum(since[:, None], since)


def _covariance(time: Array, own: Array, tau: float, walk: float) -> Array:
    return np.diag(own + tau**2) + walk * _walk(time)
