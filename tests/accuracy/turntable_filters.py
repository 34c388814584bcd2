"""The two filters of the note, dense, in NumPy, over all trials at once: nothing of inercal.

Level frame east, north, up; C_est = (I − [φ×]) C, M = (I + Ŝ)⁻¹; X in the order of the note, S row
after row. F, G and H are written as the note has them and held over one update.
"""

from dataclasses import dataclass
from math import radians

import numpy as np
from numpy.typing import NDArray

from tests.accuracy.turntable import ARCSEC, EARTH, Draw, G, Grade, T, Table, attitude

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Done:
    """Where a filter ends: θ (trials, 12), its covariance, and the mean NIS per component."""

    theta: Array
    covariance: Array
    nis: Array
    history: Array


def cross(v: Array) -> Array:
    """Return [v×]."""
    x, y, z = np.moveaxis(v, -1, 0)
    o = np.zeros_like(x)
    return np.stack([o, -z, y, z, o, -x, -y, x, o], axis=-1).reshape(*x.shape, 3, 3)


def turn(v: Array) -> Array:
    """Return exp [v×] by its series: the angles here are far below one."""
    k = cross(v)
    kk = k @ k
    s = (v**2).sum(-1)[..., None, None]
    return np.eye(3) + (1 - s / 6 + s**2 / 120) * k + (0.5 - s / 24 + s**2 / 720) * kk


def small(mat: Array) -> Array:
    """Return the rotation vector of a small rotation."""
    v = 0.5 * np.stack(
        [mat[..., 2, 1] - mat[..., 1, 2], mat[..., 0, 2] - mat[..., 2, 0],
         mat[..., 1, 0] - mat[..., 0, 1]], axis=-1)  # fmt: skip
    size = np.linalg.norm(v, axis=-1, keepdims=True)
    return v * np.where(size > 1e-9, np.arcsin(np.minimum(size, 1)) / np.maximum(size, 1e-30), 1.0)


def kron(mat: Array, u: Array) -> Array:
    """Return CM kron(I₃, uᵀ), (..., 3, 9)."""
    return (mat[..., :, :, None] * u[..., None, None, :]).reshape(*mat.shape[:-2], 3, 9)


