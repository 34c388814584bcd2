"""One-way warm-ups whose thermometer reports steps: imports nothing of inercal.

    T = end + (start − end) e^{−t/c},   τ dR/dt = T − R,   y = b(T) + white noise

The reading is R with noise, rounded or truncated to steps, and possibly refreshed at intervals.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ZERO = 273.15
DEG = np.pi / 180
# °/s, °/s/K and °/s/K² of three axes, about 20 °C.
BIAS = DEG * np.array([[0.5, 0.02, 1e-4], [-0.3, -0.015, 0.0], [0.1, 0.005, -2e-4]])
WHITE = DEG * 0.0158 / np.sqrt(2)  # rad/s/√Hz: .0158 °/s of a reading at 2 Hz


@dataclass(frozen=True)
class WarmUp:
    """A warm-up and its thermometer; s, K, °C.

    `step` 0 is not rounded; `refreshed` 0 is with each reading; `before` is a rest at the first
    temperature, `lost` what is cut off the begin; `back` returns to the start half way.
    """

    step: float = 1.0
    lag: float = 30.0
    constant: float = 600.0
    minutes: float = 40.0
    rate: float = 2.0
    start: float = -20.0
    end: float = 25.0
    noise: float = 0.0
    truncated: bool = False
    refreshed: float = 0.0
    before: float = 0.0
    lost: float = 0.0
    louder: float = 1.0
    back: bool = False


def made(warm: WarmUp, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Return times, s, the thermometer's readings, K, and those of three gyros, rad/s."""
    start, end = warm.start + rng.uniform(-0.5, 0.5), warm.end + rng.uniform(-0.5, 0.5)
    total = warm.lost + warm.before + 60 * warm.minutes
    n = round(total * warm.rate)
    time = np.arange(n) / warm.rate
    since = np.maximum(time - warm.before, 0.0)
    half = 0.5 * (total - warm.before) if warm.back else np.inf

    def course(t: Array, rise: float) -> tuple[Array, Array]:
        """Return T and R less their start, from equilibrium at t = 0, where T is driven to rise."""
        c, tau = warm.constant, warm.lag
        element = rise * (1 - np.exp(-t / c))
        slow, fast = c / (c - tau), tau / (c - tau)
        return element, rise * (1 - slow * np.exp(-t / c) + fast * np.exp(-t / tau))

    element, recorded = course(since, end - start)
    if warm.back:
        # The way back is the same drive reversed, added from the turn on.
        later = np.maximum(since - half, 0.0)
        more = course(later, -(end - start))
        element, recorded = element + more[0], recorded + more[1]
    reading = sum(BIAS[:, k] * (start + element - 20.0)[:, None] ** k for k in range(3))
    reading = reading + warm.louder * WHITE * np.sqrt(warm.rate) * rng.standard_normal((n, 3))
    kelvin = start + recorded + warm.noise * rng.standard_normal(n)
    if warm.refreshed:
        phase = rng.uniform(0, warm.refreshed)
        held = np.floor((time + phase) / warm.refreshed)
        first = np.searchsorted(held, held)  # the first reading of each refreshed value
        kelvin = kelvin[first]
    if warm.step:
        rounded = np.floor if warm.truncated else np.round
        kelvin = warm.step * rounded(kelvin / warm.step)
    kept = round(warm.lost * warm.rate)
    return time[kept:] - time[kept], kelvin[kept:] + ZERO, np.asarray(reading[kept:])
