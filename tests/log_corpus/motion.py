"""An imaginary IMU that somebody moves by hand from rest to rest, or sets down on its six faces.

The attitude C takes the body to a level frame. Between two rests it turns about an axis in the body
and wobbles about another::

    C = C₀ R(a φ(t)) R(b ψ(t)),   ω = R(b ψ)ᵀ a φ′ + b ψ′ + Cᵀ Ω,   f = g Cᵀ e_z + Cᵀ p″

so that gyros without errors integrate to the next attitude. p is the path of the hand, Ω the rate
of the earth. Readings are y = M f + b + noise, filtered, and then rounded by the form of the log.
Nothing of inercal is imported.
"""

from dataclasses import dataclass, field

import numpy as np

Array = np.ndarray
G0 = 9.80665
GRAVITY, GRAVITY_SD = 9.80, 0.02  # m/s², what a draft assumes without a place
CLOCK = 1e-4  # standard deviation of the clock's rate, as a draft assumes
FACE_TILT = np.radians(0.5)  # standard deviation about each of two directions, as a draft assumes
EARTH = 7.292115e-5  # rad/s
FACES = {"x_p": (0, 1), "y_p": (1, 1), "z_p": (2, 1), "x_a": (0, -1), "y_a": (1, -1)} | {
    "z_a": (2, -1)
}
"""Axis and sense that is up, in an order with a quarter turn from each face to the next."""


@dataclass(frozen=True)
class Motion:
    """How the sensor is moved and read, and how well."""

    hz: float = 100.0
    rests: int = 18
    still: float = 2.0  # s
    moving: float = 1.2  # s
    wobble: float = 0.1  # rad, about another axis during a turn
    faces: bool = False
    accelerometer_noise: float = 0.015  # m/s², of a sample
    gyro_noise: float = np.radians(0.06)  # rad/s
    skew: float = 0.004  # rad
    filter_hz: float = 0.0  # first-order low-pass; 0 without one
    jitter: float = 0.0  # of the stamps, in steps
    celsius: float = 24.0


@dataclass(frozen=True, eq=False)
class Log:
    """Readings in m/s² and rad/s, stamps in s, and what made them."""

    time: Array
    force: Array
    rate: Array
    celsius: Array
    attitude: Array  # (n, 3, 3)
    section: Array  # number of the rest, −1 in motion
    labels: tuple[str, ...]  # names of the rests
    truth: dict[str, float] = field(default_factory=dict[str, float])  # in SI


def turns(vectors: Array) -> Array:
    """Return the matrices, (n, 3, 3), of rotations by vectors, (n, 3), in rad."""
    angle = np.linalg.norm(vectors, axis=-1)[:, None, None]
    x, y, z = (vectors / np.maximum(angle[:, 0], 1e-300)).T
    o = np.zeros_like(x)
    k = np.stack([o, -z, y, z, o, -x, -y, x, o], axis=-1).reshape(-1, 3, 3)
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def _vector(matrix: Array) -> Array:
    """Return the vector of a rotation by less than a half turn."""
    angle = np.arccos(np.clip((np.trace(matrix) - 1) / 2, -1, 1))
    m = matrix - matrix.T
    axis = np.array([m[2, 1], m[0, 2], m[1, 0]])
    return axis * angle / max(2 * np.sin(angle), 1e-12)


def _attitudes(rng: np.random.Generator, motion: Motion) -> tuple[list[Array], tuple[str, ...]]:
    """Return the attitude of each rest, and its name."""
    if not motion.faces:
        found = [turns(rng.normal(size=(1, 3)))[0]]
        for _ in range(motion.rests - 1):
            axis = rng.normal(size=3)
            axis *= rng.uniform(1.1, 2.3) / np.linalg.norm(axis)
            found.append(found[-1] @ turns(axis[None])[0])
        return found, tuple(f"p{k}" for k in range(motion.rests))
    found = []
    for axis, sense in FACES.values():
        up = np.eye(3)[axis] * sense
        side, other = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
        up = up + rng.normal(0, FACE_TILT, 2) @ [side, other]
        up /= np.linalg.norm(up)
        north = np.cross(up, side)
        north /= np.linalg.norm(north)
        found.append(np.stack([north, np.cross(up, north), up]))
    return found, tuple(FACES)


def coefficients(rng: np.random.Generator, skew: float = 0.004) -> tuple[Array, Array, Array]:
    """Return M − 1, (3, 3), the bias of accelerometers, m/s², and of gyros, rad/s."""
    matrix = np.diag(rng.normal(0, 0.006, 3)) + (1 - np.eye(3)) * rng.normal(0, skew, (3, 3))
    return matrix, rng.normal(0, 0.25, 3), np.radians(rng.normal(0, 0.8, 3))


def truth_of(matrix: Array, bias: Array, kind: str) -> dict[str, float]:
    """Return the coefficients of a triad: y = (1 + matrix) x + bias."""
    names = ("k0", "k1") if kind == "a" else ("bias", "scale")
    found: dict[str, float] = {}
    for k, axis in enumerate("xyz"):
        found[f"{kind}{axis}.{names[0]}"] = float(bias[k])
        found[f"{kind}{axis}.{names[1]}"] = float(matrix[k, k])
        found[f"{kind}{axis}.delta_o"] = float(matrix[k, (k + 1) % 3])
        found[f"{kind}{axis}.delta_p"] = -float(matrix[k, (k + 2) % 3])
    return found


