"""Ferraris recordings of a MEMS IMU made from the physics alone, to hold inercal against.

Nothing of inercal is imported, and the route is another one: where inercal writes down what is
felt, here only attitudes and positions are written down, as functions of time, and what is felt is
got from them by finite differences::

    C_ib(t) = exp(Ω_n t) C_nb(t)                  body to inertial; n is east, north, up at t = 0
    ω       = log(C_ib(t)ᵀ C_ib(t + dt)) / dt     mean over a sample: the earth is in it by itself
    f       = C_nbᵀ (r̈ + g ẑ)                     r̈ by second differences of r(t) = C_nb(t) · arm
    reading = M_a f + b_a  and  M_g ω + G f + b_g  plus noise

A position is a face set down: its direction in the body is off by `tilt`, its azimuth is anything.
A turn is about an axis fixed in the body (off by `turn_tilt`) and in space (off by `table`), with
the hand's uneven speed, by the angle meant plus an error. All errors are drawn anew in each trial.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import cos, pi, sin
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
G0 = 9.80665  # m/s², exact (CGPM 1901)
EARTH = 7.292115e-5  # rad/s, WGS 84
DEGREE = pi / 180
POSITIONS = {
    a + side: sign * np.eye(3)[k]
    for k, a in enumerate("xyz")
    for side, sign in (("_p", 1), ("_a", -1))
}
TURNS = {a + "_rot": np.eye(3)[k] for k, a in enumerate("xyz")}
CHANNELS = ("ax", "ay", "az", "gx", "gy", "gz")


def _zeros() -> Array:
    return np.zeros(3)


@dataclass(frozen=True, eq=False)
class Imu:
    """The sensor: matrices in SI, noise as the sd of a mean over one second (SI · √s).

    `colour_*` is the sd of an AR(1) process of correlation time `colour_seconds`; `drift_*` a
    change per second; `arm` the accelerometers' place from the turning axis, m.
    """

    M_a: Array
    b_a: Array
    M_g: Array
    b_g: Array
    G: Array
    white_a: float = 0.0
    white_g: float = 0.0
    colour_a: float = 0.0
    colour_g: float = 0.0
    colour_seconds: float = 1.0
    drift_a: Array = field(default_factory=_zeros)
    drift_g: Array = field(default_factory=_zeros)
    arm: Array = field(default_factory=_zeros)

    def coefficients(self) -> dict[str, float]:
        """Return the matrices by the names of IEEE Std 1293: P and O follow I cyclically."""
        named: dict[str, float] = {}
        for i, axis in enumerate("xyz"):
            p, o = (i + 1) % 3, (i + 2) % 3
            named |= {
                f"a{axis}.k0": self.b_a[i],
                f"a{axis}.k1": self.M_a[i, i] - 1,
                f"a{axis}.delta_o": self.M_a[i, p],
                f"a{axis}.delta_p": -self.M_a[i, o],
                f"g{axis}.bias": self.b_g[i],
                f"g{axis}.scale": self.M_g[i, i] - 1,
                f"g{axis}.delta_o": self.M_g[i, p],
                f"g{axis}.delta_p": -self.M_g[i, o],
                f"g{axis}.g_i": self.G[i, i],
                f"g{axis}.g_p": self.G[i, p],
                f"g{axis}.g_o": self.G[i, o],
            }
        return {name: float(value) for name, value in named.items()}


def mems(rng: np.random.Generator, **changes: object) -> Imu:
    """Return a consumer MEMS IMU with errors drawn at their usual sizes, and its usual noise."""
    imu: dict[str, object] = {
        "M_a": np.eye(3) + 0.01 * rng.standard_normal((3, 3)),
        "b_a": 0.03 * G0 * rng.standard_normal(3),
        "M_g": np.eye(3) + 0.01 * rng.standard_normal((3, 3)),
        "b_g": 0.5 * DEGREE * rng.standard_normal(3),
        "G": 0.02 * DEGREE / G0 * rng.standard_normal((3, 3)),
        "white_a": 100e-6 * G0,
        "white_g": 0.005 * DEGREE,
    }
    return Imu(**(imu | changes))  # type: ignore[arg-type]


@dataclass(frozen=True)
class Handling:
    """What the hands and the place do: standard deviations in SI, `latitude` None is no earth."""

    gravity: float = 9.81
    gravity_sd: float = 0.0
    latitude: float | None = None
    tilt: float = 0.0
    turn_tilt: float = 0.0
    turn_angle: float = 0.0
    table: float = 0.0
    timebase: float = 0.0


@dataclass(frozen=True, eq=False)
class FerrarisSession:
    """Stamps (n,) s, data (trials, n, 6) SI, marks by label (half open), and true gravity."""

    time: Array
    data: Array
    marks: Mapping[str, tuple[int, int]]
    gravity: Array

    def labels(self) -> NDArray[np.str_]:
        """Return the label of each sample, (n,)."""
        labels = np.full(self.time.size, "", dtype="U8")
        for label, (start, stop) in self.marks.items():
            labels[start:stop] = label
        return labels

    def write_csv(self, path: Path, columns: str = "acc_x,acc_y,acc_z,gyr_x,gyr_y,gyr_z") -> None:
        """Write the first trial: time and the six channels in SI."""
        table = np.column_stack([self.time, self.data[0]])
        np.savetxt(path, table, fmt="%.9g", delimiter=",", header="time," + columns, comments="")


def record(
    imu: Imu,
    hands: Handling,
    rng: np.random.Generator,
    *,
    trials: int = 1,
    rate_hz: float = 100.0,
    hold_seconds: float = 10.0,
    turn_seconds: float = 8.0,
    angle: float = 2 * pi,
    faces: Mapping[str, Array] = POSITIONS,
    turns: Mapping[str, Array] = TURNS,
    moves: bool = False,
) -> FerrarisSession:
    """Return a session: every position, then every turn.

    `faces` and `turns` are directions in the body by label. With `moves` the sensor is carried
    from one section to the next in two seconds, a second after the one and a second before the
    other; without, sections follow one another at once, as nothing between them is looked at.
    """
    true_dt = (1 + hands.timebase * rng.standard_normal(trials)) / rate_hz
    g = hands.gravity + hands.gravity_sd * rng.standard_normal(trials)
    parts: list[Array] = []
    marks: dict[str, tuple[int, int]] = {}
    attitude: Array | None = None
    count, pause = 0, round(rate_hz)
    for label, direction in {**faces, **turns}.items():
        turning = label in turns
        wide = hands.turn_tilt if turning else hands.tilt
        in_body = _off(np.asarray(direction, dtype=float), wide, rng, trials)
        vertical = _off(np.array([0.0, 0.0, 1.0]), hands.table * turning, rng, trials)
        start = _stand(in_body, vertical, rng.uniform(0, 2 * pi, trials))
        if moves and attitude is not None:
            for at, n in ((attitude, pause), (None, 2 * pause), (start, pause)):
                path, place = _carry(attitude, start, n, rng) if at is None else _rest(at, imu, n)
                parts.append(_felt(path, place, true_dt, hands, g))
                count += n
        n = round((turn_seconds if turning else hold_seconds) * rate_hz)
        if turning:
            meant = angle + hands.turn_angle * rng.standard_normal(trials)
            path = _exp(vertical[:, None] * (meant[:, None] * _hand(n, rng))[..., None])
            path = path @ start[:, None]
            attitude = path[:, -1]
            felt = _felt(path, path @ imu.arm, true_dt, hands, g)
        else:
            attitude = start
            one = _felt(*_rest(start, imu, 1), true_dt, hands, g)  # it stands for all
            felt = np.repeat(one, n, axis=1)
        parts.append(felt)
        marks[label] = (count, count + n)
        count += n
    felt = np.concatenate(parts, axis=1)
    both = np.block([[imu.M_a, np.zeros((3, 3))], [imu.G, imu.M_g]])
    data = felt @ both.T + np.concatenate([imu.b_a, imu.b_g])
    time = np.arange(count) / rate_hz
    return FerrarisSession(time, data + _noise(imu, data.shape, rate_hz, rng), marks, g)


def _noise(imu: Imu, shape: tuple[int, ...], rate_hz: float, rng: np.random.Generator) -> Array:
    size = np.repeat([imu.white_a, imu.white_g], 3) * rate_hz**0.5
    noise = rng.standard_normal(shape)
    noise *= size
    seconds = np.arange(shape[1])[:, None] / rate_hz
    noise += seconds * np.concatenate([imu.drift_a, imu.drift_g])
    colour = np.repeat([imu.colour_a, imu.colour_g], 3)
    if colour.any():
        keep = np.exp(-1 / (imu.colour_seconds * rate_hz))
        state = rng.standard_normal((shape[0], 6))
        for k in range(shape[1]):
            noise[:, k] += colour * state
            state = keep * state + (1 - keep**2) ** 0.5 * rng.standard_normal(state.shape)
    return noise


def _felt(path: Array, place: Array, dt: Array, hands: Handling, g: Array) -> Array:
    """Return (f, ω), (trials, n, 6), from attitudes and places at every half sample (2n + 1)."""
    dt = dt[:, None, None]
    pull = np.zeros((*path.shape[:1], 1, 3))
    pull[..., 2] = g[:, None]
    bent = (place[:, 2::2] - 2 * place[:, 1::2] + place[:, :-1:2]) / (dt / 2) ** 2
    f = _turned_back(path[:, 1::2], bent + pull)
    if hands.latitude is not None:
        earth = EARTH * np.array([0.0, cos(hands.latitude), sin(hands.latitude)])
        halves = np.arange(path.shape[1]) / 2
        path = _exp(earth * (halves * dt[:, :, 0])[..., None]) @ path
    step = np.swapaxes(path[:, :-1:2], -1, -2) @ path[:, 2::2]
    return np.concatenate([f, _small_log(step) / dt], axis=-1)


def _turned_back(path: Array, v: Array) -> Array:
    return np.einsum("...ji,...j->...i", path, np.broadcast_to(v, (*path.shape[:-2], 3)))


def _hand(n: int, rng: np.random.Generator) -> Array:
    """Return how much of a turn is done at every half sample: rest, uneven motion, rest."""
    t = np.linspace(0, 1, 2 * n + 1)
    s = np.clip((t - 0.03) / 0.94, 0, 1)
    smooth = s**3 * (10 - 15 * s + 6 * s**2)
    waves = rng.uniform(-1, 1, 3) @ np.sin(2 * pi * np.outer([2, 3, 4], s))
    return smooth + 0.3 * s**3 * (1 - s) ** 3 * waves


def _rest(attitude: Array, imu: Imu, n: int) -> tuple[Array, Array]:
    """Return attitudes and places of the accelerometers at every half sample, at rest."""
    path = np.repeat(attitude[:, None], 2 * n + 1, axis=1)
    return path, path @ imu.arm


def _carry(start: Array, end: Array, n: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return attitudes and places while a hand lifts, turns and sets down the sensor."""
    turn = np.swapaxes(start, -1, -2) @ end
    # The axis is what the rotation leaves alone: the null vector of turn − 1, also at 180°.
    axis = np.linalg.svd(turn - np.eye(3))[2][:, -1]
    odd, trace = _odd(turn), np.trace(turn, axis1=-2, axis2=-1)
    angle = np.arctan2((axis * odd).sum(-1), (trace - 1) / 2)
    s = np.linspace(0, 1, 2 * n + 1)
    done = s**3 * (10 - 15 * s + 6 * s**2)
    path = start[:, None] @ _exp(axis[:, None] * (angle[:, None] * done)[..., None])
    reach = rng.uniform(-0.1, 0.1, (len(start), 1, 3)) + np.array([0.0, 0.0, 0.15])
    return path, reach * (64 * s**3 * (1 - s) ** 3)[:, None]


