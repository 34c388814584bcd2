"""Compiled functions that compute the readings of an IMU on a turntable, in small blocks.

The motion at the sample times is interpolated between servo cycles. The commanded rate r_k of a
cycle is the mean over this cycle, so the rate at its end is (r_k + r_k+1)/2. The angle between two
cycle ends is the cubic through their angles and rates, and its derivatives give rate and
acceleration. Therefore the integral of the rate equals the angle up to rounding.

Attitude, f, ω and the derivative of ω are those of `inercal.benches.turntable.attitude`. The
sensor's terms are those of `inercal.physics.sensors.axis_model` in the reference form: each is a
product of at most `MAX_FACTORS` components of the motion that its axis senses.
"""
# Numba's decorator is not typed.
# pyright: reportUntypedFunctionDecorator=false

from math import floor

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.estimation.kernel_options import njit
from inercal.physics.sensors.basis_functions import COMPONENTS

RING_SIZE = 8192  # servo cycles of motion to keep, a power of 2
MAX_FACTORS = 4  # components in a product
COMPONENT_COUNT = len(COMPONENTS)


@njit(cache=True, nogil=True)
def store_motion(ring: Array, first: int, motion: Array) -> None:
    """Store angles and rates (n, k, 3) of the cycles from `first` on in `ring` (KEPT, k, 2)."""
    for j in range(motion.shape[0]):
        for i in range(motion.shape[1]):
            ring[(first + j) & (RING_SIZE - 1), i, 0] = motion[j, i, 0]
            ring[(first + j) & (RING_SIZE - 1), i, 1] = motion[j, i, 1]


@njit(cache=True, nogil=True)
def interpolate_motion(ring: Array, period: float, times: Array, out: Array) -> None:
    """Write angle, rate and acceleration at `times` (n,), s, to `out` (n, k, 3)."""
    last = RING_SIZE - 1
    for n in range(times.size):
        cycle = floor(times[n] / period)
        u = times[n] / period - cycle
        for i in range(out.shape[1]):
            a, b = ring[cycle & last, i, 0], ring[(cycle + 1) & last, i, 0]
            middle = ring[(cycle + 1) & last, i, 1]
            v = 0.5 * (ring[cycle & last, i, 1] + middle) * period
            w = 0.5 * (middle + ring[(cycle + 2) & last, i, 1]) * period
            d = b - a
            out[n, i, 0] = a + u * (v + u * (3 * d - 2 * v - w + u * (v + w - 2 * d)))
            out[n, i, 1] = (v + u * (2 * (3 * d - 2 * v - w) + 3 * u * (v + w - 2 * d))) / period
            out[n, i, 2] = (2 * (3 * d - 2 * v - w) + 6 * u * (v + w - 2 * d)) / period**2


@njit(cache=True, nogil=True)
def noise_free_readings(
    motion: Array,
    temperature_offset: float,
    frames: Array,
    along: Indices,
    of_axis: Indices,
    factors: Array,
    products: Indices,
    out: Array,
) -> None:
    """Write noise-free readings to `out` (n, m) from f, ω and ω's derivative, `motion` (n, 9).

    `temperature_offset` is the temperature minus the reference, K. `frames` (m, 3, 3) contains the
    axes' I, P and O, and `along` (m,) is the error-free reading of each axis. A term consists of a
    factor, its axis and the components in its product, `products` (terms, MAX_FACTORS), which is
    filled up with −1.
    """
    seen = np.zeros(COMPONENT_COUNT)  # dTdt stays 0, as a simulation has a constant temperature
    for n in range(motion.shape[0]):
        term = 0
        for k in range(along.size):
            for kind in range(3):
                for i in range(3):
                    part = 0.0
                    for j in range(3):
                        part += frames[k, i, j] * motion[n, 3 * kind + j]
                    seen[3 * kind + i] = part
            seen[9], seen[10], seen[11] = np.sign(seen[0]), np.sign(seen[3]), temperature_offset
            reading = seen[along[k]]
            while term < of_axis.size and of_axis[term] == k:
                value = factors[term]
                for j in range(MAX_FACTORS):
                    if products[term, j] >= 0:
                        value *= seen[products[term, j]]
                reading += value
                term += 1
            out[n, k] = reading


@njit(cache=True, nogil=True)
def add_noise_and_limits(
    reading: Array, noise: Array, step: Array, low: Array, high: Array
) -> None:
    """Add noise (n, m), round to steps (m,) if there are any, and limit the range, in place."""
    for n in range(reading.shape[0]):
        for k in range(reading.shape[1]):
            value = reading[n, k] + noise[n, k]
            if step[k] > 0.0:
                value = np.rint(value / step[k]) * step[k]
            reading[n, k] = min(max(value, low[k]), high[k])
