"""Logs of imaginary devices, written by formulas that import nothing of inercal."""

from collections.abc import Sequence
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np

G = 9.80665
EARTH = 15.041067  # °/h
FACES = {"x": (1, 0, 0), "-x": (-1, 0, 0), "y": (0, 1, 0), "-y": (0, -1, 0), "z": (0, 0, 1)} | {
    "-z": (0, 0, -1)
}
BIAS = np.array([0.02, -0.03, 0.04])  # g
SCALE = np.array([0.004, -0.004, 0.01])


def _turn(angle: np.ndarray) -> np.ndarray:
    size = float(np.linalg.norm(angle))
    if size == 0:
        return np.eye(3)
    x, y, z = angle / size
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(size) * k + (1 - np.cos(size)) * k @ k


@cache
def by_hand(
    seed: int, rests: int = 16, hz: float = 100.0, still: float = 2.5
) -> dict[str, np.ndarray]:
    """Return time, force (g), rate (°/s) and number of the rest, −1 in motion, of a device."""
    rng = np.random.default_rng(seed)
    n, moving = int(still * hz), int(1.0 * hz)
    attitude, rates, forces, number = np.eye(3), [], [], []
    for k in range(rests):
        forces += [attitude.T @ [0, 0, 1]] * n
        rates += [np.zeros(3)] * n
        number += [k] * n
        axis = rng.normal(size=3)
        axis *= rng.uniform(1.0, 2.2) / np.linalg.norm(axis)
        s = np.arange(moving + 1) / moving
        swept = s - np.sin(2 * np.pi * s) / (2 * np.pi)
        for a, b in pairwise(swept):
            middle = attitude @ _turn(axis * (a + b) / 2)
            forces.append(middle.T @ [0, 0, 1])
            rates.append(axis * (b - a) * hz)
            number.append(-1)
        attitude = attitude @ _turn(axis)
    force, rate = np.array(forces), np.degrees(np.array(rates))
    force = force * (1 + SCALE) + BIAS + rng.normal(0, 5e-4, force.shape)
    force[np.array(number) < 0] += rng.normal(0, 0.02, (sum(k < 0 for k in number), 3))
    rate = rate + np.array([1.5, -0.8, 0.6]) + rng.normal(0, 0.03, rate.shape)
    return {"t": np.arange(len(force)) / hz, "f": force, "w": rate, "rest": np.array(number)}


def write(path: Path, head: Sequence[str], columns: Sequence[object], separator: str = ",") -> Path:
    """Write columns with a header, which may be empty."""
    rows = zip(*columns, strict=True)
    text = [
        separator.join(one if isinstance(one, str) else f"{one:.6g}" for one in r) for r in rows
    ]
    path.write_text("\n".join([separator.join(head), *text] if head else text) + "\n", "utf-8")
    return path


def poses(seed: int, count: int) -> np.ndarray:
    """Return means in g in many attitudes."""
    rng = np.random.default_rng(seed)
    up = rng.normal(size=(count, 3))
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    return up * (1 + SCALE) + BIAS + rng.normal(0, 2e-5, up.shape)


def on_arm(turns: np.ndarray) -> np.ndarray:
    """Return means in g on an arm of 1 m in random attitudes, at rates in rpm."""
    rng = np.random.default_rng(3)
    out = rng.normal(size=(len(turns), 3))
    out /= np.linalg.norm(out, axis=-1, keepdims=True)
    up = np.cross(out, rng.normal(size=out.shape))
    up /= np.linalg.norm(up, axis=-1, keepdims=True)
    across = (turns * np.pi / 30) ** 2
    return (up * G - out * across[:, None]) / G * (1 + SCALE) + BIAS


def six_faces(seed: int, celsius: float, hz: float = 50.0) -> tuple[np.ndarray, np.ndarray]:
    """Return force, g, and temperature, °C, of six faces after each other at one temperature."""
    rng = np.random.default_rng(seed)
    dT = celsius - 20
    up = np.concatenate([np.tile(one, (int(6 * hz), 1)) for one in FACES.values()]).astype(float)
    slope = np.array([50e-6, -30e-6, 40e-6])
    force = up * (1 + slope * dT) + BIAS + np.array([200e-6, -100e-6, 300e-6]) * dT
    noise = np.where((np.arange(len(up)) % int(6 * hz) < hz)[:, None], 0.05, 8e-4)
    return force + rng.normal(size=up.shape) * noise, np.full(len(up), celsius) + rng.normal(
        0, 0.02, len(up)
    )


def rates(seed: int, latitude: float, speeds: Sequence[float]) -> tuple[list[str], np.ndarray]:
    """Return the axis that is up, and (n, 4): the rate and three gyros, °/s, over whole turns."""
    rng = np.random.default_rng(seed)
    names, rows = [], []
    for name, up in FACES.items():
        for speed in speeds:
            true = np.array(up) * (speed + EARTH * np.sin(np.radians(latitude)) / 3600)
            read = true * (1 + np.array([0.006, -0.005, 0.011])) + [0.4, -0.25, 0.15]
            names.append(name)
            rows.append([speed, *(read + rng.normal(0, 3e-4, 3))])
    return names, np.array(rows)