def _off(direction: Array, sd: float, rng: np.random.Generator, trials: int) -> Array:
    """Return the unit vector `direction` turned by `sd` in each of two directions, (trials, 3)."""
    turn = sd * rng.standard_normal((trials, 3))
    turn -= (turn @ direction)[:, None] * direction
    return _exp(turn) @ direction


def _stand(in_body: Array, in_space: Array, azimuth: Array) -> Array:
    """Return C_nb, (trials, 3, 3), which takes `in_body` to `in_space`, turned about that."""

    def triple(v: Array) -> Array:
        first = np.cross(v, np.eye(3)[np.argmin(np.abs(v[0]))])
        first /= np.linalg.norm(first, axis=-1, keepdims=True)
        return np.asarray(np.stack([first, np.cross(v, first), v], axis=-1), dtype=float)

    about = _exp(np.array([0.0, 0.0, 1.0]) * azimuth[:, None])
    return np.einsum("...ij,...jk,...lk->...il", triple(in_space), about, triple(in_body))


def _exp(v: Array) -> Array:
    """Return the rotation by a rotation vector, by the unit quaternion's products."""
    half = np.linalg.norm(v, axis=-1, keepdims=True) / 2
    w = np.cos(half)[..., 0]
    x, y, z = np.moveaxis(v / 2 * np.sinc(half / pi), -1, 0)
    mat = np.empty((*v.shape, 3))
    mat[..., 0, 0] = 1 - 2 * (y * y + z * z)
    mat[..., 1, 1] = 1 - 2 * (x * x + z * z)
    mat[..., 2, 2] = 1 - 2 * (x * x + y * y)
    mat[..., 0, 1], mat[..., 1, 0] = 2 * (x * y - w * z), 2 * (x * y + w * z)
    mat[..., 0, 2], mat[..., 2, 0] = 2 * (x * z + w * y), 2 * (x * z - w * y)
    mat[..., 1, 2], mat[..., 2, 1] = 2 * (y * z - w * x), 2 * (y * z + w * x)
    return mat


def _odd(turn: Array) -> Array:
    """Return axis · sin(angle) of rotations."""
    pairs = ((2, 1), (0, 2), (1, 0))
    return np.stack([(turn[..., i, j] - turn[..., j, i]) / 2 for i, j in pairs], axis=-1)


def _small_log(turn: Array) -> Array:
    """Return the rotation vectors of rotations far below 90°."""
    odd = _odd(turn)
    sine = np.linalg.norm(odd, axis=-1, keepdims=True)
    safe = np.where(sine > 0, sine, 1.0)
    return odd * np.where(sine > 0, np.arcsin(np.minimum(sine, 1.0)) / safe, 1.0)