def by_hand(seed: int, motion: Motion, gravity: float = GRAVITY) -> Log:
    """Return a recording; gravity in m/s².

    Motion and errors do not depend on the sampling rate, so that two files of one phone agree.
    """
    rng, noise = np.random.default_rng(seed), np.random.default_rng((seed, round(motion.hz)))
    n, m = int(motion.still * motion.hz), int(motion.moving * motion.hz)
    rests, labels = _attitudes(rng, motion)
    attitude, rates, push, section = [], [], [], []
    part = (np.arange(m) + 0.5) / m
    swept = part - np.sin(2 * np.pi * part) / (2 * np.pi)
    speed = 2 * np.sin(np.pi * part) ** 2 / (m / motion.hz)
    bump = np.sin(np.pi * part) ** 4
    its_speed = 4 * np.pi * np.sin(np.pi * part) ** 3 * np.cos(np.pi * part) / (m / motion.hz)
    for k, here in enumerate(rests):
        attitude.append(np.tile(here, (n, 1, 1)))
        rates.append(np.zeros((n, 3)))
        push.append(np.zeros((n, 3)))
        section.append(np.full(n, k))
        if k + 1 == len(rests):
            break
        axis, wobble = _vector(here.T @ rests[k + 1]), rng.normal(0, motion.wobble, 3)
        second = turns(bump[:, None] * wobble)
        attitude.append(here @ turns(swept[:, None] * axis) @ second)
        turned = np.einsum("nji,j->ni", second, axis) * speed[:, None]
        rates.append(turned + its_speed[:, None] * wobble)
        push.append(np.sin(4 * np.pi * part)[:, None] * rng.normal(0, 1.5, 3))
        section.append(np.full(m, -1))
    stacked, path = np.concatenate(attitude), np.concatenate(push)
    latitude, azimuth = np.radians(rng.uniform(-60, 60)), rng.uniform(0, 2 * np.pi)
    level = np.cos(latitude) * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    earth = EARTH * (level + np.array([0, 0, np.sin(latitude)]))
    force = np.einsum("nji,nj->ni", stacked, path + np.array([0, 0, gravity]))
    clock = 1 + rng.normal(0, CLOCK)  # true rates over those on the clock of the log
    rate = clock * np.concatenate(rates) + np.einsum("nji,j->ni", stacked, earth)
    matrix, bias, drift = coefficients(rng, motion.skew)
    gyro_matrix, _, _ = coefficients(rng, motion.skew)
    gyro_matrix = gyro_matrix + np.diag(rng.normal(0, 0.008, 3))
    read_f = (
        force + force @ matrix.T + bias + noise.normal(0, motion.accelerometer_noise, force.shape)
    )
    read_w = rate + rate @ gyro_matrix.T + drift + noise.normal(0, motion.gyro_noise, rate.shape)
    if motion.filter_hz:
        read_f, read_w = (_filtered(x, motion.filter_hz / motion.hz) for x in (read_f, read_w))
    count = len(force)
    time = (np.arange(count) + 0.5) / motion.hz
    time = time + noise.uniform(-motion.jitter, motion.jitter, count) / motion.hz
    celsius = motion.celsius + 0.3 * np.sin(time / 40) + noise.normal(0, 0.02, count)
    truth = truth_of(matrix, bias, "a") | truth_of(gyro_matrix, drift, "g")
    whole = np.concatenate(section)
    return Log(time, read_f, read_w, celsius, stacked, whole, labels, truth)


def _filtered(data: Array, relative: float) -> Array:
    """Return data after a first-order low-pass with a cut-off in units of the sampling rate."""
    keep = np.exp(-2 * np.pi * relative)
    out = np.empty_like(data)
    out[0] = data[0]
    for k in range(1, len(data)):
        out[k] = keep * out[k - 1] + (1 - keep) * data[k]
    return out


def means(
    seed: int, count: int, noise: float, gravity: float = GRAVITY
) -> tuple[Array, dict[str, float]]:
    """Return mean forces, m/s², of many poses, or of six faces if `count` is 0; and the truth."""
    rng = np.random.default_rng(seed)
    if count:
        up = rng.normal(size=(count, 3))
        up /= np.linalg.norm(up, axis=1, keepdims=True)
    else:
        rests, _ = _attitudes(rng, Motion(faces=True))
        up = np.array([one[2] for one in rests])
    matrix, bias, _ = coefficients(rng)
    force = gravity * up
    read = force + force @ matrix.T + bias + rng.normal(0, noise, force.shape)
    return read, truth_of(matrix, bias, "a")


def in_accelerometer_frame(truth: dict[str, float]) -> dict[str, float]:
    """Return the coefficients in the frame whose x is that of ax and whose xy plane holds ay."""
    matrices = {kind: _matrix(truth, kind) for kind in "ag" if f"{kind}x.delta_o" in truth}
    q, r = np.linalg.qr(matrices["a"].T)
    found = dict(truth)
    for kind, matrix in matrices.items():
        own = matrix @ q * np.sign(np.diag(r))
        found |= truth_of(own - np.eye(3), np.array(_biases(truth, kind)), kind)
    return found


def _biases(truth: dict[str, float], kind: str) -> list[float]:
    return [truth[f"{kind}{x}.{'k0' if kind == 'a' else 'bias'}"] for x in "xyz"]


def _matrix(truth: dict[str, float], kind: str) -> Array:
    scale = "k1" if kind == "a" else "scale"
    matrix = np.eye(3)
    for k, axis in enumerate("xyz"):
        matrix[k, k] += truth[f"{kind}{axis}.{scale}"]
        matrix[k, (k + 1) % 3] = truth[f"{kind}{axis}.delta_o"]
        matrix[k, (k + 2) % 3] = -truth[f"{kind}{axis}.delta_p"]
    return matrix