def gyro(
    made: Draw,
    states: int = 19,
    part: slice = slice(None),
    grade: Grade = T,
    table: Table = Table(),
    every: int = 10,
    coarse: int = 2000,
) -> Done:
    """Return bias and S of the gyros: 15, 19 or 28 states."""
    hz = 1 / (made.time[1] - made.time[0])
    trials = len(made.rates)
    n = states
    bias = made.rates[:, 500 : 500 + coarse].mean(1)  # the table at rest in its zero
    earth = EARTH * np.array([0, np.cos(table.latitude), np.sin(table.latitude)])
    bias = bias - earth
    s = np.zeros((trials, 3, 3))
    gm, late = np.zeros((trials, 3)), np.zeros(trials)
    by_g = np.zeros((trials, 3, 3))
    p = np.zeros((trials, n, n))
    sd = np.zeros(n)
    sd[:3], sd[3:6], sd[6:15] = 60 * ARCSEC, radians(1), 0.02
    if n >= 19:
        sd[15:18], sd[18] = grade.gyro_drift, 5e-3
    if n == 28:
        sd[19:] = radians(50) / 3600 / G
    p[:] = np.diag(sd**2)
    r = (10 if n == 15 else 4) * ARCSEC
    rates, forces, angles = (x[:, part] for x in (made.rates, made.forces, made.angles))
    c = attitude(angles[:, 0])
    dt = every / hz
    nis, count, history = np.zeros(trials), 0, []
    before = rates[:, 0]
    for k in range(1, rates.shape[1] - every + 1, every):
        m = np.linalg.inv(np.eye(3) + s)
        drive = np.zeros((trials, 3, n))
        for j in range(k, k + every):
            now = rates[:, j]
            mean = 0.5 * (before + now)
            f = 0.5 * (forces[:, part][:, j] + forces[:, j - 1]) if False else forces[:, j]
            wrong = bias + gm + (by_g @ f[..., None])[..., 0]
            w = (m @ (mean - wrong)[..., None])[..., 0]
            half = c @ turn(w / (2 * hz))
            cm = half @ m
            drive[:, :, 3:6] -= cm / hz
            drive[:, :, 6:15] -= kron(cm, w) / hz
            if n == 28:
                drive[:, :, 19:] -= kron(cm, f) / hz
            c = turn(-earth / hz) @ c @ turn(w / hz)
            before = now
        phi = np.zeros((trials, n, n))
        phi[:] = np.eye(n)
        phi[:, :3, :3] = np.eye(3) - cross(earth) * dt
        phi[:, :3, 3:] += drive[:, :, 3:]
        q = np.zeros((trials, n, n))
        q[:, :3, :3] = grade.arw**2 * dt * np.eye(3)
        if n >= 19:
            kept = np.exp(-dt / grade.correlation)
            phi[:, :3, 15:18] = drive[:, :, 3:6]
            phi[:, 15:18, 15:18] = kept * np.eye(3)
            gm = kept * gm
            q[:, 15:18, 15:18] = grade.gyro_drift**2 * (1 - kept**2) * np.eye(3)
        p = phi @ p @ phi.swapaxes(1, 2) + q
        h = np.zeros((trials, 3, n))
        h[:, :, :3] = np.eye(3)
        z = small(attitude(angles[:, k + every - 1]) @ c.swapaxes(1, 2))
        if n >= 19:
            # The readback is late: it says where the table was.
            last = (m @ (now - wrong)[..., None])[..., 0]
            h[:, :, 18] = -((c @ last[..., None])[..., 0] - earth)
            z = z - h[:, :, 18] * late[:, None]
        x, p, one = update(p, h, z, r**2 * np.eye(3))
        nis += one
        count += 3
        c = turn(x[:, :3]) @ c
        bias, s = bias + x[:, 3:6], s + x[:, 6:15].reshape(-1, 3, 3)
        if n >= 19:
            gm, late = gm + x[:, 15:18], late + x[:, 18]
        if n == 28:
            by_g = by_g + x[:, 19:].reshape(-1, 3, 3)
        history.append(np.concatenate([bias, s.reshape(-1, 9)], axis=1))
    theta = np.concatenate([bias, s.reshape(-1, 9)], axis=1)
    return Done(theta, p[:, 3:15, 3:15], nis / count, np.array(history))


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


