"""The two filters of the note, dense, in NumPy, over all trials at once: nothing of inercal.

Level frame east, north, up; C_est = (I − [φ×]) C, M = (I + Ŝ)⁻¹; X in the order of the note, S row
after row. F, G and H are written as the note has them and held over one update.

Of inercal's own is one rule: at rest, and about an axis that does not turn, F has the earth's rate
in it, not the readings'. How rates become an angle is neither's: noise apart, the generator's exact
steps are taken.
"""

from dataclasses import dataclass
from math import radians

import numpy as np
from numpy.typing import NDArray
from tests.accuracy.turntable import ARCSEC, EARTH, Draw, G, Grade, T, Table, attitude

Array = NDArray[np.float64]
TABLE = Table()
IDLE = 20.0  # variances of a sample within which of the earth's rate an axis does not turn
Step = tuple[Array, Array, Array, Array]
TEN = tuple(f"p{k + 1}" for k in range(10))


@dataclass(frozen=True, eq=False)
class FilterOutcome:
    """Where a filter ends: θ (trials, 12), its covariance, and the mean NIS per component."""

    theta: Array
    covariance: Array
    nis: Array


def cross(v: Array) -> Array:
    """Return [v×]."""
    x, y, z = np.moveaxis(v, -1, 0)
    o = np.zeros_like(x)
    return np.stack([o, -z, y, z, o, -x, -y, x, o], axis=-1).reshape(*x.shape, 3, 3)


def small_rotation(v: Array) -> Array:
    """Return exp [v×] by its series: the angles here are far below one."""
    k = cross(v)
    kk = k @ k
    s = (v**2).sum(-1)[..., None, None]
    return np.eye(3) + (1 - s / 6 + s**2 / 120) * k + (0.5 - s / 24 + s**2 / 720) * kk


def small_rotation_vector(mat: Array) -> Array:
    """Return the rotation vector of a small rotation."""
    v = 0.5 * np.stack(
        [mat[..., 2, 1] - mat[..., 1, 2], mat[..., 0, 2] - mat[..., 2, 0],
         mat[..., 1, 0] - mat[..., 0, 1]], axis=-1)  # fmt: skip
    size = np.linalg.norm(v, axis=-1, keepdims=True)
    return v * np.where(size > 1e-9, np.arcsin(np.minimum(size, 1)) / np.maximum(size, 1e-30), 1.0)


def kron(mat: Array, u: Array) -> Array:
    """Return CM kron(I₃, uᵀ), (..., 3, 9)."""
    return (mat[..., :, :, None] * u[..., None, None, :]).reshape(*mat.shape[:-2], 3, 9)


def strapdown(c: Array, w: Array, earth: Array, hz: float) -> tuple[Array, Array, Array]:
    """Return attitudes where each of n steps begins, half way, (trials, n, 3, 3), and at the end.

    From C, (trials, 3, 3), at rates w, (trials, n, 3).
    """
    whole, back = small_rotation(w / hz), small_rotation(-earth / hz)
    begun = np.empty_like(whole)
    for k in range(w.shape[1]):
        begun[:, k] = c
        c = back @ c @ whole[:, k]
    return begun, small_rotation(-earth / (2 * hz)) @ begun @ small_rotation(w / (2 * hz)), c


