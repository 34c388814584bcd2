"""Judge whether uncertain values conform to limits (JCGM 106:2012, ILAC-G8:09/2019).

The limits are T_L and T_U (one may be infinite), y is a value and U its expanded uncertainty. The
guard band is w = 0 for the rule "simple", and w = factor · U for the rule "guarded"::

    pass              T_L + w ≤ y ≤ T_U − w
    conditional pass  within the limits, but not by w
    conditional fail  beyond a limit, by w at most
    fail              beyond a limit by more than w

The conformance probability is the probability that the true value is within the limits, given only
y (JCGM 106, clause 7)::

    p_c = F((T_U − y)/u) − F((T_L − y)/u)

F is the normal distribution, or Student's with ν degrees of freedom. If a value is on its
acceptance limit and w = U = 2u, its true value is beyond the tolerance limit with a probability of
2.28 %; w = 0.83 U gives 4.9 %.
"""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false

from dataclasses import dataclass
from math import inf
from typing import Literal, get_args

import numpy as np
import scipy

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.estimation.uncertainty import COVERAGE

Result = Literal["pass", "conditional pass", "conditional fail", "fail"]
RESULTS: tuple[Result, ...] = get_args(Result)
"""The possible results, from best to worst."""
RuleName = Literal["guarded", "simple"]
_POINTS = 1 << 12  # lattice points for the joint probability, whose error is about 1e-4
_PRIMES = 512  # there are 97 primes below this number, more than a sensor has coefficients
_JITTER = 1e-10  # added to the diagonal of a singular correlation matrix
NO_GUARD_BAND = "rule 'simple' has no guard band; remove factor, or choose 'guarded'"


@dataclass(frozen=True)
class DecisionRule:
    """The rule for judging a value near a limit.

    Parameters
    ----------
    name : "guarded" or "simple"
    factor : float
        Guard band as a multiple of U, for the rule "guarded".

    Raises
    ------
    InputError
        The factor is not positive, or it is not 1 with the rule "simple".
    """

    name: RuleName = "guarded"
    factor: float = 1.0

    def __post_init__(self) -> None:
        if not 0 < self.factor < inf:
            raise InputError(
                f"factor {self.factor:g} is not possible; give a number above 0", key="factor"
            )
        if self.name == "simple" and self.factor != 1.0:
            raise InputError(NO_GUARD_BAND, key="factor")

    def guard(self, std: Array, dof: float | Array = inf) -> Array:
        """Return the guard bands w for standard uncertainties, in the same unit and shape."""
        if self.name == "simple":
            return np.zeros(np.shape(std))
        return self.factor * expanded_uncertainty(std, dof)


def expanded_uncertainty(std: Array, dof: float | Array = inf) -> Array:
    """Return U = 2u, or U = t u for ν degrees of freedom, with 95.45 % coverage."""
    std, dof = np.broadcast_arrays(np.asarray(std, dtype=float), dof)
    k = np.full(std.shape, COVERAGE)
    finite = np.isfinite(dof)
    k[finite] = scipy.special.stdtrit(dof[finite], scipy.special.ndtr(COVERAGE))
    return k * std


def judge(value: Array, lower: Array, upper: Array, guard: Array) -> Array:
    """Return the result for each value as an index in `RESULTS`.

    Parameters
    ----------
    value, lower, upper, guard : (...) arrays
        Values, limits and guard bands in one unit; a missing limit is infinite.

    Returns
    -------
    (...) array of int
    """
    room = np.minimum(np.subtract(upper, value), np.subtract(value, lower))
    within = np.where(room >= guard, 0, 1)
    return np.where(room >= 0, within, np.where((guard > 0) & (-room <= guard), 2, 3))


def conformance_probability(
    value: Array, std: Array, lower: Array, upper: Array, dof: float | Array = inf
) -> Array:
    """Return the probability that each true value is within its limits, with broadcasting.

    Parameters
    ----------
    value, std : (...) arrays
        Value and standard uncertainty. Without uncertainty the probability is 0 or 1.
    lower, upper : (...) arrays
        Limits; a missing limit is infinite.
    dof : (...) array or float
        Degrees of freedom of the standard uncertainties.
    """
    value, std, lower, upper, dof = np.broadcast_arrays(value, std, lower, upper, dof)
    with np.errstate(divide="ignore", invalid="ignore"):
        above, below = (upper - value) / std, (lower - value) / std
        # Subtract the smaller tails, which keep their digits.
        flip = below > 0
        above, below = np.where(flip, -below, above), np.where(flip, -above, below)
        normal: Array = scipy.special.ndtr(above) - scipy.special.ndtr(below)
        finite = np.isfinite(dof)
        nu = np.minimum(dof, 1e9)  # infinite degrees of freedom: normal distribution
        student: Array = scipy.special.stdtr(nu, above) - scipy.special.stdtr(nu, below)
    inside = (lower <= value) & (value <= upper)
    return np.where(std > 0, np.where(finite, student, normal), inside.astype(float))


def joint_conformance_probability(
    value: Array, covariance: Array, lower: Array, upper: Array
) -> float:
    """Return the probability that all true values are within their limits simultaneously.

    The probability is the integral of the multivariate normal distribution over the box of the
    limits. It is computed with the separation of variables of Genz (1992, Journal of Computational
    and Graphical Statistics 1, 141–149) on a lattice of square roots of primes with the tent
    transform, so the same input gives exactly the same result.

    Parameters
    ----------
    value : (p,) array
    covariance : (p, p) array
    lower, upper : (p,) arrays
        Limits; a missing limit is infinite.
    """
    std = np.sqrt(np.diag(covariance))
    exact = std == 0
    if np.any(exact & ((value < lower) | (value > upper))):
        return 0.0
    chosen = ~exact & (np.isfinite(lower) | np.isfinite(upper))
    if not chosen.any():
        return 1.0
    std = std[chosen]
    below, above = (lower - value)[chosen] / std, (upper - value)[chosen] / std
    correlation = covariance[np.ix_(chosen, chosen)] / np.outer(std, std)
    # Start with the least probable value, because the integrand then varies least.
    order = np.argsort(scipy.special.ndtr(above) - scipy.special.ndtr(below))
    below, above = below[order], above[order]
    p = len(order)
    root = np.linalg.cholesky(correlation[np.ix_(order, order)] + _JITTER * np.eye(p))
    steps = np.sqrt(_first_primes(p))
    lattice = np.abs(2 * ((np.arange(1, _POINTS + 1)[:, None] * steps) % 1.0) - 1)
    drawn = np.zeros((_POINTS, p))
    product = np.ones(_POINTS)
    for k in range(p):
        shift = drawn[:, :k] @ root[k, :k]
        low = scipy.special.ndtr((below[k] - shift) / root[k, k])
        share = np.maximum(scipy.special.ndtr((above[k] - shift) / root[k, k]) - low, 0.0)
        product *= share
        # Stay within the open interval, because the quantiles at its ends are infinite.
        drawn[:, k] = scipy.special.ndtri(np.clip(low + lattice[:, k] * share, 1e-16, 1 - 1e-16))
    return float(np.mean(product))


def _first_primes(count: int) -> Array:
    sieve = np.ones(_PRIMES, dtype=bool)
    sieve[:2] = False
    for k in range(2, int(_PRIMES**0.5) + 1):
        sieve[k * k :: k] = False
    return np.flatnonzero(sieve)[:count].astype(float)
