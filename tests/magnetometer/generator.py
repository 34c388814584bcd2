"""Simulated recordings of a magnetometer in the earth's field; plain NumPy, nothing of inercal.

m = D h + o with h = Rᵀ B (cos δ, 0, −sin δ), and f = M Rᵀ (0, 0, g) + b. R takes vectors from the
body to north, west and up.
"""
# Arrays and records without annotations, because a plain script is easier to compare with formulas.
# pyright: reportUnknownParameterType=false, reportArgumentType=false
# pyright: reportPossiblyUnboundVariable=false

from dataclasses import dataclass, field

import numpy as np

G = 9.80665  # m/s²
SIGMA_M = 0.1e-6  # T
SIGMA_F = 0.005  # m/s²
DIP = np.radians(65.0)
RANDOM_WALK = np.radians(0.005)  # of the gyros, rad/√s


def cross_matrix(v):
    x, y, z = np.moveaxis(np.asarray(v, dtype=float), -1, 0)
    zero = np.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def rotation(v):
    """Rodrigues' formula, (..., 3) to (..., 3, 3)."""
    angle = np.linalg.norm(v, axis=-1)[..., None, None]
    safe = np.where(angle < 1e-12, 1.0, angle)
    k = cross_matrix(v) / safe
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def scattered(rng, n, tilt=np.pi):
    """Attitudes whose body z axis is within `tilt` of up, uniform on that cap, any azimuth."""
    z = rng.uniform(np.cos(tilt), 1.0, n)
    about, spin = rng.uniform(0, 2 * np.pi, (2, n))
    lean = rotation(np.arccos(z)[:, None] * np.stack([np.cos(about), np.sin(about), 0 * z], 1))
    return rotation(spin[:, None] * np.array([0.0, 0.0, 1.0])) @ lean


def six_faces(rng, azimuths, scatter=0.0):
    """Each face up, at `azimuths` equally spaced azimuths that start anywhere."""
    quarter = np.pi / 2
    faces = rotation(
        quarter * np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0], [0, 1, 0], [0, 3, 0.0]])
    )
    turns = np.arange(azimuths) * 2 * np.pi / azimuths
    spin = (turns + rng.uniform(0, 2 * np.pi, (6, 1))).ravel()
    own = rotation(spin[:, None] * np.array([0.0, 0.0, 1.0])) @ np.repeat(faces, azimuths, axis=0)
    return own @ rotation(scatter * rng.standard_normal((len(own), 3)))


def tumbling(rng, n, step=0.2, rate=1.2):
    """Attitudes every `step` seconds of a smooth motion, and the turns between them, (n − 1, 3)."""
    t = np.arange(n - 1) * step
    frequency = rng.uniform(0.1, 0.6, (3, 3))
    phase = rng.uniform(0, 2 * np.pi, (3, 3))
    waves = np.sin(frequency[..., None] * t + phase[..., None])
    turns = rate * step * waves.mean(axis=1).T * 1.7
    attitude = [scattered(rng, 1)[0]]
    for one in rotation(turns):
        attitude.append(attitude[-1] @ one)
    return np.array(attitude), turns


@dataclass
class Device:
    """True coefficients of a magnetometer and the field."""

    d: np.ndarray
    o: np.ndarray
    strength: float = 50e-6
    dip: float = DIP

    @property
    def field(self):
        return self.strength * np.array([np.cos(self.dip), 0.0, -np.sin(self.dip)])


def device(rng, axes=None, strength=50e-6, dip=DIP):
    """Soft iron 5 %, rotation 3° per axis, offset 20 µT per axis; `axes` multiplies D."""
    soft = np.eye(3) + 0.05 * np.tril(rng.standard_normal((3, 3)))
    d = (soft + np.tril(soft, -1).T) @ rotation(np.radians(3.0) * rng.standard_normal(3))
    d = d if axes is None else axes @ d
    return Device(d, 20e-6 * rng.standard_normal(3), strength, dip)


@dataclass
class Data:
    """What the estimator receives, and the truth."""

    device: Device
    reading: np.ndarray
    sigma_m: np.ndarray  # (n,)
    node: np.ndarray
    up: np.ndarray
    up_sd: float
    up_by_known: np.ndarray
    known: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))  # covariance
    known_error: np.ndarray = field(default_factory=lambda: np.zeros(0))  # used minus true
    before: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=int))
    turn: np.ndarray = field(default_factory=lambda: np.zeros((0, 3, 3)))
    turn_sd: float = 1e-4
    turn_by_known: np.ndarray | None = None
    about_up: bool = False


