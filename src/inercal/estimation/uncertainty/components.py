"""Variance components: estimate the true scatter between sensors, within lots and between lots.

Each value has its own standard uncertainty, which adds to its scatter::

    y_ij = θ + L_i + S_ij + e_ij,   L ~ N(0, σ_L²),   S ~ N(0, σ²),   e_ij ~ N(0, u_ij²) known

The estimator is that of Paule and Mandel (1982, Journal of Research of the National Bureau of
Standards 87, 377–385), applied in two stages. First σ² is chosen so that the weighted squares about
the lot means equal their expectation. With w_ij = 1/(u_ij² + σ²), n sensors and g lots this is

    Q(σ²) = Σ w_ij (y_ij − ȳ_i)² = n − g,

Then σ_L² is found in the same way from the lot means, which have the variances 1/Σ_j w_ij. With
equal u both estimates are those of REML. The limits of σ are the values at which Q equals the
quantiles of χ² (Viechtbauer 2007, Statistics in Medicine 26, 37–52). Errors that all sensors share,
such as those of one bench, are not included in this model: they shift θ, and more sensors do not
reduce them.
"""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false

from collections.abc import Callable
from dataclasses import dataclass
from math import sqrt

import numpy as np
import scipy

from inercal.basics.arrays import Array, Indices
from inercal.basics.errors import InputError
from inercal.estimation.uncertainty import COVERAGE_PROBABILITY

_PRECISION = 1e-9  # relative tolerance for σ²
_STEPS = 200
_TAIL = (1 - COVERAGE_PROBABILITY) / 2
_LEAST = 1e-200  # variance used for a value without uncertainty


@dataclass(frozen=True)
class Component:
    """A standard deviation with its limits.

    Parameters
    ----------
    sd : float
        Standard deviation; 0 if the values scatter less than their uncertainties predict.
    low, high : float
        Limits with 95.45 % coverage.
    dof : int
    """

    sd: float
    low: float
    high: float
    dof: int


@dataclass(frozen=True)
class Components:
    """The components of a random-effects model.

    Parameters
    ----------
    mean, std : float
        θ and its standard uncertainty, which includes only the scatter (Hartung and Knapp 2001).
    within : Component
        Scatter between sensors in a lot, or between all sensors if there is one lot.
    lots : Component or None
        Scatter between lots; None for one lot.
    """

    mean: float
    std: float
    within: Component
    lots: Component | None


def variance_components(value: Array, std: Array, lots: Indices | None = None) -> Components:
    """Return the mean, and the scatter within and between lots, of values with known uncertainty.

    Parameters
    ----------
    value, std : (n,) arrays
        Values and their standard uncertainties.
    lots : (n,) array of int, optional
        Lot of each value, numbered from 0 without gaps. By default all values are in one lot.

    Raises
    ------
    InputError
        No lot has two or more values, so the scatter within lots is not observed.
    """
    lots = np.zeros(len(value), dtype=np.intp) if lots is None else lots
    count = int(lots.max(initial=0)) + 1
    dof = len(value) - count
    if dof < 1:
        raise InputError(
            f"{len(value)} values in {count} lots do not show the scatter within a lot; give a lot "
            "with at least two values"
        )
    within = _component(value, std, lots, count, dof)
    weight = 1 / np.maximum(std**2 + within.sd**2, _LEAST)
    total = np.bincount(lots, weight, count)
    means, stds = np.bincount(lots, weight * value, count) / total, 1 / np.sqrt(total)
    if count == 1:
        return Components(float(means[0]), _mean_std(value, weight), within, None)
    one = np.zeros(count, dtype=np.intp)
    between = _component(means, stds, one, 1, count - 1)
    weight = 1 / np.maximum(stds**2 + between.sd**2, _LEAST)
    mean = float(weight @ means / weight.sum())
    return Components(mean, _mean_std(means, weight), within, between)


def _mean_std(value: Array, weight: Array) -> float:
    """Return the standard uncertainty of the weighted mean; the weights give its lower limit."""
    total = weight.sum()
    q = weight @ (value - weight @ value / total) ** 2 / (len(value) - 1)
    return float(np.sqrt(max(q, 1.0) / total))


def _component(value: Array, std: Array, lots: Indices, count: int, dof: int) -> Component:
    # Relative to a common value, because large means would lose digits.
    variance, value = std**2, value - np.median(value)

    def squares(excess: float) -> tuple[float, float]:
        """Return Q and its derivative, to which the change of the means does not contribute."""
        weight = 1 / (variance + excess)
        total = np.bincount(lots, weight, count)
        mean = np.bincount(lots, weight * value, count) / total
        each = weight * (value - mean[lots]) ** 2
        return float(each.sum()), -float(weight @ each)

    spread = float(np.var(value))
    least = 0.0 if np.all(variance > 0) else _PRECISION * spread
    begin = max(spread - float(variance.mean()), least)
    roots = [
        0.0 if spread == 0 else _root(squares, size, least, begin)
        for size in (float(dof), *(float(scipy.special.chdtri(dof, p)) for p in (_TAIL, 1 - _TAIL)))
    ]
    sd, low, high = (root**0.5 for root in roots)
    return Component(sd, low, high, dof)


def _root(
    squares: Callable[[float], tuple[float, float]], size: float, least: float, x: float
) -> float:
    """Return the excess variance at which `squares` equals `size`; 0 if it is always smaller.

    The root is found by Newton's method. `squares` is convex and decreasing, so the iterate is
    below the root after the first step at the latest, and then rises to it.
    """
    for _ in range(_STEPS):
        found, slope = squares(x)
        if x <= least and found <= size:
            return 0.0
        step = (size - found) / slope
        if abs(step) <= _PRECISION * x:
            break
        x = max(x + step, least)
    return x


def scatter_limits(variance: float, variance_of_it: float, dof: int) -> Component:
    """Return σ, estimated in the presence of known noise, with 95.45 % coverage limits.

    With noise variance s², the estimate of σ² + s² has a scaled χ² distribution with ν degrees of
    freedom, so its variance is 2 (σ² + s²)²/ν. The variance of the estimate therefore gives s².

    Parameters
    ----------
    variance, variance_of_it : float
        The estimate of σ², and its variance.
    dof : int
        Degrees of freedom ν.

    Examples
    --------
    >>> found = scatter_limits(1.0, 2 / 9, 9)  # without noise
    >>> round(found.low, 2), round(found.high, 2)
    (0.68, 1.85)
    """
    total = max(sqrt(variance_of_it * dof / 2), variance)
    noise = total - variance
    low, high = (
        max(total * dof / float(scipy.special.chdtri(dof, p)) - noise, 0.0)
        for p in (_TAIL, 1 - _TAIL)
    )
    return Component(sqrt(variance), sqrt(low), sqrt(high), dof)
