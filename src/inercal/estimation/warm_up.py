"""Warm-up drift and short-term stability from repeated readings of the same input.

The readings follow an exponential from the time of the first reading, 0, to that of the last, T::

    y = c + D h(t) + s ε + noise          h(t) = (1 − exp(−t/τ)) / (1 − exp(−T/τ))

D is the warm-up drift, the change from the first to the last reading. s is the short-term
stability, the standard deviation of the readings without their noise, whose variance is known. The
warm-up time is the time after which the exponential stays within a band about its last value.

The likelihood is taken as a distribution with equal weights for c, D and 1/τ. The variance v =
s² + noise² has the weight v^(−3/2), for which the mean of s has almost no bias. A drift is detected
if it reduces −2 ln L by 16 or more, which happens by chance in less than one case in a hundred. A
scatter s is detected if χ² of the exponential is improbably large.
"""

from dataclasses import replace
from math import sqrt
from statistics import NormalDist

import numpy as np

from inercal.basics.arrays import Array, Bools
from inercal.basics.errors import InputError
from inercal.estimation.input_output_tests import CHANCE, DETECTED, Figure, probability_above
from inercal.estimation.response_band import distribution

_GAIN = 16.0  # least reduction of −2 ln L for a drift
_GRID, _ROUNDS, _NEAR = 40, 4, 25.0
_SLOWEST, _DETERMINED = 20.0, 2.0  # times T: almost a straight line; the largest time constant
_FITTED = 3  # constant, drift and time constant
_NORMAL = np.array([NormalDist().inv_cdf((k + 0.5) / 40) for k in range(40)])


def warm_up(
    time: Array, read: Array, variance: Array, band: float | None = None
) -> dict[str, Figure]:
    """Return the drift and the stability of repeated readings by name, and the times of a drift.

    The time constant is only returned if it is determined.

    Parameters
    ----------
    time, read, variance : (n,) array
        Times of the readings after turn-on, rising; readings and the variance of their noise.
    band : float or None
        Largest difference from the last value after the warm-up time.

    Raises
    ------
    InputError
        The times do not rise.
    """
    if not (np.diff(time) > 0).all():
        raise InputError("the times of the first readings do not rise", key="[data] time")
    t, y, noise = time - time[0], read - read.mean(), float(variance.mean())
    tau = np.geomspace(float(np.diff(t).min()) / 2, _SLOWEST * float(t[-1]), _GRID)
    v = np.geomspace(noise, 4 * noise + float(np.ptp(y)) ** 2, _GRID)
    without = float(_exponentials(t, y, variance, tau, v)[3].min())
    for _ in range(_ROUNDS):
        cost = _exponentials(t, y, variance, tau, v)[-1]
        near = cost <= cost.min() + _NEAR
        tau, v = _around(tau, near.any(axis=1)), _around(v, near.any(axis=0))
    size, sd, fit, _, cost = _exponentials(t, y, variance, tau, v)
    share = np.exp((cost.min() - cost) / 2)
    size = size[..., None] + sd[..., None] * _NORMAL
    found = without - float(fit.min()) >= _GAIN
    drift = distribution(size, share[..., None], detected=found)
    drift = replace(drift, bound=max(drift.high, -drift.low), detectable=sqrt(_GAIN) * drift.u)
    quiet = _exponentials(t, y, variance, tau, np.array([noise]))[2] - np.log(variance).sum()
    dof = len(t) - _FITTED
    scatter = probability_above(float(quiet.min()), dof) < CHANCE
    least = sqrt(noise * DETECTED * sqrt(2 / dof))
    s = distribution(np.sqrt(v - noise), share.sum(axis=0), detected=scatter, detectable=least)
    result = {"warm-up drift": drift, "short-term stability": s}
    constant = distribution(tau, share.sum(axis=1))
    if found and constant.high < _DETERMINED * t[-1]:
        result["warm-up time constant"] = constant
    if found and band is not None:
        slow, left = tau[:, None, None], np.exp(-t[-1] / tau)[:, None, None]
        until = -slow * np.log(band * (1 - left) / np.abs(size) + left)
        result["warm-up time"] = distribution(time[0] + until.clip(0.0), share[..., None])
    return result


def _exponentials(t: Array, y: Array, variance: Array, tau: Array, v: Array) -> tuple[Array, ...]:
    """Return the best drift of each time constant, (a,), and variance, (b,), all (a, b).

    The result is D and its standard deviation, χ² + Σ ln v with D and without it, and the same for
    the distribution of all parameters.
    """
    shape = np.expm1(-t / tau[:, None]) / np.expm1(-t[-1] / tau[:, None])
    weight = 1 / (v[:, None] - variance.mean() + variance)
    total = weight.sum(axis=1)
    level, mean = weight @ y / total, shape @ weight.T / total
    square = shape**2 @ weight.T - mean**2 * total
    drift = (shape @ (weight * y).T - mean * level * total) / square
    none = weight @ y**2 - level**2 * total - np.log(weight).sum(axis=1)
    fit = none - drift**2 * square
    return drift, square**-0.5, fit, none, fit + np.log(square * total * v * tau[:, None] ** 2)


def _around(values: Array, some: Bools) -> Array:
    """Return a finer grid over some of the values, with one cell around."""
    rows = np.flatnonzero(some)
    return np.geomspace(values[max(rows[0] - 1, 0)], values[min(rows[-1] + 1, _GRID - 1)], _GRID)