def gyro(
    made: Draw,
    states: int = 19,
    part: slice = slice(None),
    grade: Grade = T,
    table: Table = TABLE,
    every: int = 10,
    steps: list[Step] | None = None,
) -> FilterOutcome:
    """Return bias and S of the gyros: 15 or 19 states.

    At rest, and about an axis that does not turn, ω̂ is the earth's rate, as inercal has it: φ walks
    by the readings' noise, and F is to be free of it.
    Into `steps` go Φ, P before and after each update, and what the update adds to the states.
    """
    hz = 1 / (made.time[1] - made.time[0])
    trials, n = len(made.rates), states
    earth = EARTH * np.array([0, np.cos(table.latitude), np.sin(table.latitude)])
    bias = made.rates[:, : round(20 * hz)].mean(1) - earth  # the table at rest in its zero
    s, gm, late = np.zeros((trials, 3, 3)), np.zeros((trials, 3)), np.zeros(trials)
    sd = np.zeros(n)
    sd[:3], sd[3:6], sd[6:15] = 60 * ARCSEC, radians(1), 0.02
    if n == 19:
        sd[15:18], sd[18] = grade.gyro_drift, 5e-3
    p = np.tile(np.diag(sd**2), (trials, 1, 1))
    r = (10 if n == 15 else 4) * ARCSEC
    rates, angles, labels = made.rates[:, part], made.angles[:, part], made.labels[part]
    between = made.between[:, part]
    still = np.array([name != "" and name[-1] not in "+-" for name in labels])
    c, dt = attitude(angles[:, 0]), every / hz
    nis, count = np.zeros(trials), 0
    for k in range(1, rates.shape[1] - every + 1, every):
        m, drive = np.linalg.inv(np.eye(3) + s), np.zeros((trials, 3, n))
        now, last = slice(k, k + every), slice(k - 1, k + every - 1)
        mean = 0.5 * (rates[:, now] + rates[:, last]) + between[:, now]
        w = (mean - (bias + gm)[:, None]) @ m.swapaxes(1, 2)
        begun, half, c = strapdown(c, w, earth, hz)
        cm, around = half @ m[:, None], begun.swapaxes(2, 3) @ earth
        idle = still[now, None] | ((w - around) ** 2 / hz < IDLE * grade.arw**2)
        drive[:, :, 3:6] = -cm.sum(1) / hz
        drive[:, :, 6:15] = -kron(cm, np.where(idle, around, w)).sum(1) / hz
        phi, q = np.tile(np.eye(n), (trials, 1, 1)), np.zeros((n, n))
        phi[:, :3, :3] = np.eye(3) - cross(earth) * dt
        phi[:, :3, 3:] += drive[:, :, 3:]
        q[:3, :3] = grade.arw**2 * dt * np.eye(3)
        if n == 19:
            kept = np.exp(-dt / grade.correlation)
            phi[:, :3, 15:18] = drive[:, :, 3:6]
            phi[:, 15:18, 15:18] = kept * np.eye(3)
            gm = kept * gm
            q[15:18, 15:18] = grade.gyro_drift**2 * (1 - kept**2) * np.eye(3)
        p = phi @ p @ phi.swapaxes(1, 2) + q
        h = np.zeros((trials, 3, n))
        h[:, :, :3] = np.eye(3)
        z = small_rotation_vector(attitude(angles[:, k + every - 1]) @ c.swapaxes(1, 2))
        if n == 19:
            # The readback is late: it states an earlier angle of the table.
            h[:, :, 18] = earth - (c @ w[:, -1, :, None])[..., 0]
            z = z - h[:, :, 18] * late[:, None]
        ahead = p
        x, p, one = update(p, h, z, r**2 * np.eye(3))
        if steps is not None:
            steps.append((phi, ahead, p, x))
        nis, count = nis + one, count + 3
        c = small_rotation(x[:, :3]) @ c
        bias, s = bias + x[:, 3:6], s + x[:, 6:15].reshape(-1, 3, 3)
        if n == 19:
            gm, late = gm + x[:, 15:18], late + x[:, 18]
    theta = np.concatenate([bias, s.reshape(-1, 9)], axis=1)
    return FilterOutcome(theta, p[:, 3:15, 3:15], nis / count)


