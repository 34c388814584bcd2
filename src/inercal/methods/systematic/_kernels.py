"""Compiled: navigation through turns, with the sensitivities of attitude and velocity.

n is east, north, up; C takes the body to n. A sample is the mean of rate and force over one
period; with δ = ω dt and u = f dt of it and, primed, of the sample before::

    C ← exp(−ω_ie dt) C exp(δ + δ′ × δ/12)
    v ← v + C [u + ½ δ × u + ⅙ δ × (δ × u) + (δ′ × u + u′ × δ)/12] − (g e_up + 2 ω_ie × v) dt

The term of second order, ⅙, counts: without it a quarter turn of 10 °/s at 100 Hz ends at 44 µm/s.
With true C = exp(ψ) C, F = C f, and lag τ of the accelerometers, the sensitivities are::

    ψ̇_θ = −ω_ie × ψ_θ + C ∂ω/∂θ
    v̇_θ = −F × ψ_θ − 2 ω_ie × v_θ + C ∂f/∂θ,   ∂f/∂τ = f × ω_nb

and the covariance of (ψ, v) obeys the same equations. They are summed over blocks of samples.

Sources: Savage 2000, Strapdown Analytics, chapters 7 (integration) and 18 (errors at turns).
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from inercal.arrays import Array

Indices = NDArray[np.int64]


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _rotate_vector(c: Array, v: Array, out: Array) -> None:
    """Write C v."""
    for i in range(3):
        out[i] = c[i, 0] * v[0] + c[i, 1] * v[1] + c[i, 2] * v[2]


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _cross(a: Array, b: Array, out: Array) -> None:
    """Write a × b; `out` is neither."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@njit(cache=True, nogil=True, error_model="numpy")
def _rotation(v: Array, out: Array) -> None:
    """Write exp [v×]."""
    s = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    once, twice = 1 - s / 6 * (1 - s / 20), 0.5 - s / 24 * (1 - s / 30)
    if s > 1e-4:
        angle = np.sqrt(s)
        once, twice = np.sin(angle) / angle, (1 - np.cos(angle)) / s
    x, y, z = v[0], v[1], v[2]
    out[0, 0], out[1, 1], out[2, 2] = (
        1 - twice * (y * y + z * z),
        1 - twice * (x * x + z * z),
        1 - twice * (x * x + y * y),
    )
    out[0, 1], out[1, 0] = twice * x * y - once * z, twice * x * y + once * z
    out[0, 2], out[2, 0] = twice * x * z + once * y, twice * x * z - once * y
    out[1, 2], out[2, 1] = twice * y * z - once * x, twice * y * z + once * x


