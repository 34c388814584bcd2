"""A sensor moved by hand from rest to rest, made without a line of inercal."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
G0 = 9.80665
BIAS = np.array([0.3, -0.2, 0.4])  # m/s²
SCALE = np.array([4000.0, -4000.0, 10000.0])  # ppm
GYRO_BIAS = np.array([1.5, -0.8, 0.6])  # °/s
GYRO_SCALE = np.array([20000.0, -15000.0, 10000.0])  # ppm
TRUTH = {
    **{f"a{a}.k0": x / G0 * 1e6 for a, x in zip("xyz", BIAS, strict=True)},  # µg
    **{f"a{a}.k1": x for a, x in zip("xyz", SCALE, strict=True)},
    **{f"g{a}.bias": x * 3600 for a, x in zip("xyz", GYRO_BIAS, strict=True)},  # °/h
    **{f"g{a}.scale": x for a, x in zip("xyz", GYRO_SCALE, strict=True)},
}


class Hand(NamedTuple):
    """Readings of a recording by hand: m/s² and °/s, (n, 3) each."""

    force: Array
    rate: Array


def turn(vector: Array) -> Array:
    """Return the matrix of a rotation by a vector, rad (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    x, y, z = vector / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def by_hand(hz: float, rests: int = 24, seed: int = 1) -> Hand:
    """Return readings with the errors above, at rest for 2 s and then turned within 1.5 s."""
    rng = np.random.default_rng(seed)
    still, moving = int(2 * hz), int(1.5 * hz)
    attitude = turn(rng.normal(size=3))
    up, rate = [], []
    for _ in range(rests):
        up += [attitude[2]] * still
        rate += [np.zeros(3)] * still
        axis = rng.normal(size=3)
        axis *= np.radians(rng.uniform(70, 140)) / np.linalg.norm(axis)
        begin = attitude
        for k in range(moving):
            part = (k + 0.5) / moving
            turned = part - np.sin(2 * np.pi * part) / (2 * np.pi)  # the integral of 2 sin²(π x)
            up.append((begin @ turn(axis * turned))[2])
            rate.append(axis * 2 * np.sin(np.pi * part) ** 2 / moving * hz)
        attitude = begin @ turn(axis)
    force = np.array(up) * G0 * (1 + SCALE * 1e-6) + BIAS
    degrees = np.degrees(rate) * (1 + GYRO_SCALE * 1e-6) + GYRO_BIAS
    return Hand(
        force + rng.normal(size=force.shape) * 0.02, degrees + rng.normal(size=force.shape) * 0.1
    )