def update(p: Array, h: Array, z: Array, r: Array) -> tuple[Array, Array, Array]:
    """Return x, P in Joseph's form, and NIS."""
    ph = p @ h.swapaxes(-1, -2)
    v = h @ ph + r
    gain = ph @ np.linalg.inv(v)
    x = (gain @ z[..., None])[..., 0]
    left = np.eye(p.shape[-1]) - gain @ h
    p = left @ p @ left.swapaxes(-1, -2) + gain @ r @ gain.swapaxes(-1, -2)
    nis = np.einsum("...i,...ij,...j->...", z, np.linalg.inv(v), z)
    return x, (p + p.swapaxes(-1, -2)) / 2, nis


def smoothing_correction(steps: list[Step]) -> tuple[Array, Array]:
    """Return what Rauch, Tung and Striebel add to the filter, (e, trials, n), and P (…, n, n).

    x̂_s = x̂ + J (x̂_s⁺ − Φ x̂), J = P Φᵀ (P⁻)⁻¹; the bracket is what the next update adds and what
    is added to that.
    """
    added, spread = [np.zeros_like(steps[-1][3])], [steps[-1][2]]
    for (phi, ahead, _, x), (_, _, p, _) in zip(steps[:0:-1], steps[-2::-1], strict=True):
        # States differ by nine orders of magnitude: each by its own sd.
        sd = np.sqrt(np.diagonal(ahead, axis1=1, axis2=2))
        scaled = ahead / (sd[:, :, None] * sd[:, None, :])
        back = np.linalg.solve(scaled, phi @ p / sd[:, :, None]) / sd[:, :, None]
        back = back.swapaxes(1, 2)
        added.append((back @ (x + added[-1])[..., None])[..., 0])
        spread.append(p + back @ (spread[-1] - ahead) @ back.swapaxes(1, 2))
    return np.array(added[::-1]), np.array(spread[::-1])


