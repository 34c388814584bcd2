"""An IMU on a three-axis turntable from the physics alone: nothing of inercal is imported.

Axes Z outer, X middle, Y inner; the frame is level, east, north, up. The attitude (body to level)::

    C = T Rz(outer) N₁ Rx(middle) N₂ Ry(inner)

T is how the base leans and where it points, N₁ and N₂ by how much neighbouring axes miss a right
angle. Each axis moves one after another, or all at once, at trapezoids of rate, or at S-curves: a
trapezoid's moving average, whose acceleration is a trapezoid. The body feels

    ω = Cᵀ ω_ie + Σ (axes' rates along the axes),   f = Cᵀ (g up + r̈)

with r̈ of the lever arm; readings are (I + S) u + bias + drift + white noise. The drift is a
Gauss–Markov process, or flicker over the whole recording about its mean, so that the bias is the
mean. Readback: angle + harmonics + white noise, `latency` late.

Angles in rad, rates rad/s, forces m/s², times s.
"""

from dataclasses import dataclass
from math import factorial, pi, radians, sqrt

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ARCSEC = radians(1 / 3600)
DEG_H = radians(1) / 3600
EARTH = 7.292115e-5
G = 9.80665
Angles = tuple[float, float, float]
# What to do: to angles (degrees) and stay there, or one axis by an angle (degrees) at °/s.
Stand = tuple[str, Angles, float]
Turn = tuple[str, int, float, float]

TEN: tuple[Angles, ...] = (
    (0, 0, 0), (0, 90, 0), (0, 180, 0), (0, 270, 0), (0, 0, 90),
    (0, 0, -90), (90, 45, 0), (90, 0, 45), (180, 45, 90), (180, -45, 45),
)  # fmt: skip


def positions(seconds: float = 90.0) -> list[Stand]:
    """Return the accelerometers' part."""
    return [(f"p{k + 1}", angles, seconds) for k, angles in enumerate(TEN)]


def turns(angle: float = 720.0, rate: float = 10.0, *, back: bool = False) -> list[Stand | Turn]:
    """Return the gyros' part: about x, y and z, optionally back, then rest."""
    home: Stand = ("home", (0, 0, 0), 3.0)
    path: list[Stand | Turn] = [home]
    for name, axis in (("x", 1), ("y", 2), ("z", 0)):
        path.append((f"{name}+", axis, angle, rate))
        if back:
            path.append((f"{name}-", axis, -angle, rate))
    return [*path, ("rest", (0, 0, 0), 72.0)]


def complete_path(seconds: float = 90.0) -> list[Stand | Turn]:
    """Return the note's path: warm up, ten positions, three turns, rest."""
    return [("warm-up", (0, 0, 0), 120.0), *positions(seconds), *turns()]


@dataclass(frozen=True)
class Grade:
    """White noise and drift: ARW rad/√s, rad/s, m/s²/√Hz, m/s²; both drifts of 200 s."""

    arw: float
    gyro_drift: float
    vrw: float
    acc_drift: float
    correlation: float = 200.0
    flicker: bool = False  # with this bias instability in place of the drifts


def grade(arw: float, gyro: float, vrw: float, acc: float, *, flicker: bool = False) -> Grade:
    """Return a grade of °/√h, °/h, µg/√Hz and µg."""
    noise = radians(arw) / 60, gyro * DEG_H, vrw * 1e-6 * G, acc * 1e-6 * G
    return Grade(*noise, flicker=flicker)


T = grade(0.1, 0.5, 60, 15)
GRADES = {"T": T, "I": grade(0.05, 0.2, 40, 10), "C": grade(0.3, 5, 150, 50)}
NAVIGATION = grade(0.002, 0.01, 5, 10, flicker=True)


@dataclass(frozen=True)
class Table:
    """Standard deviations of the table, and what is as it is."""

    harmonics: tuple[float, ...] = (2 * ARCSEC, 1 * ARCSEC)  # amplitudes, any phase
    white: float = 0.5 * ARCSEC
    square: float = 2 * ARCSEC  # of each of two right angles
    lean: float = 5 * ARCSEC
    azimuth: float = radians(0.1)
    latency: float = 2e-3  # s, exactly
    latitude: float = radians(38.0)
    gravity: float = G
    lever: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m, in the body
    fastest: float = radians(30)  # of moves between positions, rad/s
    acceleration: float = radians(30)  # rad/s²
    jerk: float | None = None  # rad/s³; none is no limit


