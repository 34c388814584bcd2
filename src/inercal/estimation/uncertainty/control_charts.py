"""Control charts for repeated vectors: Shewhart, EWMA or CUSUM, T² and MEWMA.

A point is the difference d_t between p values and their reference. V_t is the covariance of the
point, and R_t that of the reference, which is common to all points::

    Shewhart   z² = d_i²/(V + R)_ii                                of each value
    EWMA       w_t = (1 − λ) w_{t−1} + λ d_i/√V_ii,   w²/(λ/(2 − λ) + R_ii/V_ii)
    T²         dᵀ (V + R)⁻¹ d                                      of all together
    MEWMA      w_t = (1 − λ) w_{t−1} + λ V^−½ d,
               wᵀ (λ/(2 − λ) I + V^−½ R V^−½)⁻¹ w

A CUSUM chart can be used instead of the EWMA. The error of the reference is the same in all points,
so it does not average out in w. Each statistic is compared with a limit h, which comes from χ² if V
is known. If V was estimated from few points, h is larger (`wider_limit`). All charts together have
the stated in-control run length: the four kinds have equal shares of the false-signal rate, and the
values have equal shares within each kind.

For standardised values z_t and the allowance k, a CUSUM chart keeps two sums::

    C⁺_t = max(0, C⁺_{t−1} + z_t − k),   C⁻_t = max(0, C⁻_{t−1} − z_t − k),   signal where C > h

After a shift δ, the mean run length of C⁺ from u is (Page 1954), with the normal density φ::

    L(u) = 1 + L(0) Φ(k − δ − u) + ∫₀^h L(x) φ(x + k − δ − u) dx

and for both sums 1/ARL = 1/L⁺(0) + 1/L⁻(0) (Kemp 1961). If the standard deviation was estimated
with ν degrees of freedom, 1/ARL₀ is the false-signal rate averaged over z = x/s with ν s² ~ χ²_ν.
An error of the reference's mean would accumulate in a sum. The allowance is therefore enlarged by
1.645 times its standard deviation, which 90 % of references do not exceed.

The run length is the number of points until a chart signals. If nothing is wrong, its mean is the
in-control run length, ARL₀. A chart with memory computes, from standardised z_t in p dimensions::

    w_t = (1 − λ) w_{t−1} + λ z_t,   signal where |w_t|² (2 − λ)/λ > h

λ = 1 gives the chart for single points: Shewhart's for p = 1, T² for larger p. In control, the
direction of w_t has no effect: starting at |w| = r, the next |w|²/λ² is χ² with p degrees of
freedom and noncentrality ((1 − λ) r/λ)². With the density k of the next |w|, the run length is::

    ARL(r) = 1 + ∫₀^R ARL(s) k(s | r) ds,   R² = h λ/(2 − λ),   ARL₀ = ARL(0)

Sources: Page, Biometrika 41 (1954), 100–115; Kemp, J. R. Statist. Soc. B 23 (1961), 149–153;
Montgomery, Statistical Quality Control, 9.1 (k = 0.5, h = 4.77: ARL₀ = 370); Lucas and Saccucci,
Technometrics 32 (1990), 1–12 (EWMA); Lowry, Woodall, Champ and Rigdon, Technometrics 34 (1992),
46–53 (MEWMA); Rigdon, J. Quality Technology 27 (1995), 375 (the integral equation).
"""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cache
from math import ceil, exp, inf, isinf, log, pi, sqrt
from typing import Literal, cast, get_args

import numpy as np
import scipy

from inercal.basics.arrays import Array, Bools

_NODES = 48
_LEAST = 1e-12


def in_control_run_length(limit: float, weight: float, size: int) -> float:
    """Return the in-control run length ARL₀ of a chart.

    Parameters
    ----------
    limit : float
        Limit h for the squared statistic, which is χ² with p degrees of freedom if `weight` is 1.
    weight : float
        Weight λ, above 0 and at most 1.
    size : int
        p.

    Examples
    --------
    >>> round(in_control_run_length(9.0, 1.0, 1)), round(in_control_run_length(2.860**2, 0.2, 1))
    (370, 371)
    >>> round(in_control_run_length(30.10, 1.0, 12))
    371
    """
    if weight == 1:
        return 1 / float(scipy.special.gammaincc(size / 2, limit / 2))
    reach = (limit * weight / (2 - weight)) ** 0.5
    node, gauss = np.polynomial.legendre.leggauss(_NODES)
    at, by = 0.5 * reach * (node + 1), 0.5 * reach * gauss
    kernel = _density(at[None, :], at[:, None], weight, size) * by
    lengths = np.asarray(np.linalg.solve(np.eye(_NODES) - kernel, np.ones(_NODES)), dtype=float)
    start = _density(at, np.full(1, _LEAST), weight, size) * by
    return 1 + float(start @ lengths)


