"""Sensors with one to six axes, made with plain numpy: nothing of inercal is imported.

Accelerometers are set down on six faces, each with its tilt; gyros are turned on a rate table; both
are set down and turned by hand; gyros are at rest while their temperature changes, or only drift.
All axes of a device sense the same motion and have the same thermometer.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from tests.accuracy import ramps
from tests.accuracy.ferraris import DEGREE, Handling, Imu, record
from tests.methods.platform_devices import EARTH, PLAIN, Row, motion_in_case, plan
from tests.noise.generator import MEMS, Truth
from tests.noise.generator import draw as draw_noise

Array = NDArray[np.float64]
G = 9.81
GRAVITY_SD, TILT = 2e-4, np.radians(0.05)
NOISE = {"f": 3e-4, "w": np.radians(5 / 3600)}
SPREAD = {"bias": {"f": 0.05, "w": np.radians(100 / 3600)}, "scale": 2e-3, "delta": 2e-3}
_T = 1 / np.sqrt(3)
DIRECTIONS: dict[str, list[tuple[float, float, float]]] = {
    "one": [(0, 0, 1)],
    "one, inclined": [(0.6, 0.0, 0.8)],
    "two": [(1, 0, 0), (0, 0, 1)],
    "two, not at right angles": [(1, 0, 0), (0.6, 0.8, 0)],
    "three": [(1, 0, 0), (0, 1, 0), (0, 0, 1)],
    "four": [(_T, _T, _T), (_T, -_T, -_T), (-_T, _T, -_T), (-_T, -_T, _T)],
    "five": [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.6, 0, 0.8), (0, 0.6, 0.8)],
    "six": [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.6, 0, 0.8), (0, 0.6, 0.8), (-0.6, 0.8, 0)],
}
HANDS = Handling(
    gravity=G,
    gravity_sd=GRAVITY_SD,
    latitude=47 * DEGREE,
    tilt=TILT,
    turn_tilt=0.3 * DEGREE,
    turn_angle=0.5 * DEGREE,
    timebase=1e-4,
)
SECONDS, RATE_HZ = 8.0, 25.0  # of each section by hand
WHITE = {"f": 1e-4 * G, "w": 0.005 * DEGREE}  # sd of a mean over one second
BY_FORCE = 0.02 * DEGREE / G
PROFILE = "up and down, 2 × 30 min"
NOISE_TRUTH = Truth(16384, MEMS.dt, MEMS.white, MEMS.flicker, 10 * MEMS.walk)
FACES = {"x_p": (1, 0, 0), "x_a": (-1, 0, 0), "y_p": (0, 1, 0), "y_a": (0, -1, 0),
         "z_p": (0, 0, 1), "z_a": (0, 0, -1)}  # fmt: skip
RATES: list[Row] = plan([0, 50, -50, 100, -100, 0])


@dataclass
class Devices:
    """Readings (n, r, m) with their deviation, and true coefficients (n, m) by name.

    The deviation (m,) is that of each axis.
    """

    reading: Array
    sd: Array
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


def _along(sensed: Array, directions: Array) -> Array:
    """Return the components of motions (n, r, 3) along I, P and O of each axis, (3, n, r, m)."""
    return np.moveaxis(np.einsum("nrk,mjk->nrmj", sensed, frames(directions)), -1, 0)


def read_axes(sensed: Array, directions: Array, truth: dict[str, Array]) -> Array:
    """Return readings (n, r, m) of motions (n, r, 3)."""
    i, p, o = _along(sensed, directions)
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
    return Devices(reading + noise, np.full(len(directions), NOISE["f"]), truth)


def gyros(directions: Array, n: int, rng: np.random.Generator) -> Devices:
    """Return means of n devices on a plain rate table with three settings."""
    truth = draw_truth("w", len(directions), n, rng)
    rate, _ = motion_in_case(RATES, PLAIN, n, rng)
    reading = read_axes(rate, directions, truth)
    noise = NOISE["w"] * rng.standard_normal(reading.shape)
    return Devices(reading + noise, np.full(len(directions), NOISE["w"]), truth)


def by_hand(directions: Array, n: int, rng: np.random.Generator) -> Devices:
    """Return means of n devices on six faces and in three turns; accelerometers, then gyros."""
    m = len(directions)
    ideal = Imu(np.eye(3), np.zeros(3), np.eye(3), np.zeros(3), np.zeros((3, 3)))
    made = record(
        ideal, HANDS, rng, trials=n, rate_hz=RATE_HZ, hold_seconds=SECONDS, turn_seconds=SECONDS
    )
    motion = np.stack([made.data[:, a:b].mean(axis=1) for a, b in made.marks.values()], axis=1)
    force, rate = motion[..., :3], motion[..., 3:]
    accelerometer, gyro = (draw_truth(kind, m, n, rng) for kind in "fw")
    by_force = BY_FORCE * rng.standard_normal((3, n, m))
    reading = np.concatenate(
        [
            read_axes(force, directions, accelerometer),
            read_axes(rate, directions, gyro)
            + np.einsum("knm,knrm->nrm", by_force, _along(force, directions)),
        ],
        axis=-1,
    )
    sd = np.repeat([WHITE["f"], WHITE["w"]], m) / SECONDS**0.5
    truth = {name: np.concatenate([accelerometer[name], gyro[name]], axis=1) for name in gyro}
    nothing = np.zeros((n, m))
    for name, value in zip(("g_i", "g_p", "g_o"), by_force, strict=True):
        truth[name] = np.concatenate([nothing, value], axis=1)
    return Devices(reading + sd * rng.standard_normal(reading.shape), sd, truth)


@dataclass
class Warmed:
    """A recording at rest along a ramp: time and temperature (n,), readings (n, m) of gyros.

    The truth by name has the shape (1, m).
    """

    time: Array
    kelvin: Array
    reading: Array
    truth: dict[str, Array]


def warmed(directions: Array, rng: np.random.Generator) -> Warmed:
    """Return one device whose axes have cubic biases of their own; it senses the earth's rate."""
    element = ramps.PROFILES[PROFILE]()
    made = [ramps.record(rng, element) for _ in directions]
    warmth = element + ramps.ZERO - ramps.REFERENCE
    names = ("bias_dT", "bias_dT2", "bias_dT3")
    more = np.array(ramps.BIAS[1:])[:, None] * rng.standard_normal((len(names), len(directions)))
    north = rng.standard_normal(3)
    earth = directions @ north * (EARTH / np.linalg.norm(north))
    reading = np.stack([one.reading for one in made], axis=-1) + earth
    for power, value in enumerate(more, start=1):
        reading += value * warmth[:, None] ** power
    truth = {
        name: (value + ramps.BIAS[power])[None]
        for power, (name, value) in enumerate(zip(names, more, strict=True), start=1)
    }
    return Warmed(made[0].time, made[0].recorded, reading, truth)


def drifting(directions: Array, seed: int) -> Array:
    """Return readings (n, m) of gyros at rest with the noise `NOISE_TRUTH`, rad/s."""
    return draw_noise(NOISE_TRUTH, seed, len(directions)).T + EARTH * directions[:, 2]
