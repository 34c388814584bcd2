"""Whether a coefficient changed between calibrations, and how it drifts.

Between two calibrations, the normalised error of ISO/IEC 17043:2010 (annex B) and ISO 13528:2022,
here of the later beyond the earlier::

    E_n = (x₂ − x₁) / U,   U = 2 √(u₁² + u₂² − 2 cov)  (GUM 6.2.1, 5.2.2)

|E_n| ≤ 1 is not called a change. Where nothing changed, 4.55 % of them exceed 1 by chance, one in
22. For many coefficients together there is a joint test as well, with all covariances::

    χ² = dᵀ C⁺ d,   d = x₂ − x₁,   C = C₁ + C₂ − S − Sᵀ

with as many degrees of freedom as C has rank; a difference along directions that C does not span is
left out of χ². S is the covariance of both by errors that they state to share (`shared_errors`):
those cancel in the difference.

E_n and χ² take calibrations as independent where a calibration does not state its shared errors:
both are then too small, and chance calls fewer changes than one in 22. How a history goes on over
time is in `courses`.
"""

# scipy has no type stubs.
# pyright: reportMissingTypeStubs=false

from math import erfc, sqrt
from typing import Literal, NamedTuple

import numpy as np
import scipy

from inercal.basics.arrays import Array
from inercal.estimation.uncertainty.coverage import COVERAGE

TrendVerdict = Literal["steady", "drifts", "changed", "too few"]
CHANCE_FRACTION = erfc(COVERAGE / sqrt(2))
"""Part of all |E_n| that exceed 1 where nothing changed, 0.0455."""
YEAR = 31_557_600.0  # s, of 365.25 days (Julian year)
_RANK_TOLERANCE = 1e-9  # of the largest eigenvalue of the scaled covariance


def normalised_errors(difference: Array, std: Array) -> Array:
    """Return E_n of differences.

    Parameters
    ----------
    difference : (...,) array
        Later minus earlier.
    std : (...,) array
        Standard uncertainty (k = 1) of the difference: √(u₁² + u₂²) of independent values.

    Returns
    -------
    (...,) array
        NaN where there is no uncertainty.

    Examples
    --------
    >>> float(normalised_errors(np.array(5.0), np.hypot(3.0, 4.0)))
    0.5
    """
    expanded = COVERAGE * np.asarray(std, dtype=float)
    return np.divide(difference, expanded, out=np.full_like(expanded, np.nan), where=expanded > 0)


class JointTest(NamedTuple):
    """The test of all coefficients together.

    Parameters
    ----------
    chi2 : float
    rank : int
        Its degrees of freedom: the rank of the covariance.
    size : int
        How many coefficients there are.
    p_value : float
        How likely chance alone makes χ² as large.
    """

    chi2: float
    rank: int
    size: int
    p_value: float


def joint_test(difference: Array, covariance: Array) -> JointTest:
    """Return the joint test of a difference, (p,), with its covariance, (p, p)."""
    size = difference.size
    scale = np.sqrt(np.diag(covariance))
    if not size or not (scale > 0).all():
        raise ValueError(
            "covariance has a variance of 0, or difference is empty; pass coefficients with an "
            "uncertainty"
        )
    # Scaled to ones on the diagonal: units that differ by many powers of ten say nothing of rank.
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    seen = values > _RANK_TOLERANCE * values[-1]
    along = (vectors.T @ (difference / scale))[seen]
    chi2, rank = float(np.sum(along**2 / values[seen])), int(seen.sum())
    return JointTest(chi2, rank, size, chi2_p_value(chi2, rank))


def chi2_p_value(chi2: float, dof: int) -> float:
    """Return how likely a χ² of that many degrees of freedom is as large; 1 of none."""
    return float(scipy.special.gammaincc(dof / 2, chi2 / 2)) if dof else 1.0


class ConstancyTest(NamedTuple):
    """χ² about the weighted mean, its degrees of freedom, and how likely chance makes as much."""

    chi2: float
    dof: int
    p_value: float


def constancy_test(values: Array, std: Array, shared: Array | None = None) -> ConstancyTest:
    """Return the test of (n,) values against their mean.

    Parameters
    ----------
    values, std : (n,) arrays
        With their own standard uncertainties.
    shared : (n, n) array, optional
        Covariance by what they share; an error that all have moves their mean alone.
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
    """Say what a history shows.

    "drifts": the slope exceeds its U (`courses.CourseComparison.drifts`). "changed": no such slope,
    but the values scatter about their mean more than in 95.45 % of histories where nothing changes;
    of two calibrations that is |E_n| > 1. "steady": neither. "too few": there is one calibration.
    """
    if not constant.dof:
        return "too few"
    if drifts:
        return "drifts"
    return "changed" if constant.p_value < CHANCE_FRACTION else "steady"
