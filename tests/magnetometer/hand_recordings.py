"""Recordings of a nine-axis unit that is turned by hand, from NumPy alone.

Body to navigation is R (x magnetic north, y west, z up). At rest f = Rᵀ (0, 0, g), and the field is
h = Rᵀ B (cos δ, 0, −sin δ). Readings of the magnetometers are D h + o along the axes of the body,
then in the order and with the signs of `axes`, and each value is repeated.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

GRAVITY = 9.81
RATE = 100.0


@dataclass(frozen=True, eq=False)
class Made:
    """A recording: times, readings (n, 3) in m/s², rad/s and µT, and what is true."""

    time: np.ndarray
    force: np.ndarray
    rate: np.ndarray
    field: np.ndarray
    true_field: np.ndarray  # (n, 3) µT, what the magnetometers read without noise
    rest: np.ndarray  # (n,) number of the rest, −1 in motion

    def write(self, path: Path, *, force: bool = True, **columns: np.ndarray) -> Path:
        """Write a CSV with columns t, ax … gz, mx … mz, and further ones."""
        parts = {"t": self.time}
        for letter, data in (("a", self.force), ("g", self.rate), ("m", self.field)):
            parts |= {letter + axis: data[:, k] for k, axis in enumerate("xyz")}
        parts |= columns
        rows = zip(
            *(np.char.mod("%.9g", one) if one.dtype.kind == "f" else one for one in parts.values()),
            strict=True,
        )
        path.write_text("\n".join([",".join(parts), *map(",".join, rows)]) + "\n")
        return path


def exp(vector: np.ndarray) -> np.ndarray:
    """Return the rotation matrix of a rotation vector (Rodrigues)."""
    angle = np.linalg.norm(vector)
    if angle == 0:
        return np.eye(3)
    x, y, z = vector / angle
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * (k @ k)


def faces(azimuths: int) -> list[np.ndarray]:
    """Return attitudes with x, −x, y, … up, each at several azimuths."""
    found: list[np.ndarray] = []
    for k in range(3):
        for sign in (1.0, -1.0):
            up = sign * np.eye(3)[k]
            first = np.roll(np.eye(3)[k], 1)
            body = np.array([first, np.cross(up, first), up])  # rows: x, y, z of navigation
            found += [exp(np.array([0, 0, 0.3 + k + np.pi * j])) @ body for j in range(azimuths)]
    return found


def scattered(count: int, rng: np.random.Generator) -> list[np.ndarray]:
    """Return random attitudes all over the sphere."""
    found: list[np.ndarray] = []
    for _ in range(count):
        q, r = np.linalg.qr(rng.normal(size=(3, 3)))
        q = q * np.sign(np.diag(r))
        found.append(q if np.linalg.det(q) > 0 else -q)
    return found


def recording(
    attitudes: list[np.ndarray],
    rng: np.random.Generator,
    *,
    repeats: int = 5,
    noise: float = 0.5,
    strength: float = 50.0,
    dip: float = np.radians(65),
    axes: np.ndarray | None = None,
    d: np.ndarray | None = None,
    offset: tuple[float, float, float] = (12.0, -8.0, 20.0),
    rest_s: float = 3.0,
    move_s: float = 1.5,
) -> Made:
    """Return a recording of rests and of smooth turns between them."""
    matrix = np.eye(3) + 0.03 * np.array([[1, 1, -1], [-1, -1, 1], [1, -1, 2]]) if d is None else d
    order = np.eye(3) if axes is None else axes
    north = strength * np.array([np.cos(dip), 0, -np.sin(dip)])
    n_rest, n_move = round(rest_s * RATE), round(move_s * RATE)
    s = (np.arange(n_move) + 0.5) / n_move
    part = 10 * s**3 - 15 * s**4 + 6 * s**5
    speed = 30 * s**2 * (1 - s) ** 2 / move_s
    rotations: list[np.ndarray] = []
    rates: list[np.ndarray] = []
    marks: list[int] = []
    for k, here in enumerate(attitudes):
        rotations += [here] * n_rest
        rates += [np.zeros(3)] * n_rest
        marks += [k] * n_rest
        if k + 1 < len(attitudes):
            relative = here.T @ attitudes[k + 1]
            angle = np.arccos(np.clip((np.trace(relative) - 1) / 2, -1, 1))
            odd = relative - relative.T
            axis = np.array([odd[2, 1], odd[0, 2], odd[1, 0]])
            if np.linalg.norm(axis) < 1e-6:  # half a turn
                axis = np.linalg.eigh(relative + relative.T)[1][:, -1]
            vector = angle * axis / np.linalg.norm(axis)
            rotations += [here @ exp(p * vector) for p in part]
            rates += [v * vector for v in speed]
            marks += [-1] * n_move
    body = np.array(rotations)
    n = len(body)
    push = np.array(marks)[:, None] < 0
    force = body.swapaxes(1, 2) @ np.array([0, 0, GRAVITY])
    force = force + np.where(push, rng.normal(size=(n, 3)), 0.0)  # the hand accelerates
    true = (body.swapaxes(1, 2) @ north @ matrix.T + np.array(offset)) @ order.T
    noisy = true + rng.normal(0, noise, (n, 3))
    held = noisy[np.arange(n) // repeats * repeats]
    return Made(
        np.arange(n) / RATE,
        force + rng.normal(0, 0.01, (n, 3)),
        np.array(rates) + rng.normal(0, 0.001, (n, 3)),
        held,
        true,
        np.array(marks),
    )
