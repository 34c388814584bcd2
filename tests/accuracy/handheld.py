"""Hand-held sessions of many positions made from the physics alone, to hold inercal against.

Nothing of inercal is imported. As in `generator`, only attitudes and places are written down, as
functions of time, and what is felt is got from them by finite differences; n is east, north, up::

    q_nb(t) = yaw(t) ⊗ q_i ⊗ tip(t) ⊗ wobble(t)      from rest i to rest i + 1
    φ       = log(q_nb(t)⁻¹ ⊗ exp(Ω dt/2) ⊗ q_nb(t + dt/2))          over each half of a sample
    ω dt    = φ₁ + φ₂ − φ₁ × φ₂ / 6           the integral of the rate, which is what a gyro gives
    f       = q_nb⁻¹ (r̈ + g ẑ)                r̈ by second differences of r(t), over a sample
    reading = M_a f + b_a + k2 fᵢ² + k3 fᵢ³  and  M_g ω + G f + b_g  plus noise

The term −φ₁ × φ₂ / 6 takes away the coning of the half steps: their sum is ∫ω dt + φ₁ × φ₂ / 6.
fᵢ is f along the sensor's own input axes, the directions of the rows of M_a, so that k2 and k3 are
the same in whatever frame M_a is given. A sample lasts from its stamp to the next. The hand's own
Coriolis acceleration on the turning earth, 2 Ω v, is left out.

The hand wobbles by a slow sway (four fifths of the variance, below 0.3 Hz) and a tremor at 6–10 Hz
that is another in each trial, all through the session. Its push has a velocity of these colours.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from math import ceil, cos, pi, sin
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from tests.accuracy.ferraris import DEGREE, EARTH, Imu

Array = NDArray[np.float64]
HEADER = "time,acc_x,acc_y,acc_z,gyr_x,gyr_y,gyr_z"
SWAY_HZ, TREMOR_HZ, DAMPING, CUT_HZ = 0.3, (6.0, 10.0), 0.15, 20.0


@dataclass(frozen=True)
class Session:
    """What the hand does, in SI but for names with a unit; `latitude` None is no earth.

    Parameters
    ----------
    move_seconds : float
        Mean duration of a move; each is drawn within ±30 %, the same in all trials.
    tremor_deg : float
        Rms of the attitude's wobble about each axis of the body.
    tremor_push : float
        Rms of the hand's acceleration along each axis; the velocity stays bounded.
    drift_a, drift_g : float
        Size of a ramp and of a half sine in the biases, drawn for each axis and trial within
        0.5–1 of it with either sign; their mean over the session is zero.
    arm : float
        Reach of the hand in a move, out and back, along each axis at most.
    yaw_deg : float
        Largest turn about the vertical in a move.
    delay : float
        Seconds by which the gyros' data are late.
    """

    positions: int = 24
    hold_seconds: float = 3.0
    move_seconds: float = 1.5
    rate_hz: float = 100.0
    gravity: float = 9.81
    gravity_sd: float = 0.0
    latitude: float | None = None
    tremor_deg: float = 0.0
    tremor_push: float = 0.0
    drift_a: float = 0.0
    drift_g: float = 0.0
    arm: float = 0.2
    yaw_deg: float = 60.0
    delay: float = 0.0


@dataclass(frozen=True, eq=False)
class Handheld:
    """Stamps (n,) s, data (trials, n, 6) SI, true rests (half open), true gravity and ups.

    `ups` (trials, positions, 3) is the body's direction up at each rest, but for the wobble.
    """

    time: Array
    data: Array
    rests: list[tuple[int, int]]
    gravity: Array
    ups: Array

    def write_csv(self, path: Path, trial: int = 0) -> None:
        """Write one trial: time and the six channels in SI."""
        table = np.column_stack([self.time, self.data[trial]])
        np.savetxt(path, table, fmt="%.12g", delimiter=",", header=HEADER, comments="")


def directions(n: int, rng: np.random.Generator) -> Array:
    """Return well-spread directions up, (n, 3): a golden spiral, anyhow turned.

    From one to the next it is 40–120°, or as near to that as so few directions allow.
    """
    k = np.arange(n)
    z, azimuth = 1 - (2 * k + 1) / n, pi * (3 - 5**0.5) * k
    level = np.sqrt(1 - z**2)
    spiral = np.column_stack([level * np.cos(azimuth), level * np.sin(azimuth), z])
    q = rng.standard_normal((4, 1))
    return _ordered(_turned(q / float(np.linalg.norm(q)), spiral.T).T, rng)


def planar(n: int, normal: ArrayLike, off_deg: float, rng: np.random.Generator) -> Array:
    """Return directions up in the plane with `normal`, off it by `off_deg` rms, (n, 3)."""
    axis: Array = np.asarray(normal, dtype=float)
    axis = axis / float(np.linalg.norm(axis))
    first = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    first /= np.linalg.norm(first)
    angle = (rng.uniform(0, 2 * pi) + 2 * pi / n * np.arange(n, dtype=np.float64))[:, None]
    off = off_deg * DEGREE * rng.standard_normal((n, 1))
    ring = np.cos(angle) * first + np.sin(angle) * np.cross(axis, first)
    return _ordered(np.asarray(np.cos(off) * ring + np.sin(off) * axis, dtype=float), rng)


def about_one_axis(n: int, axis: ArrayLike, rng: np.random.Generator) -> Array:
    """Return directions up of a body that turns about one axis of it, held level, (n, 3).

    With `Session(yaw_deg=0.0)`, as else it turns about the vertical as well.
    """
    return planar(n, axis, 0.0, rng)


def triangular(imu: Imu) -> Imu:
    """Return the sensor with its coefficients in the frame in which M_a is lower triangular.

    x is along the first input axis and y in the plane of the first two: M_a = L Q, f' = Q f.
    """
    turn = to_triangular(imu)
    low = imu.M_a @ turn.T
    low[np.triu_indices(3, 1)] = 0.0
    arm = turn @ imu.arm
    return replace(imu, M_a=low, M_g=imu.M_g @ turn.T, G=imu.G @ turn.T, arm=arm)


def to_triangular(imu: Imu) -> Array:
    """Return Q, (3, 3), which takes vectors in the Imu's frame to the frame of `triangular`."""
    if np.linalg.det(imu.M_a) <= 0:
        raise ValueError("the rows of M_a are not right-handed: no rotation makes it triangular")
    q, r = np.linalg.qr(imu.M_a.T)
    return np.asarray((q * np.sign(np.diag(r))).T, dtype=float)