@dataclass(frozen=True)
class Device:
    """Standard deviations of the sensor's errors."""

    gyro_bias: float = radians(0.3)
    acc_bias: float = 10e-3 * G
    scale: float = 5000e-6
    cross: float = radians(15 / 60)
    by_g: float = 0.0  # rad/s per m/s², each of nine


@dataclass(frozen=True, eq=False)
class Draw:
    """Recordings of (trials) devices with one path.

    Parameters
    ----------
    time : (n,) array
    rates, forces : (trials, n, 3) arrays
        Readings.
    angles : (trials, n, 3) array
        Readback: outer, middle, inner.
    labels : (n,) array of str
        Empty while moving between positions.
    gyro, acc : (trials, 12) arrays
        Truth: three biases, then S row after row.
    by_g : (trials, 3, 3) array
    true : (n, 3) array
        The axes' angles.
    gyro_drift, acc_drift : (trials, n, 3) arrays
        What is in the readings of it.
    between : (trials, n, 3) array
        What the rotation vector of each step, by its length, is more than the mean of the rates at
        its ends, as the gyros would read it: noise and drift apart, exact.
    """

    time: Array
    rates: Array
    forces: Array
    angles: Array
    labels: NDArray[np.str_]
    gyro: Array
    acc: Array
    by_g: Array
    true: Array
    gyro_drift: Array
    acc_drift: Array
    between: Array


def rotation_about(axis: int, angle: Array) -> Array:
    """Return the rotations by angles (...) about one axis, (..., 3, 3)."""
    j, k = (axis + 1) % 3, (axis + 2) % 3
    made = np.zeros((*np.shape(angle), 3, 3))
    made[..., axis, axis] = 1
    made[..., j, j] = made[..., k, k] = np.cos(angle)
    made[..., k, j], made[..., j, k] = np.sin(angle), -np.sin(angle)
    return made


def profile(angle: float, rate: float, table: Table, hz: float) -> tuple[Array, Array, Array]:
    """Return angle, rate and angle as it was `latency` before, of a move from rest to rest.

    At the samples after its start.
    """
    size, a = abs(angle), table.acceleration
    smooth = a / table.jerk if table.jerk else 0.0
    top = min(rate, sqrt(size * a))
    up = top / a
    flat = size / top - up
    ends = ((0.0, a), (up, -a), (up + flat, -a), (2 * up + flat, a))
    t = np.arange(1, int(np.ceil((2 * up + flat + smooth + table.latency) * hz)) + 1) / hz

    def summed(t: Array, degree: int) -> Array:
        """Return the acceleration's steps, integrated so many times."""
        made = np.zeros_like(t)
        for start, step in ends:
            if smooth:
                made += step / smooth * _ramp(t - start, degree + 1)
                made -= step / smooth * _ramp(t - start - smooth, degree + 1)
            else:
                made += step * _ramp(t - start, degree)
        return made

    sign, done = np.sign(angle), 2 * up + flat + smooth
    way = np.where(t >= done, size, summed(t, 2))
    late = np.where(t - table.latency >= done, size, summed(t - table.latency, 2))
    return sign * way, sign * np.where(t >= done, 0.0, summed(t, 1)), sign * late


def _ramp(t: Array, degree: int) -> Array:
    return np.maximum(t, 0.0) ** degree / factorial(degree)


