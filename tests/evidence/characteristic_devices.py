"""Sensors with hysteresis, a dead band and a limited resolution, made with plain numpy.

A gyro is on a rate table, and an accelerometer on a dividing head; nothing of inercal is imported.
The errors of the bench, the other coefficients and the noise are drawn. Small inputs follow each
other in a small loop, whose hysteresis is a fifth: about zero, where the dead band is, and about
another input, where the resolution is.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
DEG_PER_H = np.pi / 180 / 3600
ARCSEC = np.pi / 648_000
G, EARTH, LATITUDE = 9.81, 7.292115e-5, 0.0
UG = 9.80665e-6

LOCAL = 1e-3  # sd of the relative difference between the slope at small inputs and at others

RATES = np.radians([5.0, 30, 60, 100, 150, 200])
SMALL_RATES = np.radians([0.002, 0.005, 0.01, 0.02, 0.04, 0.06])
SECONDS = 36.0
POSITIONS = 12
SMALL_TILTS = ARCSEC * np.array([1.0, 2, 4, 8, 16, 32])
APPLIED = {"gyro": SMALL_RATES, "accelerometer": G * SMALL_TILTS}
OTHER_SLOPE = {"gyro": 1.0, "accelerometer": float(np.cos(np.pi / 6))}


@dataclass(frozen=True)
class Effects:
    """Hysteresis, half width of the dead band and of the band about another input, SI."""

    hysteresis: float = 0.0
    band: float = 0.0
    other_band: float = 0.0
    law: str = "play"
    spread: float = 0.0  # relative range of the widths of single devices


@dataclass(frozen=True)
class RateTable:
    """Standard deviations of a table with readback, SI."""

    rate_scale: float = 5e-6
    rate_asymmetry: float = 1e-6
    rate_stability: float = 0.5e-6
    angle_reading: float = 2 * ARCSEC
    rate_hysteresis: float = 0.3 * DEG_PER_H
    settling: float = 0.3e-6
    setting: float = np.radians(0.02)
    noise: float = 1.2 * DEG_PER_H


@dataclass(frozen=True)
class Head:
    """Standard deviations of a dividing head, SI."""

    harmonics: tuple[float, float] = (0.5 * ARCSEC, 0.4 * ARCSEC)
    division: float = 0.3 * ARCSEC
    base: float = 1.0 * ARCSEC
    pier: float = 0.02 * ARCSEC
    backlash: float = 0.1 * ARCSEC
    drift: float = 1.0 * UG
    noise: float = 0.3 * UG


@dataclass
class Readings:
    """Rows of n devices: inputs of the bench (r,), senses, readings (n, r), and the true widths."""

    at: Array
    sense: Array
    reading: Array
    true_band: Array
    true_other: Array
    names: list[str] = field(default_factory=list[str])


def loop(changes: Array) -> Array:
    """Return a loop: zero, up, down through zero, and up to zero."""
    half = [0.0, *changes, *changes[-2::-1], 0.0]
    return np.array([*half, *(-one for one in half[1:])])


def respond(law: str, z: Array, width: Array) -> Array:
    """Return the response to inputs about the centre of a band."""
    size = np.abs(z)
    reached = size >= width
    over = {
        "play": size - width,
        "lock-in": np.sqrt(np.maximum(size**2 - width**2, 0.0)),
        "jump": size,
    }[law]
    return np.where(reached, np.sign(z) * over, 0.0)


def _widths(size: float, effects: Effects, n: int, rng: np.random.Generator) -> Array:
    return size * (1 + effects.spread * rng.uniform(-1, 1, (n, 1)))


def gyros(effects: Effects, n: int, rng: np.random.Generator) -> Readings:
    """Return n gyros on a table whose axis is along the input axis."""
    table = RateTable()
    through = [*RATES, *RATES[-2::-1]]
    main = np.array([0.0, *through, 0.0, *(-rate for rate in through), 0.0])
    small = loop(SMALL_RATES)
    rate = np.concatenate([main, small, RATES[0] + small])
    part = np.repeat([0, 1, 2], [len(main), len(small), len(small)])
    lasting = np.full(len(rate), SECONDS)
    fast = np.abs(rate) * SECONDS >= 2 * np.pi
    turn = 2 * np.pi / np.abs(np.where(fast, rate, 1.0))
    lasting = np.where(fast, SECONDS // turn * turn, SECONDS)
    sense, step = np.zeros(len(rate)), np.zeros(len(rate))
    for k in range(1, len(rate)):
        change = rate[k] - rate[k - 1]
        sense[k], step[k] = (np.sign(change), change) if change else (sense[k - 1], step[k - 1])
    top = np.abs(rate).max()

    def drawn(sd: float, shape: tuple[int, ...] = (1,)) -> Array:
        return sd * rng.standard_normal((n, *shape))

    error = rate * drawn(table.rate_scale) + np.abs(rate) * drawn(table.rate_asymmetry)
    error = error + rate * drawn(table.rate_stability, rate.shape)
    error += drawn(table.angle_reading, rate.shape) / lasting
    error -= 0.5 * sense * (1 - (rate / top) ** 2) * drawn(table.rate_hysteresis)
    turned = rate + error * (rate != 0) + step * drawn(table.settling)
    w = turned + EARTH * np.sin(LATITUDE)
    band, other = (_widths(x, effects, n, rng) for x in (effects.band, effects.other_band))
    sensed = respond(effects.law, w, band)
    own = part == 2
    centre = w[:, own].mean(axis=1, keepdims=True)
    sensed[:, own] = respond(effects.law, centre, band)
    sensed[:, own] += (1 + drawn(LOCAL)) * respond(effects.law, w[:, own] - centre, other)
    sensed[:, part == 1] *= 1 + drawn(LOCAL)
    y = drawn(100 * DEG_PER_H) + (1 + drawn(1e-3)) * sensed
    y = y + drawn(2e-6) * w**2 + drawn(2e-6) * w**3 + drawn(2e-5) * np.abs(w)
    reach = np.array([top, SMALL_RATES[-1], SMALL_RATES[-1]])[part]
    middle = np.array([0.0, 0.0, RATES[0]])[part]
    amount = np.array([1.0, 0.2, 0.2])[part] * effects.hysteresis
    first = len(main) + np.array([0, len(small)])  # reached by a large change
    reach[first], middle[first], amount[first] = top, 0.0, effects.hysteresis
    y -= 0.5 * amount * sense * (1 - ((rate - middle) / reach) ** 2)
    y += drawn(table.noise, rate.shape)
    return Readings(rate, lasting, y, band[:, 0], other[:, 0])


def _turned_senses(angle: Array) -> Array:
    sense = np.ones(len(angle))
    for k in range(1, len(angle)):
        move = (angle[k] - angle[k - 1] + np.pi) % (2 * np.pi) - np.pi
        sense[k] = np.sign(move) if abs(move) > 1e-9 else -1.0  # the repeat begins the way back
    return sense


def accelerometers(effects: Effects, n: int, rng: np.random.Generator) -> Readings:
    """Return n accelerometers, one at a time on the head."""
    head = Head()
    once = 2 * np.pi / POSITIONS * np.arange(POSITIONS)
    small = loop(SMALL_TILTS)
    angle: Array = np.array([*once, *once[::-1], *(np.pi / 6 + small), *small], dtype=float)
    part = np.repeat([0, 1, 2, 3], [POSITIONS, POSITIONS, len(small), len(small)])
    place = np.concatenate([np.arange(12), np.arange(12)[::-1], 0 * small + 1, 0 * small])
    place = place.astype(np.int64)
    sense = _turned_senses(angle)

    def drawn(sd: float, shape: tuple[int, ...] = (1,)) -> Array:
        return sd * rng.standard_normal((n, *shape))

    base = once[place]
    error = drawn(head.base) + drawn(head.pier, angle.shape)
    for h, sd in enumerate(head.harmonics, start=1):
        error = error + drawn(sd) * np.sin(h * base) + drawn(sd) * np.cos(h * base)
    error += drawn(head.division, (POSITIONS,))[:, place]
    error += 0.5 * sense * drawn(head.backlash)
    psi = angle + error
    mounting = drawn(2 * ARCSEC)
    f, p = G * np.sin(psi + mounting), G * np.cos(psi + mounting)
    band, other = (_widths(x, effects, n, rng) for x in (effects.band, effects.other_band))
    sensed = respond(effects.law, f, band)
    own = part == 2
    centre = f[:, own].mean(axis=1, keepdims=True)
    sensed[:, own] = respond(effects.law, centre, band)
    sensed[:, own] += (1 + drawn(LOCAL)) * respond(effects.law, f[:, own] - centre, other)
    sensed[:, part == 3] *= 1 + drawn(LOCAL)
    y = drawn(300 * UG) + (1 + drawn(2e-4)) * sensed
    y = y + drawn(10 * UG) * (f / G) ** 2 + drawn(10 * UG) * f * p / G**2
    y = y + drawn(5 * UG) * (f / G) ** 3
    drift, before = np.zeros((n, 1)), np.zeros((n, 1))
    for k in range(4):
        rows = np.flatnonzero(part == k)
        pace = drawn(head.drift) / POSITIONS
        y[:, rows] += before + pace * np.arange(len(rows))
        before = before + pace * len(rows)
    reach = np.array([G, G, G * np.cos(np.pi / 6) * SMALL_TILTS[-1], G * SMALL_TILTS[-1]])[part]
    middle = np.array([0.0, 0.0, G * np.sin(np.pi / 6), 0.0])[part]
    amount = np.array([1.0, 1.0, 0.2, 0.2])[part] * effects.hysteresis
    first = 2 * POSITIONS + np.array([0, len(small)])  # reached by a large change
    reach[first], middle[first], amount[first] = G, 0.0, effects.hysteresis
    rising = sense * np.sign(np.round(np.cos(angle), 9))
    y -= 0.5 * amount * rising * (1 - ((G * np.sin(angle) - middle) / reach) ** 2)
    y += drawn(head.noise, angle.shape) + drift
    return Readings(angle, sense, y, band[:, 0], other[:, 0])


SENSORS = {"gyro": gyros, "accelerometer": accelerometers}
LAWS: Sequence[str] = ("play", "lock-in", "jump")
HALF = {"play": 2.0, "lock-in": 2 / np.sqrt(3), "jump": 1.0}
