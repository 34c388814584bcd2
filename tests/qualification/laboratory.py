"""A simulated laboratory that measures its benches: readings by geometry, nothing of inercal."""

from math import cos, pi, sin

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ARCSEC = pi / 180 / 3600
EARTH = 7.292115e-5  # rad/s
UP = np.array([0.0, 0.0, 1.0])


def turned(axis: str, angle: float) -> Array:
    """Return the matrix of a rotation about a coordinate axis, right-handed."""
    c, s = cos(angle), sin(angle)
    return {
        "x": np.array([[1, 0, 0], [0, c, -s], [0, s, c]]),
        "y": np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]),
        "z": np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]),
    }[axis]


def head_error(theta: Array, waves: Array) -> Array:
    """Return Σ s sin hθ + c cos hθ of waves (h, 2)."""
    return sum(
        (s * np.sin(h * theta) + c * np.cos(h * theta) for h, (s, c) in enumerate(waves, 1)),
        np.zeros_like(theta),
    )


def collimated(
    rng: np.random.Generator, theta: Array, waves: Array, deviation: Array, sd: float, zero: float
) -> Array:
    """Return what the autocollimator reads on faces that deviate: the spindle is ahead by Δ.

    A face that deviates forward by p reflects as a spindle that is behind by p.
    """
    return head_error(theta, waves) - deviation + zero + sd * rng.normal(size=theta.shape)


def level_on_table(
    rng: np.random.Generator,
    theta: Array,
    lean: tuple[float, float],
    azimuth: float,
    zero: float,
    wobble: Array,
    sd: float,
    scale: float = 0.0,
) -> Array:
    """Return the level's readings: its end at the azimuth is high by the slope of the plate."""
    base = turned("x", lean[0]) @ turned("y", lean[1])  # east, north, up
    found: list[float] = []
    for angle in theta:
        heading = azimuth - angle
        flat = np.array([sin(heading), cos(heading), 0.0])
        found.append(float(np.arcsin((base @ flat) @ UP)))
    rough = sum(
        (a * np.cos(k * theta) + b * np.sin(k * theta) for k, (a, b) in enumerate(wobble, 2)),
        np.zeros_like(theta),
    )
    slopes = (np.array(found) + rough) * (1 + scale)
    return zero + slopes + sd * rng.normal(size=theta.shape)


def level_on_axis(
    rng: np.random.Generator,
    theta: Array,
    sense: Array,
    square: float,
    lean: tuple[float, float],
    zero: float,
    sd: float,
) -> Array:
    """Return a level on the x axis of a table "zx", whose z axis points up and leans."""
    base = turned("x", lean[0]) @ turned("y", lean[1])
    found: list[float] = []
    for angle in theta:
        axis = base @ turned("z", angle) @ turned("y", square) @ np.array([1.0, 0.0, 0.0])
        found.append(float(np.arcsin(axis @ UP)))
    return zero + sense * np.array(found) + sd * rng.normal(size=theta.shape)


def arm_readings(
    rng: np.random.Generator,
    rate: Array,
    *,
    radius: float,
    stretch: float,
    scale: float,
    k2: float,
    rate_error: float,
    g_ratio: float,
    sd: float,
) -> Array:
    """Return what an accelerometer on an arm reads; its scale was set by g/g_ratio."""
    w = rate * (1 + rate_error)
    a = radius * (1 + stretch * radius * rate**2) * w**2
    return ((1 + scale) * a + k2 * a**2) / g_ratio + sd * rng.normal(size=rate.shape)


def count_times(
    rng: np.random.Generator, rate: Array, turns: Array, error: Array, timer: float, base: float
) -> Array:
    """Return the seconds that turns take by a counter with a timebase."""
    true = 2 * pi * turns / (np.abs(rate) * (1 + error))
    stamps = timer * (rng.normal(size=rate.shape) - rng.normal(size=rate.shape))
    return true * (1 + base) + stamps


def gyro_at(
    rng: np.random.Generator,
    theta: Array,
    azimuth: float,
    offset: float,
    latitude: float,
    bias: float,
    sd: float,
) -> Array:
    """Return the readings of a gyro with a level input axis on a table that turned by θ."""
    earth = EARTH * np.array([0.0, cos(latitude), sin(latitude)])
    found: list[float] = []
    for angle in theta:
        # From north clockwise by the azimuth and the offset, then counter-clockwise by θ.
        axis = turned("z", angle) @ turned("z", -(azimuth + offset)) @ np.array([0.0, 1.0, 0.0])
        found.append(float(axis @ earth))
    return bias + np.array(found) + sd * rng.normal(size=theta.shape)
