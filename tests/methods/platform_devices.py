"""Gyros on a rate table, made with plain numpy: nothing of inercal is imported.

Truth, errors of the table and noise are drawn; what a mean reading is, is worked out here anew.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
DEG_PER_H = np.pi / 180 / 3600
ARCSEC = np.pi / 648_000
EARTH = 7.292115e-5
G = 9.81
# Angle random walk in °/√h, bias instability in °/h.
GRADES = {"T": (0.1, 0.5), "C": (0.3, 5.0)}
SPREAD = {  # of true coefficients, SI
    "bias": 100 * DEG_PER_H,
    "scale": 1e-3,
    "delta_o": 2e-3,
    "delta_p": 2e-3,
    "scale2": 1e-4,
    "scale3": 6e-5,
    "scale_prime": 5e-4,
    "g_i": 30 * DEG_PER_H / G,
    "g_p": 30 * DEG_PER_H / G,
    "g_o": 30 * DEG_PER_H / G,
}


@dataclass(frozen=True)
class Table:
    """Standard deviations of a table's errors, SI."""

    rate_scale: float
    rate_asymmetry: float
    rate_stability: float
    angle_reading: float
    setting: float
    turn_angle: float = 0.0

    def stated(self) -> dict[str, Any]:
        return dict(self.__dict__)


PLAIN = Table(5e-4, 1e-4, 1e-4, 0.0, np.radians(0.05))
READ = Table(5e-6, 0.0, 0.0, 5 * ARCSEC, np.radians(0.02))
EXACT = Table(0.0, 0.0, 0.0, 0.0, 0.0)
TABLES = {"plain": PLAIN, "read": READ}


@dataclass(frozen=True)
class Row:
    """A section: setting, case axis up with its sign, rate in rad/s, seconds, turn by an angle."""

    setting: str
    axis: int
    sign: int
    rate: float
    seconds: float
    turn: bool = False

    @property
    def name(self) -> str:
        """The axis as run files write it."""
        return ("-" if self.sign < 0 else "") + "xyz"[self.axis]


def plan(rates: Sequence[float], *, six: bool = False, seconds: float = 36.0) -> list[Row]:
    """Return rests and rates, °/s, over whole turns with each axis up, or up and down."""
    rows: list[Row] = []
    for axis in range(3):
        for sign in (1, -1) if six else (1,):
            for rate in rates:
                turns = abs(rate) * seconds / 360 // 1
                lasting = seconds if rate == 0 or turns == 0 else turns * 360 / abs(rate)
                setting = f"{'-' if sign < 0 else ''}{'xyz'[axis]}"
                rows.append(Row(setting, axis, sign, float(np.radians(rate)), lasting))
    return rows


def turns(angles: Sequence[float], *, rate: float = 75.0, rest: float = 10.0) -> list[Row]:
    """Return turns by angles, °, with each axis up, and a rest before, between and after them."""
    rows: list[Row] = []
    for axis in range(3):
        still = Row("xyz"[axis], axis, 1, 0.0, rest)
        rows.append(still)
        for angle in angles:
            seconds = abs(angle) / rate
            signed = float(np.radians(angle)) / seconds
            rows += [Row("xyz"[axis], axis, 1, signed, seconds, turn=True), still]
    return rows


SHORT = plan([0, 100, -100])
MID = plan([0, 50, -50, 200, -200, 0])
_UP = [10, 30, 60, 100, 150, 200]
_UP_AND_DOWN = [*_UP, *_UP[-2::-1]]
FULL = plan([0, *_UP_AND_DOWN, 0, *(-rate for rate in _UP_AND_DOWN), 0])
MID_SIX = plan([0, 50, -50, 200, -200, 0], six=True)


@dataclass
class Devices:
    """Many devices on one plan: readings (n, r, 3) and true coefficients (n, 3) by name."""

    rows: list[Row]
    reading: Array
    sd: Array
    truth: dict[str, Array] = field(default_factory=dict[str, Array])