def accelerometer(
    made: Draw,
    states: int = 25,
    holds: tuple[str, ...] = TEN,
    grade: Grade = T,
    table: Table = TABLE,
    every: int = 10,
    steps: list[Step] | None = None,
) -> FilterOutcome:
    """Return bias and S of the accelerometers: 18 or 25 states; `steps` as of `gyro`."""
    hz = 1 / (made.time[1] - made.time[0])
    trials, n, dt = len(made.rates), states, every / hz
    earth = EARTH * np.array([0, np.cos(table.latitude), np.sin(table.latitude)])
    g, first = np.array([0, 0, table.gravity]), slice(0, round(20 * hz))
    turning = made.rates - (made.rates[:, first].mean(1) - earth)[:, None]
    bias, s = made.forces[:, first].mean(1) - g, np.zeros((trials, 3, 3))
    gm, level = np.zeros((trials, 3)), np.zeros((trials, 2))
    sd = np.zeros(n)
    sd[6:9], sd[9:18] = 30e-3 * G, 0.02
    h = np.zeros((5, n))
    h[:3, :3], h[3:, 3:5] = np.eye(3), np.eye(2)
    fresh = dict.fromkeys(range(3), 1e-3) | dict.fromkeys(range(3, 6), 5e-4)
    if n == 25:
        sd[18:21], sd[21:23] = grade.acc_drift, 10 * ARCSEC
        fresh |= {23: 3.5 * ARCSEC, 24: 3.5 * ARCSEC}
        h[3:, 21:23] = h[3:, 23:25] = -np.eye(2)
    p = np.tile(np.diag(sd**2), (trials, 1, 1))
    r = np.diag([1e-3**2] * 3 + [((1 if n == 25 else 10) * ARCSEC) ** 2] * 2)
    nis, count, before = np.zeros(trials), 0, 0.0
    for name in holds:
        at = np.flatnonzero(made.labels == name)
        c, v, held = attitude(made.angles[:, at[0]]), np.zeros((trials, 3)), np.zeros((trials, 2))
        p = p.copy()
        for k, size in fresh.items():
            p[:, k, :] = p[:, :, k] = 0.0
            p[:, k, k] = size**2
        if n == 25:
            kept = np.exp(-(made.time[at[0]] - before) / grade.correlation)
            p[:, 18:21, :] *= kept
            p[:, :, 18:21] *= kept
            p[:, range(18, 21), range(18, 21)] += grade.acc_drift**2 * (1 - kept**2)
            gm = gm * kept
        if steps is not None:
            keep = np.ones(n)
            keep[list(fresh)] = 0.0
            keep[18:21] = np.exp(-(made.time[at[0]] - before) / grade.correlation)
            steps.append((np.tile(np.diag(keep), (trials, 1, 1)), p, p, np.zeros((trials, n))))
        for k in range(1, len(at) - every + 1, every):
            m, drive = np.linalg.inv(np.eye(3) + s), np.zeros((trials, 3, n))
            now, last = at[k : k + every], at[k - 1 : k + every - 1]
            w = 0.5 * (turning[:, now] + turning[:, last])
            mean = 0.5 * (made.forces[:, now] + made.forces[:, last])
            f = (mean - (bias + gm)[:, None]) @ m.swapaxes(1, 2)
            _, half, c = strapdown(c, w, earth, hz)
            cm = half @ m[:, None]
            drive[:, :, 6:9] = cm.sum(1) / hz
            drive[:, :, 9:18] = kron(cm, f).sum(1) / hz
            push = ((half @ f[..., None])[..., 0] - g).sum(1) / hz
            v = v + push
            phi, q = np.tile(np.eye(n), (trials, 1, 1)), np.zeros((n, n))
            phi[:, :3, :3] = np.eye(3) - 2 * cross(earth) * dt
            phi[:, :3, 3:6] = cross(g) * dt
            phi[:, :3, 6:] += drive[:, :, 6:]
            phi[:, 3:6, 3:6] = np.eye(3) - cross(earth) * dt
            q[:3, :3], q[3:6, 3:6] = grade.vrw**2 * dt * np.eye(3), grade.arw**2 * dt * np.eye(3)
            if n == 25:
                kept = np.exp(-dt / grade.correlation)
                phi[:, :3, 18:21] = drive[:, :, 6:9]
                phi[:, 18:21, 18:21] = kept * np.eye(3)
                gm = kept * gm
                q[18:21, 18:21] = grade.acc_drift**2 * (1 - kept**2) * np.eye(3)
            p = phi @ p @ phi.swapaxes(1, 2) + q
            tilt = small_rotation_vector(
                attitude(made.angles[:, at[k + every - 1]]) @ c.swapaxes(1, 2)
            )[:, :2]
            z = np.concatenate([v, tilt], axis=1)
            if n == 25:
                z[:, 3:] += level + held
            ahead = p
            x, p, one = update(p, h, z, r)
            if steps is not None:
                steps.append((phi, ahead, p, x))
            nis, count = nis + one, count + 5
            v, c = v - x[:, :3], small_rotation(x[:, 3:6]) @ c
            bias, s = bias + x[:, 6:9], s + x[:, 9:18].reshape(-1, 3, 3)
            if n == 25:
                gm, level, held = gm + x[:, 18:21], level + x[:, 21:23], held + x[:, 23:]
        before = made.time[at[-1]]
    theta = np.concatenate([bias, s.reshape(-1, 9)], axis=1)
    return FilterOutcome(theta, p[:, 6:18, 6:18], nis / count)


def summary(done: FilterOutcome, truth: Array, unit: float) -> tuple[float, float, float, float]:
    """Return rms of bias (in `unit`), scale in ppm, misalignment in ″, and NEES."""
    off = done.theta - truth
    diagonal = np.isin(np.arange(9), (0, 4, 8))

    def rms(x: Array) -> float:
        return float(np.sqrt(np.mean(x**2)))

    nees = np.einsum("ti,tij,tj->t", off, np.linalg.inv(done.covariance), off).mean() / 12
    return (
        rms(off[:, :3]) / unit,
        rms(off[:, 3:][:, diagonal]) / 1e-6,
        rms(off[:, 3:][:, ~diagonal]) / ARCSEC,
        float(nees),
    )