def accelerometer(
    made: Draw,
    states: int = 25,
    holds: tuple[str, ...] = tuple(f"p{k + 1}" for k in range(10)),
    grade: Grade = T,
    table: Table = Table(),
    every: int = 10,
    gyros: Array | None = None,
) -> Done:
    """Return bias and S of the accelerometers: 18 or 25 states; `gyros` corrects the gyros."""
    hz = 1 / (made.time[1] - made.time[0])
    trials, n = len(made.rates), states
    earth = EARTH * np.array([0, np.cos(table.latitude), np.sin(table.latitude)])
    if gyros is None:
        gyros = np.zeros((trials, 12))
        gyros[:, :3] = made.rates[:, 500:2500].mean(1) - earth
    mg = np.linalg.inv(np.eye(3) + gyros[:, 3:].reshape(-1, 3, 3))
    g = np.array([0, 0, table.gravity])
    bias = made.forces[:, 500:2500].mean(1) - g
    s, gm, level, held = np.zeros((trials, 3, 3)), np.zeros((trials, 3)), np.zeros((trials, 2)), 0
    sd = np.zeros(n)
    sd[6:9], sd[9:18] = 30e-3 * G, 0.02
    if n == 25:
        sd[18:21], sd[21:23], sd[23:25] = grade.acc_drift, 10 * ARCSEC, 3.5 * ARCSEC
    p = np.zeros((trials, n, n))
    p[:] = np.diag(sd**2)
    dt = every / hz
    nis, count = np.zeros(trials), 0
    r = np.diag([1e-3**2] * 3 + [((1 if n == 25 else 10) * ARCSEC) ** 2] * 2)
    h = np.zeros((5, n))
    h[:3, :3], h[3:, 3:5] = np.eye(3), np.eye(2)
    if n == 25:
        h[3:, 21:23] = h[3:, 23:25] = -np.eye(2)
    last_time = 0.0
    for name in holds:
        at = np.flatnonzero(made.labels == name)
        c, v, held = attitude(made.angles[:, at[0]]), np.zeros((trials, 3)), np.zeros((trials, 2))
        # Between holds the drift goes on alone.
        fresh = [*range(6), *((23, 24) if n == 25 else ())]
        p[:, fresh, :] = p[:, :, fresh] = 0.0
        for k in range(3):
            p[:, k, k], p[:, 3 + k, 3 + k] = 1e-6, 5e-4**2
        if n == 25:
            p[:, 23, 23] = p[:, 24, 24] = sd[23] ** 2
            kept = np.exp(-(made.time[at[0]] - last_time) / grade.correlation)
            p[:, 18:21, :] *= kept
            p[:, :, 18:21] *= kept
            for k in range(18, 21):
                p[:, k, k] += grade.acc_drift**2 * (1 - kept**2)
            gm = gm * kept
        for k in range(1, len(at) - every + 1, every):
            m = np.linalg.inv(np.eye(3) + s)
            drive, push = np.zeros((trials, 3, n)), np.zeros((trials, 3))
            for j in at[k : k + every]:
                w = (
                    mg @ (0.5 * (made.rates[:, j] + made.rates[:, j - 1]) - gyros[:, :3])[..., None]
                )[..., 0]
                f = (
                    m @ (0.5 * (made.forces[:, j] + made.forces[:, j - 1]) - bias - gm)[..., None]
                )[..., 0]
                half = turn(-earth / (2 * hz)) @ c @ turn(w / (2 * hz))
                cm = half @ m
                drive[:, :, 6:9] += cm / hz
                drive[:, :, 9:18] += kron(cm, f) / hz
                push += ((half @ f[..., None])[..., 0] - g) / hz
                c = turn(-earth / hz) @ c @ turn(w / hz)
            v = v + push - 2 * np.cross(earth, v) * dt
            phi = np.zeros((trials, n, n))
            phi[:] = np.eye(n)
            phi[:, :3, :3] = np.eye(3) - 2 * cross(earth) * dt
            phi[:, :3, 3:6] = cross(g) * dt
            phi[:, :3, 6:] += drive[:, :, 6:]
            phi[:, 3:6, 3:6] = np.eye(3) - cross(earth) * dt
            q = np.zeros((trials, n, n))
            # Velocity noise, and what the turn's noise does to velocity within the update.
            q[:, :3, :3] = grade.vrw**2 * dt * np.eye(3)
            q[:, 3:6, 3:6] = grade.arw**2 * dt * np.eye(3)
            if n == 25:
                kept = np.exp(-dt / grade.correlation)
                phi[:, :3, 18:21] = drive[:, :, 6:9]
                phi[:, 18:21, 18:21] = kept * np.eye(3)
                gm = kept * gm
                q[:, 18:21, 18:21] = grade.acc_drift**2 * (1 - kept**2) * np.eye(3)
            p = phi @ p @ phi.swapaxes(1, 2) + q
            z = np.zeros((trials, 5))
            z[:, :3] = v
            z[:, 3:] = small(attitude(made.angles[:, at[k + every - 1]]) @ c.swapaxes(1, 2))[:, :2]
            if n == 25:
                z[:, 3:] += level + held
            x, p, one = update(p, h, z, r)
            nis += one
            count += 5
            v = v - x[:, :3]
            c = turn(x[:, 3:6]) @ c
            bias, s = bias + x[:, 6:9], s + x[:, 9:18].reshape(-1, 3, 3)
            if n == 25:
                gm, level, held = gm + x[:, 18:21], level + x[:, 21:23], held + x[:, 23:]
        last_time = made.time[at[-1]]
    theta = np.concatenate([bias, s.reshape(-1, 9)], axis=1)
    return Done(theta, p[:, 6:18, 6:18], nis / count, np.array([]))


def summary(done: Done, truth: Array, unit: float) -> tuple[float, float, float, float]:
    """Return rms of bias (in `unit`), scale in ppm, misalignment in ″, and NEES."""
    off = done.theta - truth
    diagonal = np.isin(np.arange(9), (0, 4, 8))
    rms = lambda x: float(np.sqrt(np.mean(x**2)))
    nees = np.einsum("ti,tij,tj->t", off, np.linalg.inv(done.covariance), off).mean() / 12
    return (
        rms(off[:, :3]) / unit,
        rms(off[:, 3:][:, diagonal]) / 1e-6,
        rms(off[:, 3:][:, ~diagonal]) / ARCSEC,
        float(nees),
    )
