"""An IMU on a table that turns it between rests, in simulation; imports nothing of inercal.

The table is tilted, its axes are not square and its angles are off, and the IMU stands away from
the axis. A sample is the mean of a reading over one period about its time (an integrating sensor),
by Gauss's rule with three points, or the reading at that time. Everything is SI; n is east, north,
up; C takes the body to n.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

G = 9.80665
EARTH = 7.292115e-5
UG, PPM, ARCSEC, DEG_H = 1e-6 * G, 1e-6, np.pi / 648_000, np.pi / 180 / 3600
PATH_19 = (
    *("+y",) * 3, *("-y",) * 3, "+z", *("+x",) * 3, *("-x",) * 3, *("+z",) * 2, *("-z",) * 3,
)  # fmt: skip
_GAUSS = ((-(0.6**0.5) / 2, 5 / 18), (0.0, 8 / 18), (0.6**0.5 / 2, 5 / 18))
UNITS = {
    "bias": DEG_H, "scale": PPM, "k0": UG, "k1": PPM, "k2": UG / G**2, "arm": 1e-3,
    "delta": ARCSEC, "lag": 1e-3, "g": DEG_H / G, "k1_prime": PPM, "scale_prime": PPM,
}  # fmt: skip


@dataclass(frozen=True)
class Grade:
    """Noise of both triads, and one standard deviation of each kind of coefficient before."""

    gyro_white: float
    gyro_drift: float
    force_white: float
    force_drift: float
    bias: float
    scale: float
    delta: float
    k0: float
    k2: float
    lag: float
    arm: float = 0.03


NAVIGATION = Grade(
    0.002 * np.pi / 180 / 60, 0.003 * DEG_H, 10 * UG, 3 * UG,
    0.1 * DEG_H, 100 * PPM, 60 * ARCSEC, 300 * UG, 30 * UG / G**2, 1e-3,
)  # fmt: skip
TACTICAL = Grade(
    0.1 * np.pi / 180 / 60, 0.5 * DEG_H, 60 * UG, 15 * UG,
    10 * DEG_H, 1000 * PPM, 300 * ARCSEC, 3000 * UG, 100 * UG / G**2, 2e-3,
)  # fmt: skip
GRADES = {"N": NAVIGATION, "T": TACTICAL}


@dataclass(frozen=True)
class Table:
    """How the table moves; errors are standard deviations."""

    path: tuple[str, ...] = PATH_19
    up: str = "x"
    rate: float = np.radians(10)
    angle: float = np.pi / 2
    ramp: float = 1.0
    rest: float = 40.0
    first: float = 70.0
    last: float = 90.0
    latitude: float = np.radians(40)
    gravity: float = G
    tilt: float = np.radians(2)
    skew: float = np.radians(0.5)
    angle_error: float = np.radians(0.2)
    outer_arm: float = 0.1
    azimuth: float | None = None
    # Faults: creep after each turn (size, rad, and time, s), one knock, sway (rad, Hz)
    creep: tuple[float, float] = (0.0, 1.0)
    knock: tuple[float, float] = (0.0, 0.0)
    sway: tuple[float, float] = (0.0, 1.0)


@dataclass
class Recorded:
    """A recording, and the truth by the product's names of coefficients, SI."""

    time: np.ndarray
    reading: np.ndarray  # (n, 6): ax, ay, az, gx, gy, gz
    truth: dict[str, float]
    lag: float
    attitudes: np.ndarray  # (rests, 3, 3)
    rests: np.ndarray  # (rests, 2), s: when each begins and ends
    drift_means: dict[str, float] = field(default_factory=dict)


