"""Simulated laboratories that repeat sessions of a triad: without inercal.

Each session has its own noise; bias and scale factor change with the power cycle, the misalignments
turn with the mounting; gravity and the fixture are wrong by the same amount in all sessions.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
AXES = ("ax", "ay", "az")
TERMS = ("k0", "k1", "delta_o", "delta_p")
NAMES = tuple(f"{axis}.{term}" for axis in AXES for term in TERMS)
KIND = np.tile([0, 1, 2, 2], 3)  # bias, scale factor, misalignment
MICRO = 1e-6


def rotation() -> Array:
    """Return how a small rotation of the sensor moves the coefficients, (12, 3)."""
    result = np.zeros((len(NAMES), 3))
    for k in range(3):
        i, p = np.eye(3)[k], np.eye(3)[(k + 1) % 3]
        result[4 * k + 2], result[4 * k + 3] = np.cross(i, p), p
    return result


@dataclass(frozen=True)
class Laboratory:
    """Standard deviations of bias, scale factor and misalignment, 1e-6 SI."""

    own: tuple[float, float, float] = (9.3, 14.0, 18.0)
    shared: tuple[float, float, float] = (0.0, 10.0, 20.0)
    turn_on: tuple[float, float, float] = (60.0, 30.0, 0.0)
    day: tuple[float, float, float] = (0.0, 0.0, 0.0)
    mount: float = 40.0
    odd: float = 1.0  # how many times more ax.k0 scatters


@dataclass(frozen=True)
class Drawn:
    """k sessions, (k, 12), the mean, the next use, and the columns of what is shared, (2, 12)."""

    values: Array
    mean: Array
    next_use: Array
    shared: Array
    covariance: Array = field(repr=False)


def draw(
    laboratory: Laboratory,
    k: int,
    rng: np.random.Generator,
    days: NDArray[np.intp] | None = None,
) -> Drawn:
    """Draw k sessions, of another day each unless stated, and a next use on another day."""
    own, turn_on, day, common = (
        MICRO * np.array(one)[KIND]
        for one in (laboratory.own, laboratory.turn_on, laboratory.day, laboratory.shared)
    )
    turn_on = turn_on * np.where(np.arange(12) == 0, laboratory.odd, 1.0)
    columns = np.array([np.where(kind == KIND, common, 0.0) for kind in (1, 2)])
    mean = 1e-3 * rng.standard_normal(12)
    of_day: list[int] = list(range(k)) if days is None else days.tolist()
    by_day = day * rng.standard_normal((max(of_day) + 2, 12))
    turns = MICRO * laboratory.mount * rng.standard_normal((k + 1, 3)) @ rotation().T
    uses = mean + turn_on * rng.standard_normal((k + 1, 12)) + turns
    uses = uses + by_day[[*of_day, -1]]
    values = uses[:k] + own * rng.standard_normal((k, 12)) + rng.standard_normal(2) @ columns
    covariance = np.diag(own**2) + columns.T @ columns
    return Drawn(values, mean, uses[k], columns, covariance)
