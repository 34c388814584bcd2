"""Navigate through turns, with the sensitivities of attitude and velocity.

The frame n is east, north, up; C transforms from the body to n. A sample is the mean of rate and
force over one period, with δ = ω dt and u = f dt. A prime marks the sample before::

    C ← exp(−ω_ie dt) C exp(δ + δ′ × δ/12)
    v ← v + C [u + ½ δ × u + ⅙ δ × (δ × u) + (δ′ × u + u′ × δ)/12] − (g e_up + 2 ω_ie × v) dt

The second-order term, ⅙, is needed: without it a quarter turn of 10 °/s at 100 Hz ends with a
velocity error of 44 µm/s. With true C = exp(ψ) C, F = C f, and lag τ of the accelerometers, the
sensitivities are::

    ψ̇_θ = −ω_ie × ψ_θ + C ∂ω/∂θ
    v̇_θ = −F × ψ_θ − 2 ω_ie × v_θ + C ∂f/∂θ,   ∂f/∂τ = f × ω_nb

and the covariance of (ψ, v) obeys the same equations. The sensitivities are summed over blocks of
samples.

Functions write their results to arguments, in place, and allocate nothing, so they compile sooner.

Sources: Savage 2000, Strapdown Analytics, chapters 7 (integration) and 18 (errors at turns).
"""

from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.estimation.kernel_options import kernel, kernel_step
from inercal.methods.turntable.small_matrices import copy_matrix, product

VECTORS = 20  # number of work vectors
SAMPLE_VECTORS = 10  # number that `advance_sample` needs


class TurnMotion(NamedTuple):
    """The motion in successive samples, (n, 3) each, SI: ω, f and dω/dt."""

    w: Array
    f: Array
    dw: Array


class NavigationSettings(NamedTuple):
    """The assumptions of a navigation besides the motion."""

    earth: Array  # ω_ie in n, (3,) rad/s
    gravity: float  # m/s²
    lag: float  # s
    dt: float  # s, sampling interval


class Navigation(NamedTuple):
    """The navigation at the end of k turns; the gyros have q coefficients, the accelerometers r."""

    attitude: Array  # (k, 3, 3)
    velocity: Array  # (k, 3) m/s
    impulse: Array  # integral of F, (k, 3)
    psi: Array  # sensitivity of ψ, (k, 3, q)
    v: Array  # sensitivity of v to the gyros, the accelerometers and the lag, (k, 3, q + r + 1)
    covariance: Array  # of (ψ, v) due to white noise, (k, 6, 6)


@kernel_step
def apply_matrix(c: Array, v: Array, out: Array) -> None:
    """Write C v."""
    for i in range(3):
        out[i] = c[i, 0] * v[0] + c[i, 1] * v[1] + c[i, 2] * v[2]