def cross_matrix(v: Any):
    v = np.asarray(v, dtype=float)
    m = np.zeros((*v.shape, 3))
    m[..., 0, 1], m[..., 0, 2], m[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    m[..., 1, 0], m[..., 2, 0], m[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return m


def rotation(axis: Any, angle: Any):
    """Return the rotations by angles, (...), about a unit axis: (..., 3, 3)."""
    k = cross_matrix(axis)
    s, c = np.sin(angle)[..., None, None], (1 - np.cos(angle))[..., None, None]
    return np.eye(3) + s * k + c * (k @ k)


def draw_truth(grade: Grade, rng: Any, *, more: dict[str, float] | None = None):
    """Return coefficients of one device by name, and its lag; `more` are further terms by size."""
    truth: dict[str, float] = {}
    for axis in "xyz":
        truth[f"g{axis}.bias"] = grade.bias * rng.standard_normal()
        truth[f"g{axis}.scale"] = grade.scale * rng.standard_normal()
        truth[f"g{axis}.delta_o"] = grade.delta * rng.standard_normal()
        truth[f"g{axis}.delta_p"] = grade.delta * rng.standard_normal()
        truth[f"a{axis}.k0"] = grade.k0 * rng.standard_normal()
        truth[f"a{axis}.k1"] = grade.scale * rng.standard_normal()
        truth[f"a{axis}.k2"] = grade.k2 * rng.standard_normal()
    for name in ("ay.delta_p", "az.delta_o", "az.delta_p"):
        truth[name] = grade.delta * rng.standard_normal()
    for axis in "xy":
        for part in "ipo":
            truth[f"a{axis}.arm_{part}"] = grade.arm * rng.standard_normal()
    for word, size in (more or {}).items():
        for axis in "xyz":
            kind = "g" if word.startswith(("g_", "scale")) else "a"
            truth[f"{kind}{axis}.{word}"] = size * rng.standard_normal()
    return truth, grade.lag * rng.standard_normal()


def _triad(truth: Any, kind: Any, one: Any):
    """Return the bias and the matrix of a triad."""
    names = {"a": ("k0", "k1"), "g": ("bias", "scale")}[kind]
    bias, matrix = np.zeros(3), np.eye(3)
    for k, axis in enumerate("xyz"):
        get = lambda word, a=axis: truth.get(f"{kind}{a}.{word}", 0.0)  # noqa: E731
        bias[k] = get(names[0])
        matrix[k, k] += get(names[1])
        matrix[k, (k + 1) % 3] += get("delta_o")
        matrix[k, (k + 2) % 3] -= get("delta_p")
    return bias, matrix


def _each(truth: Any, kind: Any, word: Any):
    return np.array([truth.get(f"{kind}{axis}.{word}", 0.0) for axis in "xyz"])


def sense(truth: Any, w: Any, dw: Any, f: Any, *, force: Any):
    """Return readings, (n, 3), of the accelerometers or of the gyros for a motion."""
    bias, matrix = _triad(truth, "a" if force else "g", None)
    size = np.linalg.norm
    if not force:
        y = w @ matrix.T + bias + 0.5 * _each(truth, "g", "scale_prime") * np.abs(w)
        for k in range(3):
            for part, shift in (("i", 0), ("p", 1), ("o", 2)):
                y[:, k] += truth.get(f"g{'xyz'[k]}.g_{part}", 0.0) * f[:, (k + shift) % 3]
        assert size(y) > 0
        return y
    y = f @ matrix.T + bias + _each(truth, "a", "k2") * f**2
    y += 0.5 * _each(truth, "a", "k1_prime") * np.abs(f) + _each(truth, "a", "k3") * f**3
    for k, axis in enumerate("xyz"):
        r = np.zeros(3)
        for j, part in enumerate("ipo"):
            r[(k + j) % 3] = truth.get(f"a{axis}.arm_{part}", 0.0)
        if r.any():
            y[:, k] += (np.cross(dw, r) + np.cross(w, np.cross(w, r)))[:, k]
    return y


class _Path:
    """The motion of the body along the path, at any time."""

    def __init__(self, table: Table, rng: Any):
        self.table = table
        self.earth = EARTH * np.array([0, np.cos(table.latitude), np.sin(table.latitude)])
        up = np.eye(3)["xyz".index(table.up)]
        azimuth = rng.uniform(-np.pi, np.pi) if table.azimuth is None else table.azimuth
        level = np.roll(up, 1)
        start = np.stack([level, np.cross(up, level), up])  # rows: body to n
        lean = rng.standard_normal(3) * table.tilt * np.array([1, 1, 0])
        turn = rotation(np.array([0, 0, 1.0]), np.array(azimuth))
        norm = np.linalg.norm(lean) or 1.0
        self.attitudes = [rotation(lean / norm, np.array(norm * (lean.any()))) @ turn @ start]
        self.turns = []
        time = table.first
        self.rests = [[0.0, time]]
        for k, word in enumerate(table.path):
            sign, axis = (1 if word[0] == "+" else -1), np.eye(3)["xyz".index(word[1])]
            axis = axis + table.skew * rng.standard_normal(3)
            axis /= np.linalg.norm(axis)
            angle = sign * (table.angle + table.angle_error * rng.standard_normal())
            steady = abs(angle) / table.rate - table.ramp
            seconds = steady + 2 * table.ramp
            self.turns.append((time, seconds, steady, axis, angle))
            self.attitudes.append(self.attitudes[-1] @ rotation(axis, np.array(angle)))
            time += seconds
            rest = table.last if k + 1 == len(table.path) else table.rest
            self.rests.append([time, time + rest])
            time += rest
        self.end = time
        self.wobble = rng.standard_normal(3)
        self.wobble /= np.linalg.norm(self.wobble)

    def _profile(self, s: Any, seconds: Any, steady: Any, angle: Any):
        """Return angle, rate and acceleration at times s into a turn: ramps are raised cosines."""
        ramp = self.table.ramp
        rate = angle / (steady + ramp)
        up, down = np.clip(s, 0, ramp), np.clip(s - ramp - steady, 0, ramp)
        middle = np.clip(s - ramp, 0, steady)
        k = np.pi / ramp
        turned = rate * (0.5 * up - np.sin(k * up) / (2 * k) + middle)
        turned += rate * (0.5 * down + np.sin(k * down) / (2 * k))
        rising, falling = (s > 0) & (s < ramp), (s > ramp + steady) & (s < seconds)
        flat = (s >= ramp) & (s <= ramp + steady)
        speed = rate * (0.5 * (1 - np.cos(k * up)) * rising + flat)
        speed += rate * 0.5 * (1 + np.cos(k * down)) * falling
        acceleration = 0.5 * rate * k * (np.sin(k * up) * rising - np.sin(k * down) * falling)
        return turned, speed, acceleration

    def at(self, t: Any):
        """Return ω, dω/dt and f in the body at times (n,)."""
        table, n = self.table, t.size
        w, dw, f = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3))
        starts = np.array([turn[0] for turn in self.turns])
        part = np.searchsorted(starts, t, side="right") - 1
        r0 = table.outer_arm * np.array([1, 1, 1]) / 3**0.5
        for k in range(-1, len(self.turns)):
            own = np.flatnonzero(part == k)
            if not own.size:
                continue
            if k < 0:
                c = np.broadcast_to(self.attitudes[0], (own.size, 3, 3)).copy()
                rate, acceleration = np.zeros((own.size, 3)), np.zeros((own.size, 3))
            else:
                begin, seconds, steady, axis, angle = self.turns[k]
                turned, speed, faster = self._profile(t[own] - begin, seconds, steady, angle)
                c = self.attitudes[k] @ rotation(axis, turned)
                rate, acceleration = speed[:, None] * axis, faster[:, None] * axis
                size, tau = table.creep
                if size:
                    since = np.maximum(t[own] - begin - seconds, 0.0)
                    gone = size * np.exp(-since / tau) * (since > 0)
                    c = c @ rotation(axis, -gone)
                    rate = rate + (gone / tau)[:, None] * axis
            if table.sway[0]:
                size, hz = table.sway
                k2 = 2 * np.pi * hz
                c = c @ rotation(self.wobble, size * np.sin(k2 * t[own]))
                rate = rate + (size * k2 * np.cos(k2 * t[own]))[:, None] * self.wobble
                acceleration = acceleration - (size * k2**2 * np.sin(k2 * t[own]))[:, None] * (
                    self.wobble
                )
            if table.knock[0]:
                # As a raised cosine of 0.2 s
                size, when = table.knock
                s = np.clip((t[own] - when) / 0.2, 0, 1)
                turned = rotation(self.wobble, size * (s - np.sin(2 * np.pi * s) / (2 * np.pi)))
                c = c @ turned
                rate, acceleration = (
                    np.einsum("nji,nj->ni", turned, one) for one in (rate, acceleration)
                )
                rate = rate + (size * (1 - np.cos(2 * np.pi * s)) / 0.2)[:, None] * self.wobble
            earth = np.einsum("nji,j->ni", c, self.earth)
            w[own] = rate + earth
            # Of a vector fixed in n, seen in the body
            dw[own] = acceleration - np.cross(rate, earth)
            moved = np.cross(acceleration, r0) + np.cross(rate, np.cross(rate, r0))
            moved += 2 * np.cross(earth, np.cross(rate, r0))
            f[own] = table.gravity * c[:, 2] + moved
        return w, dw, f


