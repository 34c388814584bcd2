"""A gyro at rest while its temperature moves: imports nothing of inercal.

    y = a + b(T) + noise,   T the temperature of the element, R that which its sensor reads,
    τ dR/dt = T − R

The bias is a cubic about 25 °C; noise is white, flicker and a random walk.
"""

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
DEG_H = np.pi / 180 / 3600
ZERO = 273.15
REFERENCE = ZERO + 25.0
BIAS = tuple(c * DEG_H for c in (30.0, 54.0, 0.36, 0.0072))
WHITE, FLICKER, WALK = (n * DEG_H for n in (9.0, 5.0, 0.2))
LAG = 20.0
TEMPERATURE_NOISE = 0.01  # K, of a sample
MINUTE = 60.0
COMPARED = np.arange(0.0, 51.0, 5.0) + ZERO  # where b(T) − b(25 °C) is compared


def legs(*turning: float, minutes: float) -> Array:
    """Return temperatures each second along straight legs between turning points, °C."""
    n = round(minutes * MINUTE)
    parts = [np.linspace(a, b, n, endpoint=False) for a, b in itertools.pairwise(turning)]
    return np.concatenate(parts)


def self_heating() -> Array:
    """Return 15 to 57 °C within 40 minutes, as a device warms by itself."""
    return 15.0 + 42.0 * (1 - np.exp(-np.arange(2400.0) / 600.0))


def soaks() -> Array:
    """Return eight soaks of 15 minutes, which the element follows within 2 minutes, °C."""
    chamber = np.repeat(np.linspace(-10.0, 60.0, 8), 900)
    return lagging(chamber, 120.0)


PROFILES = {
    "up, 30 min": lambda: legs(-10, 60, minutes=30),
    "up, 2 h": lambda: legs(-10, 60, minutes=120),
    "self-heating, 40 min": self_heating,
    "up and down, 2 × 30 min": lambda: legs(-10, 60, -10, minutes=30),
    "up and down, 2 × 2 h": lambda: legs(-10, 60, -10, minutes=120),
    "eight soaks of 15 min": soaks,
}


def lagging(driving: Array, time_constant: float) -> Array:
    """Return what follows a course of straight pieces, one value a second, exactly."""
    keep = np.exp(-1 / time_constant)
    last = 1 - (1 - keep) * time_constant  # weight of the value at the end of each second
    result, state, before = np.empty_like(driving), driving[0], driving[0]
    for k, value in enumerate(driving.tolist()):
        state = keep * state + (1 - keep - last) * before + last * value
        result[k], before = state, value
    return result


@dataclass(frozen=True, eq=False)
class Ramp:
    """One recording of a gyro, one sample a second.

    Parameters
    ----------
    time : (n,) array
        s.
    recorded : (n,) array
        What the temperature sensor reads, K.
    reading : (n,) array
        rad/s.
    """

    time: Array
    recorded: Array
    reading: Array


def change(kelvin: Array) -> Array:
    """Return b(T) − b(25 °C), rad/s."""
    warmth = kelvin - REFERENCE
    return sum((BIAS[k] * warmth**k for k in (1, 2, 3)), np.zeros(kelvin.shape))


def record(
    rng: np.random.Generator, element: Array, *, warm_up: float = 0.0, drift: float = 0.0
) -> Ramp:
    """Return a recording along temperatures of the element, °C each second.

    Parameters
    ----------
    rng : Generator
    element : (n,) array
    warm_up : float
        Size of a warm-up of 300 s, rad/s.
    drift : float
        Of the bias over the run, linear in time, rad/s.
    """
    kelvin, n = element + ZERO, element.size
    time = np.arange(float(n))
    # The sensor has settled before the recording.
    before = np.full(600, kelvin[0])
    recorded = lagging(np.concatenate([before, kelvin]), LAG)[600:]
    reading = BIAS[0] + change(kelvin)
    reading = reading + warm_up * np.exp(-time / 300.0) + drift * time / time[-1]
    reading += WHITE * rng.standard_normal(n) + FLICKER * flicker(rng, n)
    reading += WALK * np.cumsum(rng.standard_normal(n))
    return Ramp(time, recorded + TEMPERATURE_NOISE * rng.standard_normal(n), reading)


def flicker(rng: np.random.Generator, n: int) -> Array:
    """Return noise of two-sided spectrum 1/(2π f), one sample a second, from 1/(8 n) Hz on."""
    size = 4 * n
    f = np.fft.rfftfreq(size)
    gain = np.zeros(f.size)
    gain[1:] = (2 * np.pi * f[1:]) ** -0.5
    spectrum = np.fft.rfft(rng.standard_normal(size)) * gain
    return np.fft.irfft(spectrum, n=size)[:n]