def simulate_travel(
    path: list[Stand | Turn], table: Table, hz: float
) -> tuple[Array, Array, Array, NDArray[np.str_]]:
    """Return the axes' angles and rates, the angles `latency` before, (n, 3), and labels."""
    now = np.zeros(3)
    angles, rates, before = ([np.zeros((1, 3))] for _ in range(3))
    labels = [np.array([""])]

    def append(way: Array, speed: Array, late: Array, label: str) -> None:
        angles.append(way)
        rates.append(speed)
        before.append(late)
        labels.append(np.full(len(way), label))

    for step in path:
        if len(step) == 3:
            label, there, seconds = step
            goal = np.radians(there)
            # A table may count whole turns: it moves to the nearest of all equal angles.
            goal = goal + 2 * pi * np.round((now - goal) / (2 * pi))
            each = [(k, d, table.fastest) for k, d in enumerate(goal - now) if abs(d) > 1e-12]
            name, rest = "", round(seconds * hz)
        else:
            label, axis, angle, rate = step
            each = [(axis, radians(angle), radians(rate))]
            goal = now.copy()
            goal[axis] += radians(angle)
            name, rest = label, 0
        made = {k: profile(d, w, table, hz) for k, d, w in each}
        n = max((len(m[0]) for m in made.values()), default=0)
        way, late, speed = np.tile(now, (n, 1)), np.tile(now, (n, 1)), np.zeros((n, 3))
        for k, (angle_of, rate_of, late_of) in made.items():
            way[:, k] = late[:, k] = goal[k]
            way[: len(angle_of), k] = now[k] + angle_of
            late[: len(angle_of), k] = now[k] + late_of
            speed[: len(angle_of), k] = rate_of
        append(way, speed, late, name)
        still = np.tile(goal, (rest, 1))
        append(still, np.zeros((rest, 3)), still, label)
        now = goal
    a, b, c = (np.concatenate(x) for x in (angles, rates, before))
    return a, b, c, np.concatenate(labels)


def drift(
    rng: np.random.Generator, sd: float, correlation: float, n: int, hz: float, trials: int
) -> Array:
    """Return a stationary Gauss–Markov process, (trials, n, 3)."""
    from scipy.signal import lfilter

    kept = np.exp(-1 / (hz * correlation))
    noise = sd * sqrt(1 - kept**2) * rng.standard_normal((trials, n, 3))
    noise[:, 0] = sd * rng.standard_normal((trials, 3))
    return np.asarray(lfilter([1.0], [1.0, -kept], noise, axis=1))


def flicker(
    rng: np.random.Generator, size: float, n: int, hz: float, shape: tuple[int, ...]
) -> Array:
    """Return noise of the two-sided density B²/(2π f), B = `size`, (*shape, n), less its mean.

    White noise, whose density is one sample's variance over `hz`, is shaped in frequency over four
    times the length, of which one piece is taken: what repeats after it is not a neighbour, and
    the noise goes on below the inverse of the length.
    """
    whole = 1 << (4 * n - 1).bit_length()
    f = np.fft.rfftfreq(whole, 1 / hz)
    gain = np.zeros(f.size)
    gain[1:] = size * np.sqrt(hz / (2 * pi * f[1:]))
    made = np.empty((*shape, n))
    for at in np.ndindex(*shape):
        spectrum = gain * np.fft.rfft(rng.standard_normal(whole))
        made[at] = np.fft.irfft(spectrum, whole)[:n]
    return made - made.mean(axis=-1, keepdims=True)


def _drift(
    rng: np.random.Generator, sensor: Grade, size: float, n: int, hz: float, trials: int
) -> Array:
    """Return the drift of a grade, (trials, n, 3)."""
    if sensor.flicker:
        return np.moveaxis(flicker(rng, size, n, hz, (trials, 3)), 1, 2)
    return drift(rng, size, sensor.correlation, n, hz, trials)