def markov(rng: Any, shape: Any, step: Any):
    """Return a unit Gauss–Markov process; step in correlation times."""
    white = rng.standard_normal(shape)
    from scipy.signal import lfilter

    a = np.exp(-step)
    white[1:] *= (1 - a * a) ** 0.5
    return lfilter([1.0], [1.0, -a], white, axis=0)


def flicker(rng: Any, shape: Any):
    """Return 1/f noise of spectrum 1/(2π f), both sides, by its spectrum."""
    n = 4 * shape[0]
    spectrum = np.fft.rfft(rng.standard_normal((n, shape[1])), axis=0)
    hz = np.fft.rfftfreq(n)
    hz[0] = np.inf
    return np.fft.irfft(spectrum * (2 * np.pi * hz[:, None]) ** -0.5, n=n, axis=0)[: shape[0]]


def record(
    truth: Any,
    lag: Any,
    table: Table,
    rng: Any,
    *,
    rate_hz: Any = 20.0,
    grade: Grade | None = None,
    drift: Any = "markov",
    samples: Any = "mean",
):
    """Return a recording; without a grade it has no noise.

    drift is "markov" (300 s), "flicker" or "none".
    """
    path = _Path(table, rng)
    dt = 1 / rate_hz
    time = np.arange(int(path.end * rate_hz)) * dt
    reading = np.zeros((time.size, 6))
    for shift, weight in _GAUSS if samples == "mean" else ((0.0, 1.0),):
        t = time + shift * dt
        w, dw, f = path.at(t)
        reading[:, 3:] += weight * sense(truth, w, dw, f, force=False)
        w, dw, f = path.at(t - lag)
        reading[:, :3] += weight * sense(truth, w, dw, f, force=True)
    means: dict[str, float] = {}
    if grade is not None:
        white = np.repeat([grade.force_white, grade.gyro_white], 3)
        size = np.repeat([grade.force_drift, grade.gyro_drift], 3)
        reading += white * rate_hz**0.5 * rng.standard_normal(reading.shape)
        if drift != "none":
            one = flicker(rng, reading.shape) if drift == "flicker" else None
            one = markov(rng, reading.shape, dt / 300.0) if one is None else one
            reading += size * one
            if drift == "flicker":
                for k, name in enumerate(
                    ("ax.k0", "ay.k0", "az.k0", "gx.bias", "gy.bias", "gz.bias")
                ):
                    means[name] = float((size * one)[:, k].mean())
    return Recorded(
        time, reading, truth, lag, np.array(path.attitudes), np.array(path.rests), means
    )