def _density(to: Array, since: Array, weight: float, size: int) -> Array:
    """Return the density of the next |w| at `to` if the current |w| is `since`."""
    x, c = to / weight, np.maximum((1 - weight) * since / weight, _LEAST)
    order = size / 2 - 1
    # the noncentral χ² density of x², ½ e^{−(x² + c²)/2} (x/c)^order I_order(x c), times 2 x/λ
    log_power = order * (np.log(np.maximum(x, _LEAST)) - np.log(c))
    bessel = scipy.special.ive(order, x * c)
    small = bessel <= 1e-280
    log_bessel = np.log(np.where(small, 1.0, bessel))
    # I_ν(y) → (y/2)^ν / Γ(ν + 1) for small y
    series = order * np.log(np.maximum(x * c, 1e-300) / 2) - scipy.special.gammaln(order + 1)
    log_bessel = np.where(small, series - x * c, log_bessel)
    density: Array = np.exp(-((x - c) ** 2) / 2 + log_power + log_bessel) * x / weight
    return density


@cache
def chart_limit(run_length: float, weight: float, size: int) -> float:
    """Return the limit h that gives a chart an in-control run length.

    Parameters
    ----------
    run_length : float
        In-control run length ARL₀, above 1.
    weight : float
        Weight λ.
    size : int
        p.

    Examples
    --------
    >>> round(chart_limit(370.4, 1.0, 12), 2), round(chart_limit(370.4, 1.0, 24), 2)
    (30.1, 47.76)
    """
    if weight == 1:
        return 2 * float(scipy.special.gammainccinv(size / 2, 1 / run_length))
    high = chart_limit(run_length, 1.0, size)

    def off(log_limit: float) -> float:
        return log(in_control_run_length(exp(log_limit), weight, size) / run_length)

    found = scipy.optimize.brentq(off, log(0.2 * high), log(1.05 * high), xtol=1e-5)
    return exp(cast("float", found))


def wider_limit(limit: float, size: int, dof: float) -> float:
    """Return the limit h for a covariance estimated with ν degrees of freedom.

    A single point exceeds it with the same probability as it exceeds `limit` with a known
    covariance. The limit is p times a quantile of F, or of t² for p = 1.

    Examples
    --------
    >>> round(wider_limit(9.0, 1, 19) ** 0.5, 2)  # ×√(1 + 1/20) is the 3.53 of 20 sessions
    3.45
    """
    tail = float(scipy.special.gammaincc(size / 2, limit / 2))
    return size * float(scipy.special.fdtri(size, dof, 1 - tail))


ALLOWANCE = 0.5
"""The allowance k, which detects a lasting change of 1 standard deviation soonest."""
REFERENCE_FACTOR = 1.645
_QUANTILES = (np.arange(9) + 0.5) / 9  # probabilities for quantiles of s²
_LEAST_H, _MOST_H = 0.5, 60.0
_LARGEST = 1e9  # longest run length that rounding allows


def cusum_sums(z: Array, reference: Array, restarts: Collection[int] = ()) -> tuple[Array, Array]:
    """Return the sums C⁺ and C⁻ for a series of points.

    Parameters
    ----------
    z : (n, p) array
    reference : (n, p) array
        Standard deviation of the reference's mean, in units of a point's standard deviation.
    restarts : collection of int
        Points at which the sums restart from zero.
    """
    up, down = np.zeros_like(z), np.zeros_like(z)
    high, low = np.zeros(z.shape[1]), np.zeros(z.shape[1])
    for t, (one, of_reference) in enumerate(zip(z, reference, strict=True)):
        if t in restarts:
            high, low = np.zeros_like(high), np.zeros_like(low)
        allowance = ALLOWANCE + REFERENCE_FACTOR * of_reference
        high = np.maximum(0.0, high + one - allowance)
        low = np.maximum(0.0, low - one - allowance)
        up[t], down[t] = high, low
    return up, down