def draw(
    seed: int,
    trials: int,
    path: list[Stand | Turn],
    sensor: Grade = T,
    table: Table = Table(),
    device: Device = Device(),
    hz: float = 100.0,
) -> Draw:
    """Return recordings; equal seeds give equal draws."""
    rng = np.random.default_rng([seed, 2308])
    true, speed, late, labels = simulate_travel(path, table, hz)
    n = len(true)
    time = np.arange(n) / hz
    squares = table.square * rng.standard_normal((trials, 2))
    base = np.array([table.lean, table.lean, table.azimuth]) * rng.standard_normal((trials, 3))
    phases = rng.uniform(0, 2 * pi, (trials, len(table.harmonics), 3))
    outer, middle, inner = (rotation_about(a, true[:, k]) for k, a in enumerate((2, 0, 1)))
    earth = EARTH * np.array([0, np.cos(table.latitude), np.sin(table.latitude)])
    gyro = np.concatenate(
        [
            device.gyro_bias * rng.standard_normal((trials, 3)),
            _matrix(rng, device, trials).reshape(trials, 9),
        ],
        axis=1,
    )
    acc = np.concatenate(
        [
            device.acc_bias * rng.standard_normal((trials, 3)),
            _matrix(rng, device, trials).reshape(trials, 9),
        ],
        axis=1,
    )
    by_g = device.by_g * rng.standard_normal((trials, 3, 3))
    rates, forces, angles = (np.empty((trials, n, 3)) for _ in range(3))
    between, around = np.zeros((trials, n, 3)), _rotation_from_vector(earth / hz)
    for k in range(trials):
        tilted = (
            rotation_about(0, base[k, 0])
            @ rotation_about(1, base[k, 1])
            @ rotation_about(2, base[k, 2])
        )
        second = middle @ rotation_about(2, squares[k, 1]) @ inner
        mat = tilted @ outer @ rotation_about(1, squares[k, 0]) @ second
        w = mat.swapaxes(1, 2) @ earth
        # Each axis' direction in the body: rows of the rotations that follow it.
        follows = rotation_about(1, squares[k, 0]) @ second
        w += speed[:, :1] * follows[:, 2, :]
        w += speed[:, 1:2] * second[:, 0, :]
        w += speed[:, 2:] * np.array([0.0, 1.0, 0.0])
        f = table.gravity * mat[:, 2, :]
        if any(table.lever):
            arm, own = np.array(table.lever), w - mat.swapaxes(1, 2) @ earth
            f = f + np.cross(np.gradient(own, 1 / hz, axis=0), arm)
            f += np.cross(own, np.cross(own, arm))
        turned = _rotation_vector(mat[:-1].swapaxes(1, 2) @ around @ mat[1:]) * hz
        beyond = turned - (w[1:] + w[:-1]) / 2
        between[k, 1:] = beyond + beyond @ gyro[k, 3:].reshape(3, 3).T
        rates[k] = w + w @ gyro[k, 3:].reshape(3, 3).T + gyro[k, :3] + f @ by_g[k].T
        forces[k] = f + f @ acc[k, 3:].reshape(3, 3).T + acc[k, :3]
        angles[k] = late
        for m, size in enumerate(table.harmonics):
            angles[k] += size * np.sin((m + 1) * late + phases[k, m])
    root = sqrt(hz)
    rates += sensor.arw * root * rng.standard_normal(rates.shape)
    gyro_drift = _drift(rng, sensor, sensor.gyro_drift, n, hz, trials)
    rates += gyro_drift
    forces += sensor.vrw * root * rng.standard_normal(forces.shape)
    acc_drift = _drift(rng, sensor, sensor.acc_drift, n, hz, trials)
    forces += acc_drift
    angles += table.white * rng.standard_normal(angles.shape)
    return Draw(
        time, rates, forces, angles, labels, gyro, acc, by_g, true, gyro_drift, acc_drift, between
    )


def _rotation_from_vector(v: Array) -> Array:
    """Return the rotation by a vector, by Rodrigues."""
    size = np.linalg.norm(v)
    k = np.cross(np.eye(3), v / size)
    return np.eye(3) + np.sin(size) * k + (1 - np.cos(size)) * k @ k


def _rotation_vector(mat: Array) -> Array:
    """Return the rotation vectors of rotations by less than a right angle."""
    v = 0.5 * np.stack(
        [mat[:, 2, 1] - mat[:, 1, 2], mat[:, 0, 2] - mat[:, 2, 0], mat[:, 1, 0] - mat[:, 0, 1]],
        axis=-1,
    )
    size = np.linalg.norm(v, axis=-1, keepdims=True)
    return v * np.arcsin(size) / np.maximum(size, 1e-300)


def _matrix(rng: np.random.Generator, device: Device, trials: int) -> Array:
    made = device.cross * rng.standard_normal((trials, 3, 3))
    diagonal = np.arange(3)
    made[:, diagonal, diagonal] = device.scale * rng.standard_normal((trials, 3))
    return made


def attitude(angles: Array) -> Array:
    """Return the attitude by readback (..., 3), (..., 3, 3)."""
    return (
        rotation_about(2, angles[..., 0])
        @ rotation_about(0, angles[..., 1])
        @ rotation_about(1, angles[..., 2])
    )
