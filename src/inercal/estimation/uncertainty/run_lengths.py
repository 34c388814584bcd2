"""Run lengths of control charts, and limits for a given run length.

The run length is the number of points until a chart signals. If nothing is wrong, its mean is the
in-control run length, ARL₀. A chart with memory computes, from standardised z_t in p dimensions::

    w_t = (1 − λ) w_{t−1} + λ z_t,   signal where |w_t|² (2 − λ)/λ > h

λ = 1 gives the chart for single points: Shewhart's for p = 1, T² for larger p. In control, the
direction of w_t has no effect: starting at |w| = r, the next |w|²/λ² is χ² with p degrees of
freedom and noncentrality ((1 − λ) r/λ)². With the density k of the next |w|, the run length is::

    ARL(r) = 1 + ∫₀^R ARL(s) k(s | r) ds,   R² = h λ/(2 − λ),   ARL₀ = ARL(0)

Sources: Lucas and Saccucci, Technometrics 32 (1990), 1–12 (EWMA); Lowry, Woodall, Champ and Rigdon,
Technometrics 34 (1992), 46–53 (MEWMA); Rigdon, J. Quality Technology 27 (1995), 375 (the integral
equation).
"""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false

from functools import cache
from math import exp, log
from typing import cast

import numpy as np
import scipy

from inercal.basics.arrays import Array

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