def cusum_run_length(limit: float, shift: float = 0.0, scale: float = 1.0) -> float:
    """Return the average run length of the two-sided chart.

    Parameters
    ----------
    limit, shift, scale : float
        Limit h, and mean and standard deviation of z, which are 0 and 1 in control.

    Examples
    --------
    >>> [round(cusum_run_length(4.774, shift), 1) for shift in (0.0, 0.5, 1.0, 2.0)]
    [370.1, 35.3, 9.9, 3.9]
    """
    # In units of the standard deviation of z:
    h, k, off = limit / scale, ALLOWANCE / scale, shift / scale
    return 1 / (1 / _one_sided(h, k - off) + 1 / _one_sided(h, k + off))


def _one_sided(h: float, drift: float) -> float:
    """Return L(0) for a sum that decreases by `drift` per point on average."""
    node, gauss = np.polynomial.legendre.leggauss(24 + ceil(1.6 * h))
    # L(0) is a separate unknown.
    at = np.concatenate([[0.0], 0.5 * h * (node + 1)])
    by = np.concatenate([[0.0], 0.5 * h * gauss])
    density = np.exp(-((at[None, :] + drift - at[:, None]) ** 2) / 2) / sqrt(2 * pi)
    kernel = density * by
    kernel[:, 0] = scipy.special.ndtr(drift - at)
    lengths = np.linalg.solve(np.eye(at.size) - kernel, np.ones(at.size))
    found = float(lengths[0])
    return min(found, _LARGEST) if found > 0 else _LARGEST


@cache
def cusum_limit(run_length: float, dof: float = inf) -> float:
    """Return the limit h that gives an in-control run length.

    Parameters
    ----------
    run_length, dof : float
        ARL₀, and the degrees of freedom ν of the estimated standard deviation.

    Examples
    --------
    >>> round(cusum_limit(370.4), 2)
    4.77
    """
    scales = [1.0]
    if not isinf(dof):
        scales = (1 / np.sqrt(scipy.special.chdtri(dof, _QUANTILES) / dof)).tolist()

    def off(log_limit: float) -> float:
        rate = sum(1 / cusum_run_length(exp(log_limit), scale=one) for one in scales)
        return log(rate / len(scales) * run_length)

    if off(log(_MOST_H)) > 0:
        return _MOST_H
    found = scipy.optimize.brentq(off, log(_LEAST_H), log(_MOST_H), xtol=1e-4)
    return exp(cast("float", found))


ChartKind = Literal["Shewhart", "EWMA", "CUSUM", "T²", "MEWMA"]
KINDS: tuple[ChartKind, ...] = get_args(ChartKind)
LastingKind = Literal["EWMA", "CUSUM"]
"""The kinds of charts for small lasting changes in one value."""
_DRAWN = 4  # number of chart kinds, with only one kind for lasting changes
EWMA_WEIGHT, MEWMA_WEIGHT = 0.2, 0.1
"""The weight λ of the EWMA and MEWMA charts."""


@dataclass(frozen=True, eq=False)
class ChartLimits:
    """Limits h for the squared statistics.

    Parameters
    ----------
    shewhart, lasting : (p,) arrays
    t2, mewma : float
    run_length : float
        In-control run length ARL₀ of all charts together.
    lasting_kind : "EWMA" or "CUSUM"
    """

    shewhart: Array
    lasting: Array
    t2: float
    mewma: float
    run_length: float
    lasting_kind: LastingKind = "EWMA"

    @property
    def single_run_length(self) -> float:
        """ARL₀ of the Shewhart, EWMA or CUSUM chart for one value."""
        return self.run_length * _DRAWN * len(self.shewhart)

    @property
    def joint_run_length(self) -> float:
        """ARL₀ of the T² or MEWMA chart."""
        return self.run_length * _DRAWN