@njit(cache=True, nogil=True, error_model="numpy")
def _product(a: Array, b: Array, out: Array) -> None:
    """Write A B; `out` is neither."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@njit(cache=True, nogil=True, error_model="numpy")
def _propagate_covariance(p: Array, c: Array, force: Array, white: Array, seconds: float) -> None:
    """Add the white noise of a block of `seconds` to P of (ψ, v); `force` is ∫ F dt over it."""
    q = np.zeros((6, 6))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                q[i, j] += 0.5 * seconds * c[i, k] * white[3 + k] * c[j, k]
                q[3 + i, 3 + j] += 0.5 * seconds * c[i, k] * white[k] * c[j, k]
    a = np.eye(6)
    a[3, 1], a[3, 2], a[4, 2] = force[2], -force[1], force[0]
    a[4, 0], a[5, 0], a[5, 1] = -force[2], force[1], -force[0]
    p[:] = a @ (p + q) @ a.T + q


@njit(cache=True, nogil=True, error_model="numpy")
def integrate_turns(
    w: Array,
    f: Array,
    dw: Array,
    by_rate: Array,
    by_force: Array,
    first: Indices,
    last: Indices,
    block: int,
    dt: float,
    start: Array,
    chained: bool,
    earth: Array,
    gravity: float,
    lag: float,
    white: Array,
) -> tuple[Array, Array, Array, Array, Array, Array]:
    """Return what navigation through k turns ends at, with sensitivities and noise.

    Parameters
    ----------
    w, f, dw : (n, 3) arrays
        ω, f and dω/dt of the samples of all turns, one after the other, SI.
    by_rate, by_force : (b, 3, q) and (b, 3, r) arrays
        ∂ω/∂θ and ∂f/∂θ of each block of samples; each turn begins a block. None are needed of
        length 0.
    first, last : (k,) arrays of int
        Of each turn: its samples, the last one excluded.
    block : int
        Samples in a block; the last block of a turn may have fewer.
    dt : float
        s.
    start : (k, 3, 3) array
        C where each turn begins.
    chained : bool
        Whether each turn but the first begins where the one before ended instead.
    earth : (3,) array
        ω_ie in n, rad/s.
    gravity, lag : float
        m/s² and s.
    white : (6,) array
        Noise densities squared, of accelerometers and gyros in the body's axes, SI²/Hz.

    Returns
    -------
    attitude : (k, 3, 3) array
    velocity, impulse : (k, 3) arrays
        m/s; the integral of F.
    psi, v : (k, 3, q) and (k, 3, q + r + 1) arrays
        Sensitivities; of v those of the gyros, of the accelerometers, and of the lag.
    covariance : (k, 6, 6) array
        Of (ψ, v), by white noise.
    """
    turns, q, r = first.size, by_rate.shape[2], by_force.shape[2]
    blocks_wanted = by_rate.shape[0] > 0
    attitude, velocity = np.zeros((turns, 3, 3)), np.zeros((turns, 3))
    impulse, covariance = np.zeros((turns, 3)), np.zeros((turns, 6, 6))
    psi, v_by = np.zeros((turns, 3, q)), np.zeros((turns, 3, q + r + 1))
    c, middle, turned, small = np.eye(3), np.eye(3), np.eye(3), np.eye(3)
    back = np.eye(3)
    _rotation(-earth * dt, back)
    d, u, d0, u0 = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    a, b, e, rho, moved = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    own, force, lagging = np.zeros(3), np.zeros(3), np.zeros(3)
    at = 0
    for k in range(turns):
        if k == 0 or not chained:
            c[:] = start[k]
        else:
            c[:] = attitude[k - 1]
        v = velocity[k]
        count = last[k] - first[k]
        in_block, middle_at, seconds = 0, 0, 0.0
        for i in range(first[k], last[k]):
            if in_block == 0:
                middle_at = min(block, last[k] - i) // 2
                force[:] = 0.0
                lagging[:] = 0.0
                seconds = 0.0
            if in_block == middle_at:
                middle[:] = c
            # ω against n, and the force turned back by what the body turned in the lag
            for j in range(3):
                own[j] = w[i, j] - (c[0, j] * earth[0] + c[1, j] * earth[1] + c[2, j] * earth[2])
                rho[j] = own[j] * lag - 0.5 * lag * lag * dw[i, j]
                d[j] = w[i, j] * dt
            _cross(rho, f[i], a)
            _cross(rho, a, b)
            for j in range(3):
                e[j] = f[i, j] - a[j] + 0.5 * b[j]
                u[j] = e[j] * dt
            if i == first[k]:
                d0[:] = d
                u0[:] = u
            _cross(e, own, a)
            _rotate_vector(c, a, moved)
            for j in range(3):
                lagging[j] += moved[j] * dt
            _cross(d, u, a)
            _cross(d, a, b)
            for j in range(3):
                moved[j] = u[j] + 0.5 * a[j] + b[j] / 6
            _cross(d0, u, a)
            _cross(u0, d, b)
            for j in range(3):
                moved[j] += (a[j] + b[j]) / 12
            _rotate_vector(c, moved, e)
            # In the middle of the sample n has turned by half of ω_ie dt.
            _cross(earth, e, a)
            _cross(earth, v, b)
            for j in range(3):
                e[j] -= 0.5 * dt * a[j]
                force[j] += e[j]
                impulse[k, j] += e[j]
            for j in range(3):
                v[j] += e[j] - 2 * dt * b[j]
            v[2] -= gravity * dt
            _cross(d0, d, a)
            for j in range(3):
                rho[j] = d[j] + a[j] / 12
            _rotation(rho, small)
            _product(c, small, turned)
            _product(back, turned, c)
            d0[:] = d
            u0[:] = u
            in_block += 1
            seconds += dt
            if in_block == block or i == last[k] - 1:
                if blocks_wanted:
                    _add_block(
                        psi[k], v_by[k], by_rate[at], by_force[at], middle, force, lagging,
                        earth, seconds,
                    )  # fmt: skip
                    _propagate_covariance(covariance[k], middle, force, white, seconds)
                at += 1
                in_block = 0
        attitude[k] = c
        if count <= 0:
            attitude[k] = c
    return attitude, velocity, impulse, psi, v_by, covariance


@njit(cache=True, nogil=True, error_model="numpy")
def _add_block(
    psi: Array,
    v: Array,
    by_rate: Array,
    by_force: Array,
    c: Array,
    force: Array,
    lagging: Array,
    earth: Array,
    seconds: float,
) -> None:
    """Add a block to the sensitivities: C in its middle, ∫ F dt and ∫ C ∂f/∂τ dt over it."""
    q, r = by_rate.shape[1], by_force.shape[1]
    column, turned, half, out = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    for m in range(q + r + 1):
        for j in range(3):
            column[j] = v[j, m]
        _cross(earth, column, out)
        for j in range(3):
            v[j, m] -= 2 * seconds * out[j]
    for m in range(q):
        for j in range(3):
            column[j] = by_rate[j, m]
        _rotate_vector(c, column, turned)
        for j in range(3):
            column[j] = psi[j, m]
        _cross(earth, column, out)
        for j in range(3):
            half[j] = psi[j, m] + 0.5 * seconds * (turned[j] - out[j])
            psi[j, m] += seconds * (turned[j] - out[j])
        _cross(force, half, out)
        for j in range(3):
            v[j, m] -= out[j]
    for m in range(r):
        for j in range(3):
            column[j] = by_force[j, m]
        _rotate_vector(c, column, turned)
        for j in range(3):
            v[j, q + m] += seconds * turned[j]
    for j in range(3):
        v[j, q + r] += lagging[j]
