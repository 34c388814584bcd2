"""Describe a sensor's own low-pass filter: its possible shapes and their effect on the noise.

With w = 2π f Δ, the power that the filter passes is::

    one pole                  (1−p)²/(1 − 2p cos w + p²),  p = e^(−2π f_c Δ)
    one pole, bilinear        1/(1 + (tan(w/2)/tan(π f_c Δ))²)
    two equal poles           the square of one pole
    Butterworth, bilinear     1/(1 + (tan(w/2)/tan(π f_c Δ))⁴)
    Butterworth, analog       Σ_m 1/(1 + ((f + m/Δ)/f_c)⁴), m = −2 … 2, over its value at f = 0
    average of m samples      (sin(m w/2)/(m sin(w/2)))²
    two averages of 2         the square of an average of 2

The noise of a sampled analog pole is aliased, which gives exactly the form of a digital pole. After
the filter, the spectrum has the plateau N², and the read-out adds the white noise F²::

    S = |H|² (N² e_N + B² e_B + K² e_K) + F² (1 − |H|²) e_N

N² therefore determines the random walk of the angle, and the part N² − F² is added before the
filter.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from inercal.basics.arrays import Array
from inercal.noise.terms import TERMS, model_avar

LEAST_RELATIVE_U = 0.01
"""Smallest relative u of a cut-off; an unnoticed shape error of 5 % shifts it by almost 1 %."""
_ALIASES = np.arange(-2.0, 3.0)
_BOOLE = np.array([7.0, 32.0, 12.0, 32.0, 7.0]) / 90
_GRID = 8192  # number of frequencies for a filter's effect on an Allan variance
_EXACT_UP_TO = 512  # averaging factor; above it, sin⁴ is replaced by its mean


@dataclass(frozen=True)
class FilterShape:
    """A family of low-pass filters.

    Parameters
    ----------
    name : str
    like : str
        Description for use in a sentence, such as "one pole".
    poles : int
        Number of poles; 0 for an average.
    power : function of (w, c)
        Function that returns |H|² at w = 2π f Δ, with c = f_c Δ; an average does not use c.
    highest : float
        Largest f_c Δ in the search.
    """

    name: str
    like: str
    poles: int
    power: Callable[[Array, float], Array]
    highest: float = 0.5

    @property
    def has_cutoff(self) -> bool:
        """Whether the filter has a cut-off that is fitted."""
        return self.poles > 0


def _one_pole(w: Array, c: float) -> Array:
    p = np.exp(-2 * np.pi * c)
    # This uses 1 − cos w = 2 sin²(w/2), which is precise at low frequencies.
    return (1 - p) ** 2 / ((1 - p) ** 2 + 4 * p * np.sin(w / 2) ** 2)


def _bilinear(order: int) -> Callable[[Array, float], Array]:
    def power(w: Array, c: float) -> Array:
        # This uses products of sines and cosines, because tan(w/2) is infinite at half the rate. It
        # squares twice, because a power of 4 is many times slower.
        own = ((np.sin(w / 2) * np.cos(np.pi * c)) ** 2) ** order
        cut = ((np.cos(w / 2) * np.sin(np.pi * c)) ** 2) ** order
        return cut / (cut + own)

    return power


def _analog(w: Array, c: float) -> Array:
    f = (w / (2 * np.pi))[..., None] + _ALIASES
    at_zero = float((1 / (1 + (_ALIASES / c) ** 4)).sum())
    return (1 / (1 + ((f / c) ** 2) ** 2)).sum(axis=-1) / at_zero  # `** 4` is much slower


def _average(m: int) -> Callable[[Array, float], Array]:
    def power(w: Array, c: float) -> Array:
        half = np.maximum(np.abs(w), 1e-9) / 2
        return (np.sin(m * half) / (m * np.sin(half))) ** 2

    return power


SHAPES = (
    FilterShape("one pole", "one pole", 1, _one_pole, 1.0),
    FilterShape("one pole, digital", "one pole, by a bilinear transform", 1, _bilinear(1)),
    FilterShape("two equal poles", "like a second-order filter, two equal poles", 2,
                lambda w, c: _one_pole(w, c) ** 2),
    FilterShape("Butterworth, digital", "like a second-order filter, digital Butterworth", 2,
                _bilinear(2)),
    FilterShape("Butterworth, analog", "like a second-order filter, analog Butterworth", 2,
                _analog),
    FilterShape("average of 2", "average of 2 samples", 0, _average(2)),
    FilterShape("average of 3", "average of 3 samples", 0, _average(3)),
    FilterShape("average of 4", "average of 4 samples", 0, _average(4)),
    FilterShape("two averages of 2", "two averages of 2 samples", 0,
                lambda w, c: _average(2)(w, c) ** 2),
)  # fmt: skip


@dataclass(frozen=True)
class OutputFilter:
    """The filter at the output of a sensor.

    Parameters
    ----------
    shape : FilterShape
    cutoff : float
        Cut-off frequency f_c, Hz; NaN for an average.
    u : float
        Standard uncertainty of f_c, Hz.
    dt : float
        Sampling interval Δ, s.
    floor : float
        White noise F² added after the filter, SI²; it includes the known rounding noise.
    known_floor : float
        The part of `floor` that is caused by rounding of the readings.
    white_spread : float
        Relative standard deviation of N between the shapes that fit equally well.
    gain : float
        Improvement of the Bayesian criterion due to the filter.
    """

    shape: FilterShape
    cutoff: float
    u: float
    dt: float
    floor: float = 0.0
    known_floor: float = 0.0
    white_spread: float = 0.0
    gain: float = 0.0

    def power(self, frequency: Array) -> Array:
        """Return |H|² at frequencies, Hz."""
        return self.shape.power(2 * np.pi * frequency * self.dt, self.cutoff * self.dt)

    @property
    def at_half_rate(self) -> float:
        """|H|² at half the sampling rate."""
        return float(self.power(np.array([0.5 / self.dt]))[0])


def mean_power(shape: FilterShape, low: Array, high: Array, c: float) -> Array:
    """Return |H|² averaged over frequency bands, computed with Boole's five-point rule.

    Parameters
    ----------
    shape : FilterShape
    low, high : (b,) array
        Ends of the bands as 2π f Δ.
    c : float
        Cut-off as f_c Δ.
    """
    nodes = low[:, None] + (high - low)[:, None] * np.linspace(0, 1, _BOOLE.size)
    return shape.power(nodes, c) @ _BOOLE


def filtered_avar(
    symbol: str, tau: Array, dt: float, markov_time: float, output: OutputFilter | None
) -> Array:
    """Return the Allan variance of a term with a coefficient of 1 after a filter.

    The effect of the filter is only included for f ≤ 1/2Δ, so the aliases of B and K are omitted.
    """
    whole = TERMS[symbol].avar(tau, dt, markov_time)
    if output is None or symbol == "Q":  # quantisation happens after the filter
        return whole
    f = (np.arange(_GRID, dtype=np.float64) + 0.5) / (2 * _GRID * dt)
    taken = (1 - output.power(f)) * TERMS[symbol].psd(f, dt, markov_time)
    m = np.asarray(tau)[:, None] / dt
    wave = np.where(m <= _EXACT_UP_TO, np.sin(np.pi * f * dt * m) ** 4, 3 / 8)
    lost = (2 * wave / (m * np.sin(np.pi * f * dt)) ** 2) @ taken / (_GRID * dt)
    return np.maximum(whole - lost, 1e-12 * whole)


def filtered_model_avar(
    variances: dict[str, float],
    tau: Array,
    dt: float,
    markov_time: float,
    output: OutputFilter | None,
) -> Array:
    """Return the Allan variance, SI, of several terms after a filter, from squared coefficients."""
    tau = np.asarray(tau)
    if output is None:
        return model_avar(variances, tau, dt, markov_time)
    total = output.floor * (
        TERMS["N"].avar(tau, dt, 1.0) - filtered_avar("N", tau, dt, 1.0, output)
    )
    for symbol, variance in variances.items():
        total = total + variance * filtered_avar(symbol, tau, dt, markov_time, output)
    return total