@kernel_step
def cross(a: Array, b: Array, out: Array) -> None:
    """Write a × b; `out` must be neither of them."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@kernel_step
def copy_vector(v: Array, out: Array) -> None:
    """Copy a vector."""
    for i in range(3):
        out[i] = v[i]


@kernel_step
def write_rotation(x: float, y: float, z: float, out: Array) -> None:
    """Write the rotation exp [v×] for v = (x, y, z)."""
    s = x * x + y * y + z * z
    once, twice = 1 - s / 6 * (1 - s / 20), 0.5 - s / 24 * (1 - s / 30)
    if s > 1e-4:
        angle = np.sqrt(s)
        once, twice = np.sin(angle) / angle, (1 - np.cos(angle)) / s
    out[0, 0] = 1 - twice * (y * y + z * z)
    out[1, 1] = 1 - twice * (x * x + z * z)
    out[2, 2] = 1 - twice * (x * x + y * y)
    out[0, 1], out[1, 0] = twice * x * y - once * z, twice * x * y + once * z
    out[0, 2], out[2, 0] = twice * x * z + once * y, twice * x * z - once * y
    out[1, 2], out[2, 1] = twice * y * z - once * x, twice * y * z + once * x


@kernel_step
def advance_sample(
    motion: TurnMotion,
    i: int,
    c: Array,
    v: Array,
    settings: NavigationSettings,
    begins: bool,
    work: Array,
    gained: Array,
    lagging: Array,
    turned: Array,
) -> None:
    """Propagate C and v over sample i; write the velocity gained and its sensitivity to the lag.

    The first two rows of `work`, (SAMPLE_VECTORS, 3), contain the increments of the sample before,
    or of this sample if the motion begins here. `turned`, (2, 3, 3), is a work array.
    """
    w, f, dw = motion.w[i], motion.f[i], motion.dw[i]
    earth, gravity, lag, dt = settings
    d0, u0, d, u, own = work[0], work[1], work[2], work[3], work[4]
    a, b, e, rho, moved = work[5], work[6], work[7], work[8], work[9]
    # ω relative to n, and the force rotated back by the rotation of the body during the lag
    for j in range(3):
        own[j] = w[j] - (c[0, j] * earth[0] + c[1, j] * earth[1] + c[2, j] * earth[2])
        rho[j] = own[j] * lag - 0.5 * lag * lag * dw[j]
        d[j] = w[j] * dt
    cross(rho, f, a)
    cross(rho, a, b)
    for j in range(3):
        e[j] = f[j] - a[j] + 0.5 * b[j]
        u[j] = e[j] * dt
    if begins:
        copy_vector(d, d0)
        copy_vector(u, u0)
    cross(e, own, a)
    apply_matrix(c, a, moved)
    for j in range(3):
        lagging[j] = moved[j] * dt
    cross(d, u, a)
    cross(d, a, b)
    for j in range(3):
        moved[j] = u[j] + 0.5 * a[j] + b[j] / 6
    cross(d0, u, a)
    cross(u0, d, b)
    for j in range(3):
        moved[j] += (a[j] + b[j]) / 12
    apply_matrix(c, moved, e)
    # At the middle of the sample n has turned by half of ω_ie dt.
    cross(earth, e, a)
    cross(earth, v, b)
    for j in range(3):
        gained[j] = e[j] - 0.5 * dt * a[j]
        v[j] += gained[j] - 2 * dt * b[j]
    v[2] -= gravity * dt
    cross(d0, d, a)
    write_rotation(d[0] + a[0] / 12, d[1] + a[1] / 12, d[2] + a[2] / 12, turned[0])
    product(c, turned[0], turned[1])
    write_rotation(-earth[0] * dt, -earth[1] * dt, -earth[2] * dt, turned[0])
    product(turned[0], turned[1], c)
    copy_vector(d, d0)
    copy_vector(u, u0)


@kernel_step
def add_white_noise(p: Array, c: Array, white: Array, seconds: float) -> None:
    """Add half of a block's white noise to P of (ψ, v)."""
    for i in range(3):
        for j in range(3):
            rate, force = 0.0, 0.0
            for k in range(3):
                rate += c[i, k] * white[3 + k] * c[j, k]
                force += c[i, k] * white[k] * c[j, k]
            p[i, j] += 0.5 * seconds * rate
            p[3 + i, 3 + j] += 0.5 * seconds * force


@kernel_step
def _turn_velocity(p: Array, force: Array, work: Array) -> None:
    """Propagate P of (ψ, v) by v ← v − ∫F dt × ψ."""
    for j in range(6):  # rows
        for i in range(3):
            work[0, i] = p[i, j]
        cross(force, work[0], work[1])
        for i in range(3):
            p[3 + i, j] -= work[1, i]
    for i in range(6):  # columns
        for j in range(3):
            work[0, j] = p[i, j]
        cross(force, work[0], work[1])
        for j in range(3):
            p[i, 3 + j] -= work[1, j]


