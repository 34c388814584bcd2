"""How a coefficient goes over time: a level, a straight line, or a random walk.

Calibrations at times t_i have values with own variances s_i² and a part S that they share. They
scatter from one to the next by τ, too::

    y = X β + e,   cov(e) = V + S,   V = diag(s_i²) + τ² I [+ q W],   W_ij = min(t_i, t_j)

X is a column of ones, or ones and times. τ² and q maximise the restricted likelihood. With
A = Xᵀ(V + S)⁻¹X and G = A⁻¹Xᵀ(V + S)⁻¹, scatter and shared errors are stated apart::

    cov_A(β) = c G V Gᵀ,   cov_B(β) = G S Gᵀ,   c = max(1, χ²/ν),   ν = n − p
    U² of x β          = t_ν² x cov_A xᵀ + 4 x cov_B xᵀ
    U² of the next use = t_ν² (τ² + x cov_A xᵀ) + 4 x cov_B xᵀ

What all calibrations share moves the level, not the slope. Level, line and walk are compared by the
likelihood of the same contrasts, those of the values to their mean; line and walk have one
parameter more than the level.

A random walk looks like a line, and hides in it: beside a slope q is estimated as too small. So
the slope is also judged by τ² and q of the walk, which were fitted without it. With T = b/u(b) by
these, T² of n values is bounded by n − 1, for a slope that is not fitted enlarges τ² and q. Then ::

    t² = ν T²/(ν + 1 − T²),   ν = n − 2

is Student's where all of the variance is estimated: of a level with scatter, and of a pure walk. A
drift must reach a part of t_ν, by simulation 0.7 to 0.8, with which 8 % of walks are called drifts.

Sources: JCGM 100:2008, H.3 and G.4; Patterson and Thompson, Biometrika 58 (1971), 545–554.
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.estimation.uncertainty.conformity import expanded_uncertainty
from inercal.estimation.uncertainty.coverage import COVERAGE
from inercal.estimation.uncertainty.repeated_measurements import (
    restricted_likelihood,
    restricted_variances,
)

Course = Literal["level", "line", "walk"]
NEWEST = 100
"""How many calibrations a fit takes at most: the newest."""
LEAST_FOR_DRIFT = 5
"""Fewer calibrations show no drift: their scatter is not known well enough."""
_LEAST_FOR_LINE = 3
_BESIDE_WALK, _BESIDE_WALK_OF_FEW = 0.8, {5: 0.7, 6: 0.75}
"""Of t_ν, what a slope must reach beside a random walk, of many values and by their number."""
_AHEAD = 2.0  # of 2 ln(likelihood), what one parameter more must gain (Akaike 1974)


class SlopeStatement(NamedTuple):
    """Drift a year, its standard uncertainty by scatter, and U."""

    slope: float
    std: float
    expanded: float


@dataclass(frozen=True, eq=False)
class CourseFit:
    """A level or a line through n calibrations.

    Parameters
    ----------
    time : float
        Years, as the times were given: where the line has `value`.
    beta : (p,) array
        Value at that time, and the slope a year of a line.
    scatter, shared : (p, p) arrays
        cov_A and cov_B.
    tau : float
        Standard deviation of the scatter from one calibration to the next.
    walk : float
        q a year, of a random walk; 0 where none is fitted.
    chi2 : float
    dof : int
    count : int
        n.
    factor : float
        t_ν with the coverage of 2u.
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
        """Return the values at times, in years."""
        return self._columns(time) @ self.beta

    def expanded(self, time: Array, *, next_use: bool = False) -> Array:
        """Return U of the mean at times, or of the next use."""
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
        """The drift a year; of a level it is 0."""
        if len(self.beta) == 1:
            return SlopeStatement(0.0, 0.0, 0.0)
        by_scatter, shared = self.scatter[1, 1], max(float(self.shared[1, 1]), 0.0)
        expanded = float(np.sqrt(self.factor**2 * by_scatter + COVERAGE**2 * shared))
        return SlopeStatement(float(self.beta[1]), float(np.sqrt(by_scatter)), expanded)

    @property
    def is_significant(self) -> bool:
        """Whether there are calibrations enough, and the slope exceeds its U."""
        return self.count >= LEAST_FOR_DRIFT and abs(self.slope.slope) > self.slope.expanded


@dataclass(frozen=True, eq=False)
class CourseComparison:
    """Level, line and random walk of the same calibrations.

    Parameters
    ----------
    level, line, walk : CourseFit
        Of the walk the level, with q.
    wandering_line : CourseFit
        A line with q, whose slope has the uncertainty of a walk too.
    likelihood : mapping of "level", "line", "walk" to float
        Logarithm of the restricted likelihood less that of the level.
    beside_walk : float
        |t| of the slope by the variances of the walk.
    """

    level: CourseFit
    line: CourseFit
    walk: CourseFit
    wandering_line: CourseFit
    likelihood: dict[Course, float]
    beside_walk: float

    @property
    def best(self) -> Course:
        """The level, unless line or walk gain more than a parameter is worth."""
        best: Course = "line" if self.likelihood["line"] >= self.likelihood["walk"] else "walk"
        return best if 2 * self.likelihood[best] > _AHEAD else "level"

    @property
    def drifts(self) -> bool:
        """Whether the slope exceeds its U, and a random walk does not explain it as well."""
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
    """Return the courses of values; None of fewer than three, or where all are of one time.

    Parameters
    ----------
    time : (n,) array
        Years.
    values, own : (n,) arrays
        With their own variances, without what they share.
    shared : (n, n) array
        Covariance by what they share.
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
    """Return |t| of a slope with a covariance that was estimated without it."""
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
    """Return a level, or a line where `slope`; with the q of a random walk where `walks`.

    Parameters are those of `compare_courses`, with n ≥ 2, and n ≥ 3 where `slope`.
    """
    n = values.size
    # In units in which values and times are near 1.
    unit = float(np.sqrt(np.var(values, ddof=1) + np.mean(own + np.diag(shared))))
    span = float(np.ptp(time)) or 1.0
    y, own, shared = (values - values.mean()) / unit, own / unit**2, shared / unit**2
    at = (time - time[0]) / span
    tau2, q = _scatter(at, y, own, shared, slope=slope, walks=walks)
    scattered = _covariance(at, own, np.sqrt(tau2), q)
    total = np.linalg.inv(scattered + shared)
    middle = float(at.mean())
    if slope:  # where value and slope are not correlated
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
    """Return τ² and q."""
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
