"""Sensor noise with known coefficients, apart from inercal: block means by exact or fine synthesis.

White noise, random walks and Gauss–Markov processes are exact block means. Flicker is a sum of
Gauss–Markov processes whose time constants lie evenly on a logarithmic scale, five to two decades
(within 0.01 % of 1/f), beyond both ends of the recording's range.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter

DEG_H = np.pi / 180 / 3600  # rad/s


@dataclass(frozen=True)
class Truth:
    """Coefficients of one channel in SI units times `unit`, and its sampling."""

    n: int
    dt: float
    white: float = 0.0
    flicker: float = 0.0
    walk: float = 0.0
    markov: float = 0.0
    markov_time: float = 1.0
    unit: float = DEG_H

    def without(self, **changes: float) -> "Truth":
        return replace(self, **changes)


MEMS = Truth(65536, 0.25, 9.0, 5.0, 0.2)
TACTICAL = Truth(65536, 1.0, 3.0, 0.3, 0.006)


def markov_means(rng: np.random.Generator, n: int, dt: float, time: float, count: int = 1):
    """Return block means, (count, n), of stationary Gauss–Markov processes of sd 1, exactly.

    State g at the end of a block and the block's mean are jointly Gaussian given g at its start.
    """
    x = dt / time
    phi = np.exp(-x)
    end_var = -np.expm1(-2 * x)
    if x < 1e-2:
        mean_var = 2 * x / 3 - x**2 / 2 + 7 * x**3 / 30 - x**4 / 12
        cross = x - x**2 + 7 * x**3 / 12 - x**4 / 4
        gain = 1 - x / 2 + x**2 / 6 - x**3 / 24
    else:
        mean_var = (2 * x - 3 + 4 * phi - phi**2) / x**2
        cross = (1 - phi) ** 2 / x
        gain = (1 - phi) / x
    a, b = rng.standard_normal((2, count, n))
    shock = np.sqrt(end_var) * a
    slope = cross / end_var
    rest = np.sqrt(max(mean_var - slope * cross, 0.0)) * b
    start = rng.standard_normal((count, 1))
    ends, _ = lfilter([1.0], [1.0, -phi], shock, axis=-1, zi=phi * start)
    before = np.concatenate([start, ends[:, :-1]], axis=1)
    return gain * before + slope * shock + rest


def flicker_means(rng: np.random.Generator, n: int, dt: float, count: int = 1):
    """Return block means, (count, n), of noise with S(f) = 1/(2π f) over the recording's range."""
    low, high = np.log10(dt) - 2, np.log10(n * dt) + 1.5
    step = 0.4
    total = np.zeros((count, n))
    # ∫ 2T/(1 + (2πfT)²) d(ln T) = 1/(2f), and S(f) is to be 1/(2πf).
    for log_time in np.arange(low, high, step):
        variance = step * np.log(10) / np.pi
        total += np.sqrt(variance) * markov_means(rng, n, dt, 10.0**log_time, count)
    return total


def walk_means(rng: np.random.Generator, n: int, dt: float, count: int = 1):
    """Return block means, (count, n), of a random walk with increments of variance t."""
    a, b = rng.standard_normal((2, count, n))
    steps = np.sqrt(dt) * a
    starts = np.cumsum(steps, axis=-1) - steps
    return starts + steps / 2 + np.sqrt(dt / 12) * b


def draw(truth: Truth, seed: int, count: int = 1):
    """Return block means in rad/s or m/s², (count, n)."""
    rng = np.random.default_rng(seed)
    n, dt = truth.n, truth.dt
    y = truth.white / np.sqrt(dt) * rng.standard_normal((count, n))
    if truth.flicker:
        y += truth.flicker * flicker_means(rng, n, dt, count)
    if truth.walk:
        y += truth.walk * walk_means(rng, n, dt, count)
    if truth.markov:
        y += truth.markov * markov_means(rng, n, dt, truth.markov_time, count)
    return truth.unit * y