@kernel_step
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
    work: Array,
) -> None:
    """Add a block to the sensitivities, given C at its middle, and ∫ F dt and ∫ C ∂f/∂τ dt."""
    q, r = by_rate.shape[1], by_force.shape[1]
    column, turned, out = work[0], work[1], work[2]
    for m in range(q + r + 1):
        for j in range(3):
            column[j] = v[j, m]
        cross(earth, column, out)
        for j in range(3):
            v[j, m] -= 2 * seconds * out[j]
    for m in range(q):
        for j in range(3):
            column[j] = by_rate[j, m]
        apply_matrix(c, column, turned)
        for j in range(3):
            column[j] = psi[j, m]
        cross(earth, column, out)
        for j in range(3):
            column[j] += 0.5 * seconds * (turned[j] - out[j])
            psi[j, m] += seconds * (turned[j] - out[j])
        cross(force, column, out)
        for j in range(3):
            v[j, m] -= out[j]
    for m in range(r):
        for j in range(3):
            column[j] = by_force[j, m]
        apply_matrix(c, column, turned)
        for j in range(3):
            v[j, q + m] += seconds * turned[j]
    for j in range(3):
        v[j, q + r] += lagging[j]


@kernel
def integrate_turns(
    motion: TurnMotion,
    by_rate: Array,
    by_force: Array,
    first: Indices,
    last: Indices,
    block: int,
    start: Array,
    chained: bool,
    settings: NavigationSettings,
    white: Array,
    vectors: Array,
    matrices: Array,
    done: Navigation,
) -> None:
    """Write the final navigation after k turns, with sensitivities and noise.

    Parameters
    ----------
    motion : TurnMotion
        The samples of all turns, one after the other.
    by_rate, by_force : (b, 3, q) and (b, 3, r) arrays
        ∂ω/∂θ and ∂f/∂θ in each block of samples; each turn begins a new block. If b is 0 there are
        no sensitivities and no covariance.
    first, last : (k,) arrays of int
        First sample of each turn, and the sample after its last one.
    block : int
        Number of samples in a block; the last block of a turn may have fewer.
    start : (k, 3, 3) array
        C at the start of each turn.
    chained : bool
        Whether each turn after the first starts at the end of the previous turn instead.
    settings : NavigationSettings
    white : (6,) array
        Squared noise densities of accelerometers and gyros in the body axes, SI²/Hz.
    vectors, matrices : (VECTORS, 3) and (4, 3, 3) arrays
        Work arrays.
    done : Navigation
        Output; all but the attitude must be zero at the start.
    """
    c, middle, turned, attitude = matrices[0], matrices[1], matrices[2:4], done.attitude
    earth, dt = settings.earth, settings.dt
    state, e, moved = vectors[:SAMPLE_VECTORS], vectors[SAMPLE_VECTORS], vectors[SAMPLE_VECTORS + 1]
    force, lagging, work = vectors[12], vectors[13], vectors[14:18]
    at = 0
    for k in range(first.size):
        copy_matrix(attitude[k - 1] if chained and k > 0 else start[k], c)
        v = done.velocity[k]
        in_block, count, seconds = 0, 0, 0.0
        for i in range(first[k], last[k]):
            if in_block == 0:
                count, seconds = min(block, last[k] - i), 0.0
                for j in range(3):
                    force[j], lagging[j] = 0.0, 0.0
            if in_block == count // 2:
                copy_matrix(c, middle)
            advance_sample(motion, i, c, v, settings, i == first[k], state, e, moved, turned)
            for j in range(3):
                force[j] += e[j]
                done.impulse[k, j] += e[j]
                lagging[j] += moved[j]
            if count % 2 and in_block == count // 2:  # the block's middle is inside a sample
                for m in range(3):
                    for j in range(3):
                        middle[m, j] = 0.5 * (middle[m, j] + c[m, j])
            in_block += 1
            seconds += dt
            if in_block == block or i == last[k] - 1:
                if by_rate.shape[0] > 0:
                    _add_block(
                        done.psi[k], done.v[k], by_rate[at], by_force[at], middle, force, lagging,
                        earth, seconds, work,
                    )  # fmt: skip
                    add_white_noise(done.covariance[k], middle, white, seconds)
                    _turn_velocity(done.covariance[k], force, work)
                    add_white_noise(done.covariance[k], middle, white, seconds)
                at += 1
                in_block = 0
        copy_matrix(c, attitude[k])
