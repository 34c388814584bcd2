"""Accelerometers after turn-on, made with plain numpy; nothing of inercal is imported.

Each is read once a minute while a dividing head stands still, and then in a tumble test. The null
moves as an exponential from turn-on. A scatter is added from reading to reading, and the angle of
the head is in error by a common amount and by the tilt of the pier at each reading.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ARCSEC = np.pi / 648_000
G = 9.81
UG = 9.80665e-6
READINGS, POSITIONS = 40, 12
FIRST, INTERVAL = 30.0, 60.0  # s
NOISE, PIER, BASE = 0.3 * UG, 0.05 * ARCSEC, 2 * ARCSEC


class Effects(NamedTuple):
    """Change of the null from turn-on to its end, time constant and scatter; SI."""

    change: float
    constant: float
    scatter: float


class Readings(NamedTuple):
    """Times, angles of the head and readings, (r,), (r,) and (n, r), SI."""

    time: Array
    angle: Array
    reading: Array


def accelerometers(effects: Effects, n: int, rng: np.random.Generator) -> Readings:
    """Return n accelerometers with the same effects."""
    turn = 2 * np.pi / POSITIONS * np.arange(POSITIONS)
    angle = np.concatenate([np.zeros(READINGS), turn, turn[::-1]]).astype(np.float64)
    r = len(angle)
    time = FIRST + INTERVAL * np.arange(r, dtype=np.float64)
    error = BASE * rng.standard_normal((n, 1)) + PIER * rng.standard_normal((n, r))
    bias, scale = 300 * UG * rng.standard_normal((n, 1)), 2e-4 * rng.standard_normal((n, 1))
    y = bias + (1 + scale) * G * np.sin(angle + error)
    y += NOISE * rng.standard_normal((n, r)) - effects.change * np.exp(-time / effects.constant)
    y[:, :READINGS] += effects.scatter * rng.standard_normal((n, READINGS))
    return Readings(time, angle, y)


def true_values(effects: Effects, band: float) -> dict[str, float]:
    """Return the drift from the first to the last reading, the times and the scatter, SI."""
    ends = np.exp(-np.array([FIRST, FIRST + INTERVAL * (READINGS - 1)]) / effects.constant)
    size = abs(effects.change)
    until = -effects.constant * np.log(band / size + ends[1]) if size else 0.0
    return {
        "warm-up drift": float(effects.change * (ends[0] - ends[1])),
        "short-term stability": effects.scatter,
        "warm-up time constant": effects.constant,
        "warm-up time": max(float(until), FIRST),
    }