@dataclass(frozen=True, eq=False)
class ChartValues:
    """Chart statistics of n points.

    Parameters
    ----------
    shewhart, lasting : (n, p) arrays
        Signed statistics in standard deviations; for a CUSUM, the larger of the two sums.
    t2, mewma : (n,) arrays
    """

    shewhart: Array
    lasting: Array
    t2: Array
    mewma: Array

    def signals(self, limits: ChartLimits) -> dict[ChartKind, Bools]:
        """Return which points exceed each kind's limits, as (n,) or (n, p) arrays of bool."""
        return {
            "Shewhart": self.shewhart**2 > limits.shewhart,
            limits.lasting_kind: self.lasting**2 > limits.lasting,
            "T²": self.t2 > limits.t2,
            "MEWMA": self.mewma > limits.mewma,
        }


def chart_limits(
    run_length: float, dof: Array, joint_dof: float, lasting: LastingKind = "EWMA"
) -> ChartLimits:
    """Return the limits of the charts for p values.

    Parameters
    ----------
    run_length : float
        In-control run length ARL₀ of all charts together.
    dof, joint_dof : (p,) array and float
        Degrees of freedom of each value's variance (infinite if it is known), and of their
        covariance.
    lasting : "EWMA" or "CUSUM"
    """
    p = len(dof)
    joint, single = run_length * _DRAWN, run_length * _DRAWN * p
    return ChartLimits(
        np.array([_limit(single, 1.0, 1, nu) for nu in dof.tolist()]),
        np.array([lasting_limit(single, nu, lasting) for nu in dof.tolist()]),
        _limit(joint, 1.0, p, joint_dof),
        _limit(joint, MEWMA_WEIGHT, p, joint_dof),
        run_length,
        lasting,
    )


def lasting_limit(run_length: float, dof: float, kind: LastingKind) -> float:
    """Return the limit for the squared statistic of the lasting-change chart of one value."""
    if kind == "CUSUM":
        return cusum_limit(run_length, dof) ** 2
    return _limit(run_length, EWMA_WEIGHT, 1, dof)


def _limit(length: float, weight: float, size: int, dof: float) -> float:
    limit = chart_limit(length, weight, size)
    return limit if np.isinf(dof) else wider_limit(limit, size, dof)


def chart_values(
    difference: Array,
    point: Array,
    reference: Array,
    restarts: Sequence[int] = (),
    lasting: LastingKind = "EWMA",
) -> ChartValues:
    """Return the chart statistics of points in time order.

    Parameters
    ----------
    difference : (n, p) array
        Differences d from the reference.
    point, reference : (n, p, p) arrays
        Covariances V and R.
    restarts : sequence of int
        Points at which the charts with memory restart.
    lasting : "EWMA" or "CUSUM"
    """
    n, p = difference.shape
    of_point = np.linalg.diagonal(point)
    of_reference = np.linalg.diagonal(reference)
    solved = np.linalg.solve(point + reference, difference[:, :, None])[:, :, 0]
    ewma, mewma = np.zeros((n, p)), np.zeros(n)
    single, joint = np.zeros(p), np.zeros(p)
    variance, joint_variance = (x / (2 - x) for x in (EWMA_WEIGHT, MEWMA_WEIGHT))
    for t in range(n):
        if t in restarts:
            single, joint = np.zeros(p), np.zeros(p)
        root = _inverse_root(point[t])
        single = single + EWMA_WEIGHT * (difference[t] / np.sqrt(of_point[t]) - single)
        joint = joint + MEWMA_WEIGHT * (root @ difference[t] - joint)
        ewma[t] = single / np.sqrt(variance + of_reference[t] / of_point[t])
        spread = joint_variance * np.eye(p) + root @ reference[t] @ root.T
        mewma[t] = joint @ np.linalg.solve(spread, joint)
    if lasting == "CUSUM":
        up, down = cusum_sums(
            difference / np.sqrt(of_point), np.sqrt(of_reference / of_point), restarts
        )
        ewma = np.where(up >= down, up, -down)
    t2 = np.einsum("np,np->n", difference, solved)
    return ChartValues(difference / np.sqrt(of_point + of_reference), ewma, t2, mewma)


def _inverse_root(covariance: Array) -> Array:
    """Return the symmetric square root of the inverse."""
    scale = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    # The root is symmetric in units of the standard deviations; any root would whiten.
    root: Array = (vectors / np.sqrt(values)) @ vectors.T / scale
    return root
