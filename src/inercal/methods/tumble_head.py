"""The dividing head of a tumble test: its positions, what is known of it, and what is felt on it.

The spindle is horizontal; the sensor's output axis lies along it.
"""

from dataclasses import dataclass
from math import degrees, pi

import numpy as np
from numpy.typing import NDArray

from inercal.errors import InputError
from inercal.sensors import Sensor
from inercal.units import Measured

Array = NDArray[np.float64]
FEWEST = 4  # positions


@dataclass(frozen=True)
class Position:
    """Keep the spindle at `angle`, rad: 0, π/2, π, 3π/2 = input axis level, up, level, down.

    Raises
    ------
    InputError
        An angle that is not finite.
    """

    label: str
    angle: float

    def __post_init__(self) -> None:
        if not np.isfinite(self.angle):
            raise InputError(f"position {self.label}: its angle is {self.angle}")

    def in_words(self) -> str:
        """Return what to do: "spindle at 30°"."""
        return f"spindle at {degrees(self.angle):.6g}°"


@dataclass(frozen=True)
class Head:
    """What is known of the dividing head.

    Parameters
    ----------
    gravity : Measured
        Local gravity, m/s².
    angle : float
        Standard deviation of each row's angle, rad; white: a second visit to a position errs anew.
    zero : float
        Standard deviation of the head's zero against the level, rad; shared by all rows.
    harmonics : tuple of float
        Of harmonics 1, 2, … of the head's angle error: standard deviation of the amplitudes of
        sine and of cosine, rad each. They repeat at every visit, and no residual shows the first.

    Raises
    ------
    InputError
        A gravity that is not positive, or a deviation that is negative or not finite.
    """

    gravity: Measured
    angle: float = 0.0
    zero: float = 0.0
    harmonics: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if not (np.isfinite(self.gravity.value) and self.gravity.value > 0):
            raise InputError(f"dividing head: gravity is {self.gravity.value} m/s²; give it > 0")
        for what, sd in (
            ("gravity", self.gravity.sd),
            ("angle", self.angle),
            ("zero", self.zero),
            *((f"harmonic {h}", sd) for h, sd in enumerate(self.harmonics, start=1)),
        ):
            if not (np.isfinite(sd) and sd >= 0):
                raise InputError(f"dividing head: deviation of {what} is {sd}; give it 0 or more")

    def of_angles(self, angle: Array) -> Array:
        """Return the covariance of the angles' errors, (r, r) rad², without that of the zero.

        Amplitudes of sine and cosine of one deviation σ make σ² cos h(θᵢ − θⱼ).
        """
        apart = angle[:, None] - angle
        total = self.angle**2 * np.eye(len(angle))
        for h, sd in enumerate(self.harmonics, start=1):
            total = total + sd**2 * np.cos(h * apart)
        return total


def positions(n: int, start: float = 0.0, back: bool = False) -> tuple[Position, ...]:
    """Return n evenly spaced positions from `start`, rad, and the same ones back where asked.

    Raises
    ------
    InputError
        Fewer than four.

    Examples
    --------
    >>> [p.label for p in positions(4)]
    ['p0', 'p1', 'p2', 'p3']
    """
    if n < FEWEST:
        raise InputError(f"{n} positions; a tumble test needs {FEWEST} or more")
    there = [Position(f"p{k}", start + 2 * pi * k / n) for k in range(n)]
    again = [Position(f"{p.label}_back", p.angle) for p in reversed(there)] if back else []
    return (*there, *again)


def felt_at(sensor: Sensor, angle: Array, g: Array, zero: Array) -> tuple[Array, Array, Array]:
    """Return specific force and its derivatives to g and to the angle, each (..., r, 3).

    Parameters
    ----------
    sensor : Sensor
        Of one axis.
    angle : (r,) array
        Nominal angles, rad.
    g, zero : (...) arrays
        Gravity, m/s², and what all angles are larger than nominal by, rad.
    """
    i, p, _ = sensor.axes[0].frame
    at = angle + zero[..., None]
    s, c = np.sin(at), np.cos(at)
    # The sign of what is felt must not hang on how sin π is rounded.
    s, c = (np.where(np.abs(x) < 1e-15, 0.0, x)[..., None] for x in (s, c))
    up, across = s * i + c * p, c * i - s * p
    return g[..., None, None] * up, up, g[..., None, None] * across