def devices(
    rows: Sequence[Row],
    grade: str,
    table: Table,
    terms: Sequence[str],
    n: int,
    rng: np.random.Generator,
    *,
    latitude: float = np.radians(50.0),
    noisy: bool = True,
    size: dict[str, float] | None = None,
) -> Devices:
    """Draw n devices; `size` replaces the spread of coefficients by a value, of x alone."""
    truth = {t: SPREAD[t] * rng.standard_normal((n, 3)) for t in terms}
    for term, value in (size or {}).items():
        truth[term] = value * np.tile([1.0, 0.0, 0.0], (n, 1))
    walk, instability = GRADES[grade]
    lasting = np.array([row.seconds for row in rows])
    variance = (np.radians(walk) / 60) ** 2 / lasting + (0.66 * instability * DEG_PER_H) ** 2
    rate, force = motion_in_case(rows, table, n, rng, latitude)
    reading = np.stack([_gyros(rate[:, k], force[:, k], truth) for k in range(len(rows))], axis=1)
    if noisy:
        reading += np.sqrt(variance)[:, None] * rng.standard_normal(reading.shape)
    return Devices(list(rows), reading, np.sqrt(variance), truth)


def motion_in_case(
    rows: Sequence[Row],
    table: Table,
    n: int,
    rng: np.random.Generator,
    latitude: float = np.radians(50.0),
) -> tuple[Array, Array]:
    """Return the mean rate and the mean specific force in the case, (n, r, 3) each."""
    scale, asymmetry = (
        s * rng.standard_normal(n) for s in (table.rate_scale, table.rate_asymmetry)
    )
    azimuth = {row.setting: rng.uniform(0, 2 * np.pi, n) for row in rows}
    tilts = {row.setting: table.setting * rng.standard_normal((n, 2)) for row in rows}
    rates, forces = np.empty((2, n, len(rows), 3))
    for k, row in enumerate(rows):
        rate = row.rate * (1 + scale + table.rate_stability * rng.standard_normal(n))
        rate = rate + abs(row.rate) * asymmetry
        if row.turn:
            rate = row.rate + table.turn_angle * rng.standard_normal(n) / row.seconds
        elif row.rate:
            rate = rate + table.angle_reading * rng.standard_normal(n) / row.seconds
        rates[:, k], up = _rates_in_case(
            row, rate, tilts[row.setting], azimuth[row.setting], latitude
        )
        forces[:, k] = G * up
    return rates, forces


def _rates_in_case(
    row: Row, rate: Array, tilt: Array, azimuth: Array, latitude: float
) -> tuple[Array, Array]:
    """Return the mean rate and the direction up in the case, (n, 3), by summing over the turn."""
    j, n = row.axis, len(rate)
    up = np.zeros((n, 3))
    up[:, j] = row.sign
    up[:, (j + 1) % 3], up[:, (j + 2) % 3] = tilt[:, 0], tilt[:, 1]
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    first = np.zeros((n, 3))
    first[:, (j + 1) % 3] = 1.0
    first -= up * np.sum(first * up, axis=1, keepdims=True)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(up, first)
    # North in the case turns back by the angle turned.
    moments = (np.arange(360) + 0.5) / 360
    angle = azimuth[:, None] - (row.rate * row.seconds) * moments
    north = np.cos(angle).mean(axis=1)[:, None] * first
    north += np.sin(angle).mean(axis=1)[:, None] * second
    whole = (rate + EARTH * np.sin(latitude))[:, None] * up
    return whole + EARTH * np.cos(latitude) * north, up


def _gyros(w: Array, f: Array, truth: dict[str, Array]) -> Array:
    """Return the readings of three gyros: O = I × P, axes in the cycle x, y, z."""

    def of(term: str, k: int) -> Array:
        return truth[term][:, k] if term in truth else np.zeros(len(w))

    result = np.empty_like(w)
    for k in range(3):
        i, p, o = w[:, k], w[:, (k + 1) % 3], w[:, (k + 2) % 3]
        result[:, k] = (
            i
            + of("bias", k)
            + of("scale", k) * i
            + of("delta_o", k) * p
            - of("delta_p", k) * o
            + of("scale2", k) * i**2
            + of("scale3", k) * i**3
            + 0.5 * of("scale_prime", k) * np.abs(i)
            + of("g_i", k) * f[:, k]
            + of("g_p", k) * f[:, (k + 1) % 3]
            + of("g_o", k) * f[:, (k + 2) % 3]
        )
    return result
