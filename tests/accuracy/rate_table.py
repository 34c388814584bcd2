"""A triad on a rate table from the physics alone: nothing of inercal is imported.

Readings in g, angles in rad, a device y = H f + b. In the frame of the table (c toward the centre,
t along the motion, u up; t = u × c) the sensor feels (A, 0, 1). A mounting is the matrix whose
columns are c, t, u as the body sees them: a tilt α about t, then whatever the second tilt means.

Pose and seat err anew at each mounting, the rate at each set speed, the noise at each state. The
table's axis leans, one way in the room all through; at rest the table stands at any azimuth, anew
each time, and feels that; while it turns whole turns do not. Fresh
poses are any attitude, at any speed up to the fastest: there corrected readings are judged.
"""

from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
DEGREE = pi / 180
RPM = pi / 30
G = 9.80665
RADIUS = 0.25  # m
FAST = 86 * RPM
# Axis toward the centre and axis up of each plane.
PLANES = {"XY": (0, 2), "YX": (1, 2), "ZY": (2, 0)}
State = tuple[str, float, float | None, float]  # plane, tilt and second tilt in °, r/min

PLANAR: tuple[State, ...] = tuple((p, 0.0, None, w) for p in PLANES for w in (0.0, 46.0, 86.0))
TILTED: tuple[State, ...] = (
    *((p, t, None, 86.0) for p in PLANES for t in (30.0, 60.0, 135.0)),
    ("XY", 135.0, 45.0, 86.0),
    *((p, t, None, 46.0) for p in PLANES for t in (30.0, 135.0)),
)


@dataclass(frozen=True)
class Bench:
    """Standard deviations: rad, m, relative, g."""

    pose: float = 0.2 * DEGREE
    seat: float = 0.5e-3
    speed: float = 0.05e-2
    noise: float = 0.3e-3
    radius: float = 0.0  # m, of the run
    rate: float = 0.0  # relative, of the run
    gravity: float = 0.0  # relative
    lean: float = 0.0  # rad, each of two components in the room
    one_azimuth: bool = False  # whether the table stops at one azimuth each time
    scale: float = 0.02
    cross: float = 0.012
    bias: float = 0.04


@dataclass(frozen=True, eq=False)
class Draw:
    """Devices H (trials, 3, 3) and b (trials, 3); readings and specific force, (trials, r, 3)."""

    matrix: Array
    bias: Array
    readings: Array
    felt: Array


def rotation_about(axis: int, angle: float) -> Array:
    """Return the rotation by an angle about one axis."""
    c, s = np.cos(angle), np.sin(angle)
    j, k = (axis + 1) % 3, (axis + 2) % 3
    made = np.eye(3)
    made[j, j] = made[k, k] = c
    made[j, k], made[k, j] = -s, s
    return made


def rotation_from_vector(v: Array) -> Array:
    """Return exp of rotation vectors (..., 3) by their quaternions."""
    half = np.linalg.norm(v, axis=-1, keepdims=True) / 2
    w, xyz = np.cos(half), v * np.sinc(half / pi) / 2
    return by_quaternion(np.concatenate([w, xyz], axis=-1))


