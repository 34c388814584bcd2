"""The two-sided CUSUM chart: sums, run lengths and limits.

For standardised values z_t and the allowance k, the chart keeps two sums::

    C⁺_t = max(0, C⁺_{t−1} + z_t − k),   C⁻_t = max(0, C⁻_{t−1} − z_t − k),   signal where C > h

After a shift δ, the mean run length of C⁺ that starts at u is (Page 1954), with the normal density
φ::

    L(u) = 1 + L(0) Φ(k − δ − u) + ∫₀^h L(x) φ(x + k − δ − u) dx

and for both sums 1/ARL = 1/L⁺(0) + 1/L⁻(0) (Kemp 1961). If the standard deviation was estimated
with ν degrees of freedom, 1/ARL₀ is the false-signal rate averaged over z = x/s with ν s² ~ χ²_ν.
An error of the reference's mean would accumulate in a sum. The allowance is therefore enlarged by
1.645 times its standard deviation, which 90 % of references do not exceed.

Sources: Page, Biometrika 41 (1954), 100–115; Kemp, J. R. Statist. Soc. B 23 (1961), 149–153;
Montgomery, Statistical Quality Control, 9.1 (k = 0.5, h = 4.77: ARL₀ = 370).
"""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false

from collections.abc import Collection
from functools import cache
from math import ceil, exp, inf, isinf, log, pi, sqrt
from typing import cast

import numpy as np
import scipy

from inercal.basics.arrays import Array

ALLOWANCE = 0.5
"""The allowance k, which detects a lasting change of 1 standard deviation soonest."""
REFERENCE_FACTOR = 1.645
_QUANTILES = (np.arange(9) + 0.5) / 9  # probabilities for quantiles of s²
_LEAST, _MOST = 0.5, 60.0  # h
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
    limit : float
        Limit h.
    shift, scale : float
        Mean and standard deviation of z; they are 0 and 1 in control.

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
    run_length : float
        In-control run length ARL₀.
    dof : float
        Degrees of freedom ν of the estimated standard deviation.

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

    if off(log(_MOST)) > 0:
        return _MOST
    found = scipy.optimize.brentq(off, log(_LEAST), log(_MOST), xtol=1e-4)
    return exp(cast("float", found))