def rests(
    rng,
    attitude,
    own,
    *,
    sigma_m=SIGMA_M,
    sigma_f=SIGMA_F,
    disturbance=None,
    drift=None,
    noise=1.0,
):
    """Rests with exact accelerometers.

    `disturbance` (n, 3) is added to the field (north, west, up), `drift` (n, 3) to the offset.
    With `noise` 0, the readings are exact, although their stated noise is the same.
    """
    n = len(attitude)
    b = np.tile(own.field, (n, 1)) if disturbance is None else own.field + disturbance
    h = np.einsum("kji,kj->ki", attitude, b)
    sd = np.broadcast_to(sigma_m, (n,))
    reading = h @ own.d.T + own.o + noise * sd[:, None] * rng.standard_normal((n, 3))
    if drift is not None:
        reading = reading + drift
    f = G * attitude[:, 2] + noise * sigma_f * rng.standard_normal((n, 3))
    up = f / np.linalg.norm(f, axis=1, keepdims=True)
    return Data(own, reading, sd, np.arange(n), up, sigma_f / G, np.zeros((n, 3, 0)))


LOWER = [(0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2)]


def with_accelerometers(data, covariance, error):
    """Use accelerometers that are wrong by `error` (nine numbers, see `accelerometer`)."""
    m, b = accelerometer(error)
    f = G * data.up
    # The true readings are f; the used coefficients make (M⁻¹)(f − b) of them.
    used = (f - b) @ np.linalg.inv(m).T
    return set_directions(data, used, m, covariance, error)


def accelerometer(a):
    """M and b of nine numbers: the lower triangle of M − 1, and b in g."""
    m = np.eye(3)
    for k, (i, j) in enumerate(LOWER):
        m[i, j] += a[k]
    return m, G * np.asarray(a[6:])


def force_by_coefficients(f, m):
    """∂f/∂a (n, 3, 9) of f = M⁻¹ (y − b)."""
    inverse = np.linalg.inv(m)
    columns = [-inverse[:, i] * f[:, [j]] for i, j in LOWER]
    columns += [np.tile(-G * inverse[:, k], (len(f), 1)) for k in range(3)]
    return np.stack(columns, axis=2)


def set_directions(data, f, m, covariance, error):
    size = np.linalg.norm(f, axis=1, keepdims=True)
    data.up = f / size
    across = np.eye(3) - data.up[:, :, None] * data.up[:, None, :]
    data.up_by_known = across @ force_by_coefficients(f, m) / size[:, :, None]
    data.known, data.known_error = covariance, np.asarray(error)
    return data


def norm_fit(readings, sigma_f):
    """Fit nine accelerometer coefficients to the norms of the same rests: a, covariance."""
    a = np.zeros(9)
    for _ in range(8):
        m, b = accelerometer(a)
        f = (readings - b) @ np.linalg.inv(m).T
        size = np.linalg.norm(f, axis=1)
        jacobian = np.einsum("ki,kia->ka", f / size[:, None], force_by_coefficients(f, m))
        a = a - np.linalg.lstsq(jacobian, size - G, rcond=None)[0]
    return a, sigma_f**2 * np.linalg.inv(jacobian.T @ jacobian)


def joint_rests(rng, attitude, own, true_a, **options):
    """Rests whose accelerometers were fitted to the norms of the same rests."""
    sigma_f = options.get("sigma_f", SIGMA_F)
    data = rests(rng, attitude, own, **options)
    m, b = accelerometer(true_a)
    raw = G * attitude[:, 2] @ m.T + b + sigma_f * rng.standard_normal((len(attitude), 3))
    a, covariance = norm_fit(raw, sigma_f)
    m, b = accelerometer(a)
    return set_directions(data, (raw - b) @ np.linalg.inv(m).T, m, covariance, a - true_a)


