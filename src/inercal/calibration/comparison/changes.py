"""Test whether a coefficient changed between calibrations.

Two calibrations are compared by the normalised error of ISO/IEC 17043:2010 (annex B) and ISO
13528:2022. Here it refers to the later value minus the earlier value::

    E_n = (x₂ − x₁) / U,   U = 2 √(u₁² + u₂² − 2 cov)  (GUM 6.2.1, 5.2.2)

A difference with |E_n| ≤ 1 is not called a change. If nothing changed, 4.55 % of the E_n (one in
22) exceed 1 by chance. All coefficients are also tested together, with all covariances::

    χ² = dᵀ C⁺ d,   d = x₂ − x₁,   C = C₁ + C₂ − S − Sᵀ

The number of degrees of freedom is the rank of C. The part of d that C does not span is not
included in χ². S is the covariance of the two calibrations due to the shared errors that both state
(`shared_errors`). These errors cancel in the difference.

If a calibration does not state its shared errors, E_n and χ² treat the calibrations as independent.
Both are then too small, and fewer than one in 22 coefficients appear to change by chance. The
module `courses` models how a coefficient changes over time.
"""

# scipy has no type stubs.
# pyright: reportMissingTypeStubs=false

from math import erfc, sqrt
from typing import Literal, NamedTuple

import numpy as np
import scipy

from inercal.basics.arrays import Array
from inercal.estimation.uncertainty import COVERAGE

TrendVerdict = Literal["steady", "drifts", "changed", "too few"]
CHANCE_FRACTION = erfc(COVERAGE / sqrt(2))
"""Fraction of |E_n| that exceed 1 by chance if nothing changed, 0.0455."""
YEAR = 31_557_600.0  # s, of 365.25 days (Julian year)
_RANK_TOLERANCE = 1e-9  # fraction of the largest eigenvalue of the scaled covariance


def normalised_errors(difference: Array, std: Array) -> Array:
    """Return the normalised errors E_n of differences.

    Parameters
    ----------
    difference : (...,) array
        Later value minus earlier value.
    std : (...,) array
        Standard uncertainty (k = 1) of the difference, which is √(u₁² + u₂²) for independent
        values.

    Returns
    -------
    (...,) array
        E_n; NaN if there is no uncertainty.

    Examples
    --------
    >>> float(normalised_errors(np.array(5.0), np.hypot(3.0, 4.0)))
    0.5
    """
    expanded = COVERAGE * np.asarray(std, dtype=float)
    return np.divide(difference, expanded, out=np.full_like(expanded, np.nan), where=expanded > 0)


class JointTest(NamedTuple):
    """The result of the joint test of all coefficients.

    Parameters
    ----------
    chi2 : float
    rank : int
        Degrees of freedom, which is the rank of the covariance.
    size : int
        Number of coefficients.
    p_value : float
        Probability that χ² is this large by chance.
    """

    chi2: float
    rank: int
    size: int
    p_value: float


def joint_test(difference: Array, covariance: Array) -> JointTest:
    """Test all components of a difference, (p,), together, with its covariance, (p, p)."""
    size = difference.size
    scale = np.sqrt(np.diag(covariance))
    if not size or not (scale > 0).all():
        raise ValueError(
            "a variance in covariance is 0, or difference is empty; pass only coefficients with "
            "an uncertainty"
        )
    # The diagonal is scaled to ones, because units of very different sizes would distort the rank.
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    seen = values > _RANK_TOLERANCE * values[-1]
    along = (vectors.T @ (difference / scale))[seen]
    chi2, rank = float(np.sum(along**2 / values[seen])), int(seen.sum())
    return JointTest(chi2, rank, size, chi2_p_value(chi2, rank))


def chi2_p_value(chi2: float, dof: int) -> float:
    """Return the probability of a χ² at least this large; 1 if there are no degrees of freedom."""
    return float(scipy.special.gammaincc(dof / 2, chi2 / 2)) if dof else 1.0


class ConstancyTest(NamedTuple):
    """χ² about the weighted mean, its degrees of freedom and its p-value."""

    chi2: float
    dof: int
    p_value: float


def constancy_test(values: Array, std: Array, shared: Array | None = None) -> ConstancyTest:
    """Test whether (n,) values agree with their weighted mean.

    Parameters
    ----------
    values, std : (n,) arrays
        Values and their independent standard uncertainties.
    shared : (n, n) array, optional
        Covariance due to shared errors. An error that all values share only shifts their mean.
    """
    covariance = np.diag(std**2) if shared is None else np.diag(std**2) + shared
    ones = np.ones(values.size)
    inverse = np.linalg.inv(covariance)
    weights = inverse @ ones
    off = values - values.mean()
    off = off - weights @ off / weights.sum()
    chi2, dof = float(off @ inverse @ off), values.size - 1
    return ConstancyTest(chi2, dof, chi2_p_value(chi2, dof))


def trend_verdict(*, drifts: bool, constant: ConstancyTest) -> TrendVerdict:
    """Return whether the coefficient drifts, changed or is steady in a history.

    "drifts" means that the slope exceeds its U (`courses.CourseComparison.drifts`). "changed" means
    that there is no such slope, but the values scatter about their mean more than in 95.45 % of
    histories in which nothing changes. For two calibrations, this means |E_n| > 1. "steady" means
    that there is neither a slope nor such a scatter. "too few" means that there is only one
    calibration.
    """
    if not constant.dof:
        return "too few"
    if drifts:
        return "drifts"
    return "changed" if constant.p_value < CHANCE_FRACTION else "steady"