def readings(imu: Imu, felt: Array, k2: ArrayLike = 0.0, k3: ArrayLike = 0.0) -> Array:
    """Return what the sensor without noise gives for (f, ω), (..., 6)."""
    both = np.block([[imu.M_a, np.zeros((3, 3))], [imu.G, imu.M_g]])
    given = felt @ both.T
    given += np.concatenate([imu.b_a, imu.b_g])
    if np.any(k2) or np.any(k3):
        inputs = imu.M_a / np.linalg.norm(imu.M_a, axis=1, keepdims=True)
        along = felt[..., :3] @ inputs.T
        given[..., :3] += (np.asarray(k2) + np.asarray(k3) * along) * along**2
    return given


def record(
    imu: Imu,
    session: Session,
    rng: np.random.Generator,
    *,
    trials: int = 1,
    ups: ArrayLike | None = None,
    k2: ArrayLike = 0.0,
    k3: ArrayLike = 0.0,
) -> Handheld:
    """Return a session: rest, move, rest, …, rest.

    `ups`, (positions, 3) or (trials, positions, 3), says how the body rests and how often; without
    it, `directions` are drawn once for all trials. `k2` and `k3` are (3,), in 1/(m/s²) and its
    square. Rests and moves fall at the same samples in all trials, all else is drawn in each.
    """
    up = np.asarray(directions(session.positions, rng) if ups is None else ups, dtype=float)
    up = up / np.linalg.norm(up, axis=-1, keepdims=True)
    up = np.broadcast_to(up, (trials, *up.shape[-2:]))
    if up.shape[1] < 2:
        raise ValueError("a session has at least two positions")
    rate = session.rate_hz
    rests = _rests(session, up.shape[1], rng)
    count = rests[-1][1]
    late = ceil(abs(session.delay) * rate) + 1 if session.delay else 0
    if 2 * late > rests[0][1]:
        raise ValueError("the delay must be shorter than half a rest")
    g = session.gravity + session.gravity_sd * rng.standard_normal(trials)
    world = _World(session, imu.arm, g)
    wobble, push = _tremor(session, 2 * count + 1, trials, rng)
    trembles = bool(session.tremor_deg or session.tremor_push)

    felt = np.empty((trials, count, 6))
    azimuth = rng.uniform(0, 2 * pi, trials)
    rest = _mul(_quaternion(_along_z(azimuth)), _quaternion(_arc(up[:, 0], np.array([0, 0, 1.0]))))
    middles = [0, *((start + stop) // 2 for start, stop in rests[1:-1]), count]
    felt[:, : rests[0][1]] = world.at_rest(rest)
    for i, (start, stop) in enumerate(_moves(rests)):
        path, reach, ends = _move(rest, up[:, i], up[:, i + 1], session, rng)
        rest = ends
        felt[:, stop : rests[i + 1][1]] = world.at_rest(rest)
        # Without a tremor a rest is one attitude, and only the move itself needs its path.
        first, last = middles[i : i + 2] if trembles else (start - late, stop + late)
        halves = slice(2 * first, 2 * last + 1)
        now = np.arange(2 * first, 2 * last + 1) / (2 * rate)
        begin, seconds = start / rate, (stop - start) / rate

        def at(t: Array, begin: float = begin, seconds: float = seconds) -> Array:
            return np.clip((t - begin) / seconds, 0, 1)

        true = _mul(path(at(now)), _quaternion(wobble(0.0)[..., halves]))
        place = reach(at(now)) + push[..., halves]
        old = true
        if session.delay:
            shaken = _quaternion(wobble(session.delay)[..., halves])
            old = _mul(path(at(now - session.delay)), shaken)
        felt[:, first:last, :3] = np.moveaxis(world.force(true, place), 0, -1)
        felt[:, first:last, 3:] = np.moveaxis(world.rate(old), 0, -1)
    data = readings(imu, felt, k2, k3)
    del felt
    _add_drift(data, session, rng)
    _add_noise(data, imu, rate, rng)
    return Handheld(np.arange(count) / rate, data, rests, g, up)


@dataclass(frozen=True, eq=False)
class _World:
    """Gravity and the turning earth; vectors (3, trials, n), quaternions (4, trials, n)."""

    session: Session
    arm: Array
    g: Array

    @property
    def earth(self) -> Array:
        at = self.session.latitude
        return np.zeros(3) if at is None else EARTH * np.array([0.0, cos(at), sin(at)])

    def at_rest(self, q: Array) -> Array:
        """Return (f, ω), (trials, 1, 6), at the attitudes q, (4, trials, 1)."""
        f = _turned(_back(q), self.g[:, None] * np.array([0, 0, 1.0])[:, None, None])
        w = _turned(_back(q), self.earth[:, None, None])
        return np.moveaxis(np.concatenate([f, w]), 0, -1)

    def force(self, q: Array, place: Array) -> Array:
        """Return f in each sample, from attitudes and places at every half sample."""
        if self.arm.any():
            place = place + _turned(q, self.arm[:, None, None])
        bent = place[..., 2::2] - 2 * place[..., 1::2] + place[..., :-1:2]
        bent *= (2 * self.session.rate_hz) ** 2
        bent[2] += self.g[:, None]
        return _turned(_back(q[..., 1::2]), bent)

    def rate(self, q: Array) -> Array:
        """Return the mean of ω over each sample, from attitudes at every half sample."""
        ahead = q[..., 1:]
        if self.earth.any():
            turn = self.earth / (2 * self.session.rate_hz)
            ahead = _mul(_quaternion(turn[:, None, None]), ahead)
        step = _mul(_back(q[..., :-1]), ahead)
        sine = np.sqrt(step[1] ** 2 + step[2] ** 2 + step[3] ** 2)
        safe = np.where(sine > 0, sine, 1.0)
        half = 2 * step[1:] * np.where(sine > 0, np.arcsin(np.minimum(sine, 1.0)) / safe, 1.0)
        one, two = half[..., ::2], half[..., 1::2]
        return (one + two - _cross(one, two) / 6) * self.session.rate_hz


def _rests(session: Session, positions: int, rng: np.random.Generator) -> list[tuple[int, int]]:
    hold = round(session.hold_seconds * session.rate_hz)
    gaps = session.move_seconds * session.rate_hz * rng.uniform(0.7, 1.3, positions - 1)
    starts = np.cumsum([0, *(hold + np.maximum(1, np.rint(gaps)))]).astype(int)
    return [(int(start), int(start) + hold) for start in starts]


def _moves(rests: list[tuple[int, int]]) -> list[tuple[int, int]]:
    return [(a[1], b[0]) for a, b in pairwise(rests)]


def _move(
    rest: Array, up: Array, to: Array, session: Session, rng: np.random.Generator
) -> tuple[Callable[[Array], Array], Callable[[Array], Array], Array]:
    """Return attitude and place by the part of the time that is over, and the attitude at the end.

    The body tips so that `to` comes up while it turns about the vertical, each at its own pace.
    """
    trials = len(up)
    tip = _arc(to, up)
    yaw = session.yaw_deg * DEGREE * rng.uniform(-1, 1, trials)
    unevenness = rng.uniform(-1, 1, (2, trials, 3))
    far = session.arm * rng.uniform(-1, 1, (3, trials, 1))

    def path(s: Array) -> Array:
        turned, tipped = (_hand(s, waves) for waves in unevenness)
        return _mul(_mul(_quaternion(_along_z(yaw) * turned), rest), _quaternion(tip * tipped))

    def reach(s: Array) -> Array:
        return far * (64 * s**3 * (1 - s) ** 3)

    return path, reach, path(np.ones(1))


def _hand(s: Array, waves: Array) -> Array:
    """Return how much of a move is done, (trials, n): least jerk, and a hand's uneven pace."""
    smooth = s**3 * (10 - 15 * s + 6 * s**2)
    uneven = 0.3 * s**3 * (1 - s) ** 3 * np.sin(2 * pi * np.outer([2, 3, 4], s))
    return smooth + waves @ uneven


def _tremor(
    session: Session, size: int, trials: int, rng: np.random.Generator
) -> tuple[Callable[[float], Array], Array]:
    """Return the wobble (3, trials, size) as a function of a delay, and places under the push.

    Made of frequencies, so that they are smooth, and known between samples. Every half sample.
    """
    nothing = np.zeros((3, 1, size))
    length = 1 << (size - 1).bit_length()
    bins = np.arange(1, length // 2 + 1, dtype=np.float64)
    hz = bins * (2 * session.rate_hz / length)
    hz = hz[hz < 3 * CUT_HZ]

    def spectrum(power: Array) -> Array:
        """Return amplitudes of unit variance with that power in each trial, (3, trials, hz)."""
        random = rng.standard_normal((2, 3, *power.shape))
        return (random[0] + 1j * random[1]) * np.sqrt(power / power.sum(-1, keepdims=True)) / 2

    def series(amplitudes: Array) -> Array:
        made = np.empty((3, trials, size))
        for k, channel in enumerate(amplitudes):  # one at a time, for the memory's sake
            padded = np.pad(channel, ((0, 0), (1, 0)))  # nothing at zero frequency
            made[k] = np.fft.irfft(padded, length)[:, :size]
        return made * length

    power = _colours(hz, rng.uniform(*TREMOR_HZ, (trials, 1)))
    push, wobble = nothing, {0.0: nothing, session.delay: nothing}
    if session.tremor_push:
        push = session.tremor_push * series(spectrum(power * hz**2) / (2 * pi * hz) ** 2)
    if session.tremor_deg:
        angles = session.tremor_deg * DEGREE * spectrum(power)
        wobble = {late: series(angles * np.exp(-2j * pi * hz * late)) for late in wobble}
    return wobble.__getitem__, push


def _colours(hz: Array, peak: Array) -> Array:
    """Return the power of sway and tremor, (trials, hz)."""
    sway = 1 / (1 + (hz / SWAY_HZ) ** 2) ** 2
    ratio = (hz / peak) ** 2
    tremor = np.exp(-2 * (hz / CUT_HZ) ** 2) / ((1 - ratio) ** 2 + 4 * DAMPING**2 * ratio)
    return 0.8 * sway / sway.sum() + 0.2 * tremor / tremor.sum(-1, keepdims=True)


def _add_drift(data: Array, session: Session, rng: np.random.Generator) -> None:
    size = np.repeat([session.drift_a, session.drift_g], 3)
    if size.any():
        s = ((np.arange(data.shape[1]) + 0.5) / data.shape[1])[:, None]
        shape = (2, len(data), 1, 6)
        ramp, bump = size * rng.uniform(0.5, 1, shape) * rng.choice([-1.0, 1.0], shape)
        data += ramp * (s - 0.5)
        data += bump * (np.sin(pi * s) - 2 / pi)


def _add_noise(data: Array, imu: Imu, rate_hz: float, rng: np.random.Generator) -> None:
    white = np.repeat([imu.white_a, imu.white_g], 3) * rate_hz**0.5
    if white.any():
        noise = rng.standard_normal(data.shape)
        noise *= white
        data += noise
    steady = np.concatenate([imu.drift_a, imu.drift_g])
    if steady.any():
        data += np.arange(data.shape[1])[:, None] / rate_hz * steady
    colour = np.repeat([imu.colour_a, imu.colour_g], 3)
    if colour.any():
        keep = np.exp(-1 / (imu.colour_seconds * rate_hz))
        state = rng.standard_normal((len(data), 6))
        for k in range(data.shape[1]):
            data[:, k] += colour * state
            state = keep * state + (1 - keep**2) ** 0.5 * rng.standard_normal(state.shape)


def _ordered(ups: Array, rng: np.random.Generator) -> Array:
    """Return the directions in an order of 40–120° steps, or of as narrow a range as is found."""
    apart = np.arccos(np.clip(ups @ ups.T, -1, 1)) / DEGREE
    for wider in range(0, 61, 5):
        near = (apart > 40 - wider) & (apart < 120 + wider + 1e-6)
        for _ in range(100):
            free = np.ones(len(ups), dtype=bool)
            order = [int(rng.integers(len(ups)))]
            free[order] = False
            while (choice := np.flatnonzero(near[order[-1]] & free)).size:
                order.append(int(rng.choice(choice)))
                free[order[-1]] = False
            if not free.any():
                return ups[order]
    raise ValueError("no order of these directions has steps that differ from nothing")


def _arc(v: Array, to: Array) -> Array:
    """Return the shortest rotation vectors that take `v`, (trials, 3), to `to`: (3, trials, 1)."""
    axis = np.cross(v, to)
    sine, cosine = np.linalg.norm(axis, axis=-1, keepdims=True), (v * to).sum(-1, keepdims=True)
    # At 180° any level axis does; which, is left to the least component.
    level = np.cross(v, np.eye(3)[np.argmin(np.abs(v), axis=-1)])
    level /= np.linalg.norm(level, axis=-1, keepdims=True)
    axis = np.where(sine > 1e-12, axis / np.maximum(sine, 1e-12), level)
    return (axis * np.arctan2(sine, cosine)).T[..., None]


def _along_z(angle: Array) -> Array:
    return angle[:, None] * np.array([0, 0, 1.0])[:, None, None]


def _quaternion(v: Array) -> Array:
    """Return the unit quaternions (4, ...) of rotation vectors (3, ...)."""
    half = np.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2) / 2
    return np.concatenate([np.cos(half)[None], v * (np.sinc(half / pi) / 2)])


def _mul(p: Array, q: Array) -> Array:
    return np.stack(
        [
            p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
            p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
            p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1],
            p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0],
        ]
    )


def _back(q: Array) -> Array:
    return np.stack([q[0], -q[1], -q[2], -q[3]])


def _turned(q: Array, v: Array) -> Array:
    """Return v turned by q: v + 2 (w u + u ×) (u × v)."""
    twice = 2 * _cross(q[1:], v)
    return v + q[0] * twice + _cross(q[1:], twice)


def _cross(a: Array, b: Array) -> Array:
    return np.stack(
        [
            a[1] * b[2] - a[2] * b[1],
            a[2] * b[0] - a[0] * b[2],
            a[0] * b[1] - a[1] * b[0],
        ]
    )
