"""Simulated continuous motion of gyros and a magnetometer; plain NumPy, nothing of inercal.

The rate of the body relative to the earth, ω, is a sum of sines. The attitude R takes vectors from
the body to the earth; Ṙ = R [ω]× is integrated at a finer step than the samples. The gyros read
ω + Rᵀ ω_e + b, and the magnetometer reads D Rᵀ B + o with the attitude at a time that is earlier by
the delay.
"""
# pyright: reportUnknownParameterType=false, reportPossiblyUnboundVariable=false

from dataclasses import dataclass

import numpy as np
from tests.magnetometer import generator as sim

SIGMA_M = 0.5e-6  # of a value, T
RATE_HZ, EVERY, SECONDS = 50.0, 2, 20.0
SIGMA_W = np.radians(0.005) * np.sqrt(RATE_HZ)  # of a sample, rad/s
STEPS = 4  # of the integration, in a sample
GAUSS = 0.5 - np.sqrt(3) / 6, 0.5 + np.sqrt(3) / 6


@dataclass
class Waves:
    """Rate of each axis: Σ amplitude · sin(2π f t + phase), rad/s."""

    amplitude: np.ndarray  # (3,)
    frequency: np.ndarray  # (3, waves), Hz
    phase: np.ndarray  # (3, waves)

    def rate(self, t):
        t = np.asarray(t, dtype=float)[..., None, None]
        waves = np.sin(2 * np.pi * self.frequency * t + self.phase)
        return self.amplitude * waves.sum(axis=-1)

    def turn(self, start, step):
        """Return the rotations of steps, (n, 3, 3), by Gauss's two points and their commutator."""
        one, two = (self.rate(start + c * step) for c in GAUSS)
        step = np.asarray(step)[..., None]
        vector = step / 2 * (one + two) + np.sqrt(3) / 12 * step**2 * np.cross(one, two)
        return sim.rotation(vector)


def waves(rng, axes=(1.0, 1.0, 1.0)):
    """Draw a slow motion of about 1 rad/s about each of the axes."""
    frequency = rng.uniform(0.05, 0.4, (3, 3))
    return Waves(0.7 * np.asarray(axes), frequency, rng.uniform(0, 2 * np.pi, (3, 3)))


@dataclass
class Motion:
    """What the estimator receives, and the truth."""

    device: sim.Device
    bias: np.ndarray  # of the gyros, rad/s
    delay: float  # s
    time: np.ndarray  # (n,)
    rate: np.ndarray  # (n, 3), readings of the gyros
    field: np.ndarray  # (n, 3), readings of the magnetometer, with repeated values
    fresh: np.ndarray  # (k,), samples with a new value


def motion(
    rng,
    own,
    *,
    seconds=SECONDS,
    rate_hz=RATE_HZ,
    every=EVERY,
    delay=0.0125,
    axes=(1.0, 1.0, 1.0),
    earth=(0.0, 0.0, 0.0),
    step=(0.0, 0.0, 0.0),
    noise=1.0,
):
    """Return a motion with a new value of the magnetometer at every sample that `every` divides.

    `earth` is the earth's rate (rad/s) and `step` is added to the field (T) from the middle on,
    both in the frame of the earth.
    """
    way = waves(rng, axes)
    count = int(seconds * rate_hz)
    time = np.arange(count) / rate_hz
    fine = 1 / (STEPS * rate_hz)
    before = int(np.ceil(abs(delay) / fine)) + 1  # the attitudes begin before the first sample
    grid = (np.arange(STEPS * count + 2 * before) - before) * fine
    attitude = [sim.scattered(rng, 1)[0]]
    for one in way.turn(grid[:-1], fine):
        attitude.append(attitude[-1] @ one)
    attitude = np.array(attitude)
    now = attitude[before + STEPS * np.arange(count)]
    bias = np.radians(1.0) * rng.standard_normal(3)
    rate = way.rate(time) + np.einsum("kji,j->ki", now, np.asarray(earth)) + bias
    rate = rate + noise * SIGMA_W * rng.standard_normal((count, 3))
    fresh = np.arange(0, count, every)
    then = time[fresh] - delay
    k = np.searchsorted(grid, then, side="right") - 1
    seen = attitude[k] @ way.turn(grid[k], then - grid[k])
    b = own.field + (then >= seconds / 2)[:, None] * np.asarray(step)
    field = np.einsum("kji,kj->ki", seen, b) @ own.d.T + own.o
    field = field + noise * SIGMA_M * rng.standard_normal(field.shape)
    return Motion(own, bias, delay, time, rate, field[np.arange(count) // every], fresh)