def by_quaternion(q: Array) -> Array:
    """Return the rotations of quaternions (..., 4), of any length."""
    w, x, y, z = np.moveaxis(q / np.linalg.norm(q, axis=-1, keepdims=True), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def columns(plane: str, tilt: float, second: float | None, reading: str) -> Array:
    """Return c, t, u in the body as columns; angles in °."""
    toward, up = PLANES[plane]
    c, u = np.eye(3)[toward], np.eye(3)[up]
    plain = np.stack([c, np.cross(u, c), u], axis=1)
    leaned = plain @ rotation_about(1, tilt * DEGREE)
    if reading == "azimuth" and second is not None:
        return plain @ rotation_about(2, second * DEGREE) @ rotation_about(1, tilt * DEGREE)
    if second is None or reading == "dihedral":
        return leaned  # 135° and 45° as dihedral angles: cos² + cos² = 1, and nothing is left
    return leaned @ rotation_about(0, -second * DEGREE)


def nominal_force(states: tuple[State, ...], reading: str = "azimuth") -> Array:
    """Return the specific force without any error, (r, 3)."""
    rows = [columns(p, t, s, reading) @ [centripetal(w), 0, 1] for p, t, s, w in states]
    return np.array(rows)


def centripetal(rpm: float) -> float:
    """Return A in g."""
    return (rpm * RPM) ** 2 * RADIUS / G


def draw(
    seed: int,
    trials: int,
    bench: Bench = Bench(),
    states: tuple[State, ...] = PLANAR + TILTED,
    reading: str = "azimuth",
) -> Draw:
    """Return devices and their readings; equal seeds give equal draws."""
    rng = np.random.default_rng([seed, 201410])
    scale = bench.scale * rng.standard_normal((trials, 3))
    matrix = bench.cross * rng.standard_normal((trials, 3, 3))
    diagonal = np.arange(3)
    matrix[:, diagonal, diagonal] = 1 + scale
    bias = bench.bias * rng.standard_normal((trials, 3))
    speeds = {w: bench.speed * rng.standard_normal(trials) for w in sorted({s[3] for s in states})}
    mounted = dict.fromkeys(s[:3] for s in states)
    poses = {
        m: rotation_from_vector(bench.pose * rng.standard_normal((trials, 3))) for m in mounted
    }
    seats = {m: bench.seat * rng.standard_normal(trials) for m in mounted}
    noise = bench.noise * rng.standard_normal((trials, len(states), 3))
    radius = RADIUS + bench.radius * rng.standard_normal(trials)
    rate = bench.rate * rng.standard_normal(trials)
    gravity = 1 + bench.gravity * rng.standard_normal(trials)
    lean = bench.lean * rng.standard_normal((trials, 2))
    azimuth = rng.uniform(0, 2 * pi, (trials, len(states)))
    if bench.one_azimuth:
        azimuth[:] = azimuth[:, :1]
    felt = np.empty_like(noise)
    for k, (plane, tilt, second, w) in enumerate(states):
        m = (plane, tilt, second)
        a = (radius + seats[m]) * (w * RPM * (1 + rate + speeds[w])) ** 2 / G
        # c, t, u are 0, 90° and up of the table; standing at α it has the room turned by −α.
        up = np.stack([np.zeros(trials), np.zeros(trials), np.ones(trials)], axis=-1)
        if w == 0:
            c, s = np.cos(azimuth[:, k]), np.sin(azimuth[:, k])
            up[:, 0], up[:, 1] = lean[:, 0] * c + lean[:, 1] * s, lean[:, 1] * c - lean[:, 0] * s
            up /= np.linalg.norm(up, axis=-1, keepdims=True)
        table = gravity[:, None] * up
        table[:, 0] += a
        felt[:, k] = np.einsum(
            "tij,jk,tk->ti", poses[m], columns(plane, tilt, second, reading), table
        )
    readings = felt @ np.swapaxes(matrix, 1, 2) + bias[:, None] + noise
    return Draw(matrix, bias, readings, felt)


def random_pose_forces(seed: int, count: int = 300) -> Array:
    """Return the specific force in any attitude at speeds up to 86 r/min, (count, 3) g."""
    rng = np.random.default_rng([seed, 300])
    q = rng.standard_normal((count, 4))
    a = centripetal(1.0) * rng.uniform(0, 86, count) ** 2
    table = np.stack([a, np.zeros(count), np.ones(count)], axis=-1)
    return (by_quaternion(q) @ table[..., None])[..., 0]


def vector_rms(matrix: Array, offset: Array, made: Draw, poses: Array) -> Array:
    """Return the rms length of M a + p − f over fresh poses, (trials,) g; a without noise."""
    a = poses @ np.swapaxes(made.matrix, 1, 2) + made.bias[:, None]
    off = a @ np.swapaxes(matrix, -1, -2) + offset[..., None, :] - poses
    return np.sqrt((off**2).sum(-1).mean(-1))


def norm_rms(matrix: Array, offset: Array, readings: Array, states: tuple[State, ...]) -> Array:
    """Return the rms of |M a + p| − √(A² + 1) over states, (trials,) g."""
    norm = np.linalg.norm(readings @ np.swapaxes(matrix, -1, -2) + offset[..., None, :], axis=-1)
    made = np.array([np.hypot(centripetal(s[3]), 1) for s in states])
    return np.sqrt(((norm - made) ** 2).mean(-1))
