"""Sensors with one to six axes, made with plain numpy: nothing of inercal is imported.

Accelerometers are set down on six faces, each with its tilt; gyros are turned on a rate table. All
axes of a device sense the same faces and the same table.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from tests.methods.platform_devices import PLAIN, Row, motion_in_case, plan

Array = NDArray[np.float64]
G = 9.81
GRAVITY_SD, TILT = 2e-4, np.radians(0.05)
NOISE = {"f": 3e-4, "w": np.radians(5 / 3600)}
SPREAD = {"bias": {"f": 0.05, "w": np.radians(100 / 3600)}, "scale": 2e-3, "delta": 2e-3}
_T = 1 / np.sqrt(3)
DIRECTIONS = {
    "one": [(0, 0, 1)],
    "one, inclined": [(0.6, 0.0, 0.8)],
    "two": [(1, 0, 0), (0, 0, 1)],
    "two, not at right angles": [(1, 0, 0), (0.6, 0.8, 0)],
    "three": [(1, 0, 0), (0, 1, 0), (0, 0, 1)],
    "four": [(_T, _T, _T), (_T, -_T, -_T), (-_T, _T, -_T), (-_T, -_T, _T)],
    "five": [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.6, 0, 0.8), (0, 0.6, 0.8)],
    "six": [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.6, 0, 0.8), (0, 0.6, 0.8), (-0.6, 0.8, 0)],
}
FACES = {"x_p": (1, 0, 0), "x_a": (-1, 0, 0), "y_p": (0, 1, 0), "y_a": (0, -1, 0),
         "z_p": (0, 0, 1), "z_a": (0, 0, -1)}  # fmt: skip
RATES: list[Row] = plan([0, 50, -50, 100, -100, 0])


@dataclass
class Devices:
    """Readings (n, r, m) with their deviation, and true coefficients (n, m) by name."""

    reading: Array
    sd: float
    truth: dict[str, Array]


def frames(directions: Array) -> Array:
    """Return I, P and O of each axis, (m, 3, 3): cyclic along x, y, z, otherwise P horizontal."""
    result: list[Array] = []
    for i in directions:
        p = np.roll(i, 1) if (i == 1).any() else np.array([-i[1], i[0], 0.0])
        p = p / np.linalg.norm(p)
        result.append(np.asarray([i, p, np.cross(i, p)], dtype=float))
    return np.array(result)


def draw_truth(kind: str, m: int, n: int, rng: np.random.Generator) -> dict[str, Array]:
    """Return coefficients (n, m) of m axes of n devices, by name."""
    size = {"bias": SPREAD["bias"][kind], "scale": SPREAD["scale"]}
    size |= dict.fromkeys(("delta_o", "delta_p"), SPREAD["delta"])
    return {name: sd * rng.standard_normal((n, m)) for name, sd in size.items()}


def read_axes(sensed: Array, directions: Array, truth: dict[str, Array]) -> Array:
    """Return readings (n, r, m) of motions (n, r, 3)."""
    i, p, o = np.moveaxis(np.einsum("nrk,mjk->nrmj", sensed, frames(directions)), -1, 0)
    t = {name: value[:, None] for name, value in truth.items()}
    return i + t["bias"] + t["scale"] * i + t["delta_o"] * p - t["delta_p"] * o


def _perpendicular(axis: Array) -> tuple[Array, Array]:
    first = np.roll(np.abs(axis), 1)
    return first, np.cross(axis, first)


def accelerometers(directions: Array, n: int, rng: np.random.Generator) -> Devices:
    """Return means of n devices on six faces."""
    truth = draw_truth("f", len(directions), n, rng)
    gravity = G + GRAVITY_SD * rng.standard_normal(n)
    force = np.empty((n, len(FACES), 3))
    for k, face in enumerate(FACES.values()):
        up = np.array(face, dtype=float)
        first, second = _perpendicular(up)
        tilt = TILT * rng.standard_normal((n, 2))
        off = up + tilt[:, :1] * first + tilt[:, 1:] * second
        force[:, k] = gravity[:, None] * off / np.linalg.norm(off, axis=1, keepdims=True)
    reading = read_axes(force, directions, truth)
    noise = NOISE["f"] * rng.standard_normal(reading.shape)
    return Devices(reading + noise, NOISE["f"], truth)


def gyros(directions: Array, n: int, rng: np.random.Generator) -> Devices:
    """Return means of n devices on a plain rate table with three settings."""
    truth = draw_truth("w", len(directions), n, rng)
    rate, _ = motion_in_case(RATES, PLAIN, n, rng)
    reading = read_axes(rate, directions, truth)
    noise = NOISE["w"] * rng.standard_normal(reading.shape)
    return Devices(reading + noise, NOISE["w"], truth)