def add_turns(rng, data, turns, *, noise=RANDOM_WALK, step=5.0, gyro=None, about_up=False):
    """Add the rotations between neighbouring nodes; `turns` (n − 1, 3) are rotation vectors.

    `noise` is the angular random walk in rad/√s, `step` the duration of a turn. `gyro` contains
    standard deviations of the nine gains and the three biases (rad/s) of the gyros.
    """
    sd = noise * np.sqrt(step)
    count, q = len(turns), len(data.known)
    data.before, data.turn_sd, data.about_up = np.arange(count), sd, about_up
    bad, by = turns, np.zeros((count, 3, q))
    if gyro is not None:
        error = np.asarray(gyro) * rng.standard_normal(12)
        bad = turns + turns @ error[:9].reshape(3, 3).T + error[9:] * step
        # Minus the error of the turn, per unit of correction, in the frame after the turn.
        local = np.einsum("ij,kl->kijl", np.eye(3), bad).reshape(count, 3, 9)
        local = np.concatenate([local, np.tile(step * np.eye(3), (count, 1, 1))], axis=2)
        by = np.concatenate([by, right_jacobian(bad) @ local], axis=2)
        data.up_by_known = np.concatenate(
            [data.up_by_known, np.zeros((len(data.node), 3, 12))], axis=2
        )
        both = np.zeros((q + 12, q + 12))
        both[:q, :q], both[q:, q:] = data.known, np.diag(np.asarray(gyro) ** 2)
        data.known = both
        data.known_error = np.concatenate([data.known_error, error])
    data.turn = rotation(bad) @ rotation(sd * rng.standard_normal((count, 3)))
    data.turn_by_known = by
    return data


def right_jacobian(v):
    """∂ of Exp(v + x) = Exp(v) Exp(J x), from central differences."""
    step = 1e-6
    columns = []
    for axis in np.eye(3):
        moved = rotation(v - step * axis).swapaxes(-1, -2) @ rotation(v + step * axis)
        columns.append(
            np.stack(
                [
                    moved[..., 2, 1] - moved[..., 1, 2],
                    moved[..., 0, 2] - moved[..., 2, 0],
                    moved[..., 1, 0] - moved[..., 0, 1],
                ],
                axis=-1,
            )
            / (4 * step)
        )
    return np.stack(columns, axis=-1)


def turns_between(attitude):
    """Rotation vectors from each attitude to the next, at most 180°."""
    moved = attitude[:-1].swapaxes(-1, -2) @ attitude[1:]
    cosine = np.clip((np.trace(moved, axis1=1, axis2=2) - 1) / 2, -1, 1)
    axis = np.stack(
        [
            moved[:, 2, 1] - moved[:, 1, 2],
            moved[:, 0, 2] - moved[:, 2, 0],
            moved[:, 1, 0] - moved[:, 0, 1],
        ],
        axis=1,
    )
    angle = np.arccos(cosine)[:, None]
    length = np.maximum(np.linalg.norm(axis, axis=1, keepdims=True), 1e-12)
    return axis / length * angle


def without_directions(data, node=()):
    """Keep the upward directions of these nodes only."""
    node = np.asarray(node, dtype=int)
    data.up, data.up_by_known, data.node = data.up[node], data.up_by_known[node], node
    return data


def dense_covariance(attitude, own):
    """Covariance of the rows of (D, o), (12,), and of the dip, from central differences.

    All attitudes are unknowns, and all components of m and f are used.
    """
    n = len(attitude)
    size = np.concatenate([np.tile([1.0, 1.0, 1.0, own.strength], 3), np.ones(1 + 3 * n)])

    def predicted(x):
        rows = (x * size)[:12].reshape(3, 4)
        dip = own.dip + x[12]
        b = own.strength * np.array([np.cos(dip), 0.0, -np.sin(dip)])
        turned = attitude @ rotation(x[13:].reshape(n, 3))
        m = np.einsum("kji,j->ki", turned, b) @ (own.d + rows[:, :3]).T + own.o + rows[:, 3]
        return np.concatenate([m.ravel() / SIGMA_M, G * turned[:, 2].ravel() / SIGMA_F])

    steps = 1e-5 * np.eye(13 + 3 * n)
    jacobian = np.array([(predicted(s) - predicted(-s)) / 2e-5 for s in steps]).T
    covariance = np.linalg.inv(jacobian.T @ jacobian)[:13, :13]
    return covariance * np.outer(size[:13], size[:13])
