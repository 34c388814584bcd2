"""Define the terms of sensor noise: spectrum, Allan variance, variogram and units of each.

The series y consists of block means over Δ of a rate or an acceleration. For a coefficient of 1, in
SI::

    term              S(f), two-sided        σ²(τ)              γ(h) = ½ E (y[t+h] − y[t])², h ≥ 1
    Q quantisation    (2π f)² Δ              3/τ²               2/Δ², at h = 1: 3/Δ²
    N white noise     1                      1/τ                1/Δ
    B flicker         1/(2π f)               (2 ln2)/π          1/2π · δ²(h² ln h)
    K random walk     1/(2π f)²              τ/3                ½ Δ (h − ⅓)
    G Gauss–Markov    2T/(1 + (2π f T)²)     (2T/τ)[1 − (T/2τ)(3 − 4e^(−τ/T) + e^(−2τ/T))]

The second difference is δ²g(h) = g(h+1) − 2 g(h) + g(h−1). K is defined for block means; the Allan
variance of a sampled random walk is 1.5 times K²τ/3 at τ = Δ. Sources: IEEE Std 952, annex B; IEEE
Std 1293.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from inercal.basics.arrays import Array
from inercal.physics.quantities import QUANTITIES, Quantity

FLICKER_FLOOR = float(2 * np.log(2) / np.pi)
"""Allan variance of flicker noise with B = 1; the minimum of its Allan deviation is 0.664 B."""
_SERIES_FROM = 32.0  # lag above which the second difference of h² ln h is computed as a series
_SMALL_RATIO = 2e-3  # τ/T below which the Allan variance of G is computed as a series
_SMALL_STEP = 0.1  # Δ/T below which the variogram of G is computed as a series


@dataclass(frozen=True)
class NoiseTerm:
    """One noise term; its functions apply to a coefficient of 1 in SI.

    Parameters
    ----------
    symbol : str
        "Q", "N", "B", "K" or "G".
    name : str
    psd : function of (f, Δ, T)
        Two-sided spectral density at frequencies, Hz.
    avar : function of (τ, Δ, T)
        Allan variance.
    variogram : function of (h, Δ, T)
        Variogram at lags h = 1, 2, … of blocks of Δ.
    units : dict of str to str
        Display units of the coefficient, by the word for the sensor.
    """

    symbol: str
    name: str
    psd: Callable[[Array, float, float], Array]
    avar: Callable[[Array, float, float], Array]
    variogram: Callable[[Array, float, float], Array]
    units: dict[str, str]


def _flicker_variogram(h: Array, dt: float, _: float) -> Array:
    """Return δ²(h² ln h)/2π, by a series at large h, where the difference would lose digits."""
    h = np.asarray(h, dtype=np.float64)
    near = np.minimum(h, _SERIES_FROM)
    below = near - 1
    with np.errstate(divide="ignore", invalid="ignore"):
        low = np.where(below > 0, below**2 * np.log(np.maximum(below, 1)), 0.0)
    direct = (near + 1) ** 2 * np.log(near + 1) - 2 * near**2 * np.log(near) + low
    far = np.maximum(h, _SERIES_FROM)
    series = 2 * np.log(far) + 3 - 1 / (6 * far**2) - 1 / (30 * far**4) - 1 / (84 * far**6)
    return np.where(h < _SERIES_FROM, direct, series) / (2 * np.pi)


def _markov_variogram(h: Array, dt: float, time: float) -> Array:
    """Return [a − (1 − e^(−x))² (e^(−(h−1)x) − 1)]/x² with x = Δ/T and a = γ(1) x²."""
    x = dt / time
    if x < _SMALL_STEP:
        a, factorial = 0.0, 2.0
        for k in range(3, 16):
            factorial *= k
            a += (4 * (-1.0) ** k - (-2.0) ** k) * x**k / factorial
    else:
        a = 2 * x - 3 + 4 * np.exp(-x) - np.exp(-2 * x)
    return (a - np.expm1(-x) ** 2 * np.expm1(-(np.asarray(h) - 1) * x)) / x**2


def _markov_avar(tau: Array, dt: float, time: float) -> Array:
    z = np.asarray(tau) / time
    safe = np.maximum(z, _SMALL_RATIO)
    direct = 1 - (3 - 4 * np.exp(-safe) + np.exp(-2 * safe)) / (2 * safe)
    series = 2 * z / 3 - z**2 / 2 + 7 * z**3 / 30
    return np.where(z < _SMALL_RATIO, series, 2 * direct / safe)


def _by_sensor(unit: Callable[[Quantity], str]) -> dict[str, str]:
    """Return the display unit of a coefficient for each kind of sensor."""
    return {one.sensor: unit(one) for one in QUANTITIES.values()}


TERMS = {
    one.symbol: one
    for one in (
        NoiseTerm(
            "Q",
            "quantisation",
            lambda f, dt, _: (2 * np.pi * f) ** 2 * dt,
            lambda tau, dt, _: 3 / tau**2,
            lambda h, dt, _: np.where(h == 1, 3.0, 2.0) / dt**2,
            _by_sensor(lambda one: one.integral_unit),
        ),
        NoiseTerm(
            "N",
            "white noise",
            lambda f, dt, _: np.ones_like(f),
            lambda tau, dt, _: 1 / tau,
            lambda h, dt, _: np.full(np.shape(h), 1 / dt),
            _by_sensor(lambda one: one.noise_unit),
        ),
        NoiseTerm(
            "B",
            "bias instability",
            lambda f, dt, _: 1 / (2 * np.pi * f),
            lambda tau, dt, _: np.full(np.shape(tau), FLICKER_FLOOR),
            _flicker_variogram,
            _by_sensor(lambda one: one.fine_unit),
        ),
        NoiseTerm(
            "K",
            "random walk",
            lambda f, dt, _: (2 * np.pi * f) ** -2.0,
            lambda tau, dt, _: tau / 3,
            lambda h, dt, _: 0.5 * dt * (h - 1 / 3),
            _by_sensor(lambda one: f"{one.fine_unit}/√s"),
        ),
        NoiseTerm(
            "G",
            "Gauss–Markov",
            lambda f, dt, time: 2 * time / (1 + (2 * np.pi * f * time) ** 2),
            _markov_avar,
            _markov_variogram,
            _by_sensor(lambda one: one.fine_unit),
        ),
    )
}


def model_avar(
    variances: dict[str, float], tau: Array, dt: float, markov_time: float = 1.0
) -> Array:
    """Return the Allan variance of several terms at averaging times, SI."""
    total = np.zeros(np.shape(tau))
    for symbol, variance in variances.items():
        total = total + variance * TERMS[symbol].avar(np.asarray(tau), dt, markov_time)
    return total


def model_psd(variances: dict[str, float], f: Array, dt: float, markov_time: float = 1.0) -> Array:
    """Return the two-sided spectral density of several terms at frequencies in Hz, SI²/Hz."""
    total = np.zeros(np.shape(f))
    for symbol, variance in variances.items():
        total = total + variance * TERMS[symbol].psd(np.asarray(f), dt, markov_time)
    return total
