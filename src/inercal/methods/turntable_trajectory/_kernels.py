"""Propagate the attitude between readbacks, and whiten the differences.

The level frame and signs are those of `inercal.methods.turntable.strapdown`.

A rate is curved between samples, so the angle of a step is computed from a parabola instead of a
trapezoid. A trapezoid misses −Δt² (α₁ − α₀)/12 of an angle while the acceleration α is not zero.
The errors at the start and end of a turn are equal with opposite signs, which acts like a scale
factor. With the second derivative ω″ at the middle of a step the angle to a fraction x of it is, up
to terms with Δt⁴ ω‴::

    Δt (ω₀ x + (ω₁ − ω₀) x²/2 − ω″ Δt² (x²/4 − x³/6))

ω″ is the mean over two parabolas: through the step and the sample before it, and through the step
and the sample after it.

A reading counts once in the sum of all steps, but it is divided between two neighbouring increments
if an epoch ends between them. With u = x (1 − x) their covariance is γ(u) σ² (`neighbour_share`),
where σ² is the variance of a sample's angle. A random walk that is observed with noise of the
variance −γ σ² has the same covariance, so filters use such noise to account for it.
"""

# Numba's decorator has no type annotations.
# pyright: reportUntypedFunctionDecorator=false
import numpy as np

from inercal.basics.arrays import Array, Bools
from inercal.estimation.kalman import predict
from inercal.estimation.kernel_options import kernel_step, njit
from inercal.methods.turntable import RATE, SQUARE, TEMPERATURE, Terms
from inercal.methods.turntable.drift import Drift
from inercal.methods.turntable.drift_propagation import add_drift_cross_covariance, propagate_drift
from inercal.methods.turntable.small_matrices import copy_matrix, product
from inercal.methods.turntable.strapdown import (
    MAX_STEP_RATIO,
    PARABOLA_ERROR,
    PARABOLA_THRESHOLD,
    fill_force_terms,
    fill_temperature_terms,
    inverse_scale_matrix,
    rotate,
    rotation_error,
)


def rate_bends(time: Array, rates: Array, white: Array) -> tuple[Array, Array]:
    """Return ω″ in each step, and the variance of the step's angle due to sudden accelerations.

    Parameters
    ----------
    time : (n,) array
        Time of each sample, s.
    rates : (n, 3) array
        Readings, rad/s.
    white : (3,) array
        Variance of the integrated noise of each gyro, rad²/s.

    Returns
    -------
    bends : (n, 3) array
        ω″, rad/s³, for the step that ends at each sample; zero if steps are too unequal.
    kinks : (n,) array
        Variance due to sudden accelerations, rad², for each of the three angles.
    """
    step = np.diff(time, prepend=time[0])[:, None]
    # For the parabola through each sample and the two before it
    own, known = np.zeros_like(rates), np.zeros(step.shape, dtype=bool)
    last, before = step[2:], step[1:-1]
    known[2:] = (before > 0) & (last <= MAX_STEP_RATIO * before) & (before <= MAX_STEP_RATIO * last)
    slope = np.diff(rates, axis=0) / np.where(step[1:] > 0, step[1:], np.inf)
    own[2:] = np.where(known[2:], 2 * np.diff(slope, axis=0) / np.maximum(last + before, 1e-9), 0.0)
    after, both = np.zeros_like(own), np.zeros_like(known)
    after[:-1], both[:-1] = own[1:], known[1:]
    count = known.astype(np.int64) + both
    third = np.where(count == 2, (after - own) * step**2, 0.0)
    three = np.pad(third, ((2, 0), (0, 0)))
    squares, total = (x[:-2] + x[1:-1] + x[2:] for x in (three**2, three))
    sudden = squares * step > PARABOLA_THRESHOLD * white
    jumps = np.where(sudden, np.maximum(squares - 2 * total**2, 0.0), 0.0)
    kinks = np.sum(jumps * (PARABOLA_ERROR * step) ** 2, axis=1)
    return (own + after) / np.maximum(count, 1), kinks


@kernel_step
def neighbour_share(x: float) -> float:
    """Return γ, the covariance of increments that meet at x, relative to a sample's variance."""
    u = x * (1 - x)
    return 47 / 288 + u * u * (u / 36 - 5 / 16)


@njit(cache=True, nogil=True, error_model="numpy")
def increments(
    time: Array,
    rates: Array,
    bends: Array,
    kinks: Array,
    when: Array,
    reference: Array,
    terms: Terms,
    theta: Array,
    earth: Array,
    gravity: float,
    noise: Array,
    warmth: Array,
    apart_by: Array,
    columns: Array,
    drifting: Array,
    driven: Array,
    shared: Array,
) -> None:
    """Propagate the table's attitude from each readback to the next, and write the differences.

    Parameters
    ----------
    time : (n,) array
    rates : (n, 3) array
        Readings, rad/s.
    bends, kinks : (n, 3) and (n,) arrays
        As returned by `rate_bends`.
    when : (e + 1,) array
        Times of the readbacks by the sensor's clock, ascending, within the range of the samples.
    reference : (e + 1, 3, 3) array
        Attitude from the readback at these times.
    terms : Terms
    theta : (p,) array
        Coefficients.
    earth : (3,) array
        Earth's rate in the level frame, rad/s.
    gravity : float
        Local gravity, m/s².
    noise : (3,) array
        Variance of each gyro's angle, rad²/s.
    warmth : (n,) array
        ΔT, K; (0,) if the sensor does not depend on it.
    apart_by : (e, 3) array
        Output: the rotation from the gyros' to the readback's attitude, level frame, rad.
    columns, drifting : (e, 3, p) and (e, 3, 3) arrays
        Output: sensitivity of this rotation to coefficients and biases.
    driven : (e, 3, 3) array
        Output: covariance of this rotation due to the gyros' noise, rad².
    shared : (e + 1, 3, 3) array
        Output: covariance of the two increments that meet at each readback, rad².
    """
    axis, weights = terms.axis, terms.weights
    count, size_of_phi, warmed = axis.size, weights.shape[1], warmth.size > 0
    m, phi, wrong, c = np.zeros((3, 3)), np.zeros(size_of_phi), np.zeros(3), np.zeros((3, 3))
    half, move, u, cm = np.zeros((3, 3)), np.zeros(3), np.zeros(3), np.zeros((3, 3))
    turn, fed, work = np.zeros(3), np.zeros(3), np.zeros((3, 3))
    inverse_scale_matrix(terms, theta, 0.0, work, m)
    columns[:], drifting[:], driven[:], shared[:] = 0.0, 0.0, 0.0, 0.0
    i = 1
    while i < time.size - 1 and time[i] <= when[0]:
        i += 1
    for e in range(when.size - 1):
        copy_matrix(reference[e], c)
        now, stop = when[e], when[e + 1]
        while now < stop:
            step = time[i] - time[i - 1]
            until = min(time[i], stop)
            dt, first, last = until - now, (now - time[i - 1]) / step, (until - time[i - 1]) / step
            middle, part = 0.5 * (first + last), last - first
            # The mean of x (1 − x)/2 from the first to the last fraction x of the step
            bend = middle * (1 - middle) / 2 * step * step - part * dt * step / 24
            cone = part * dt * dt / 12
            fill_force_terms(phi, (gravity * c[2, 0], gravity * c[2, 1], gravity * c[2, 2]))
            if warmed:
                fill_temperature_terms(phi, warmth[i])
                inverse_scale_matrix(terms, theta, warmth[i], work, m)
            for k in range(3):
                move[k] = (
                    rates[i - 1, k] + middle * (rates[i, k] - rates[i - 1, k]) - bend * bends[i, k]
                )
                wrong[k] = 0.0
            for s in range(count):
                for b in range(size_of_phi):
                    linear = b - TEMPERATURE if b >= TEMPERATURE else b
                    if linear < RATE or linear >= SQUARE:
                        wrong[axis[s]] += theta[s] * weights[s, b] * phi[b]
            for k in range(3):
                u[k] = 0.0
                for j in range(3):
                    u[k] += m[k, j] * (move[j] - wrong[j])
                phi[RATE + k] = u[k]
                if warmed:
                    phi[TEMPERATURE + RATE + k] = warmth[i] * u[k]
            for k in range(3):
                around = 0.0
                for j in range(3):
                    around += c[j, k] * earth[j]
                j1, j2 = (k + 1) % 3, (k + 2) % 3
                coning = rates[i - 1, j1] * rates[i, j2] - rates[i - 1, j2] * rates[i, j1]
                turn[k] = (u[k] - around) * dt + coning * cone
                fed[k] = 0.5 * turn[k]
            copy_matrix(c, half)
            rotate(half, fed)
            rotate(c, turn)
            product(half, m, cm)
            for s in range(count):
                size = 0.0
                for b in range(size_of_phi):
                    size += weights[s, b] * phi[b]
                for k in range(3):
                    columns[e, k, s] -= cm[k, axis[s]] * size * dt
            for k in range(3):
                for j in range(3):
                    drifting[e, k, j] -= cm[k, j] * dt
                    for b in range(3):
                        driven[e, k, j] += cm[k, b] * noise[b] * cm[j, b] * dt
                driven[e, k, k] += kinks[i] * part
            now = until
            if until == stop:
                size = neighbour_share(last) * step
                for k in range(3):
                    for j in range(3):
                        for b in range(3):
                            shared[e + 1, k, j] += cm[k, b] * noise[b] * cm[j, b] * size
            if until == time[i] and i < time.size - 1:
                i += 1
        rotation_error(reference[e + 1], c, apart_by[e])
    copy_matrix(shared[1], shared[0])


@njit(cache=True, nogil=True, error_model="numpy")
def _copy_rows(rows: Array, out: Array) -> None:
    """Copy rows to the first rows of `out`, number by number as `copy_matrix` does."""
    for k in range(rows.shape[0]):
        for j in range(rows.shape[1]):
            out[k, j] = rows[k, j]


@kernel_step
def _scale_rows(x: Array, size: Array) -> None:
    """Multiply each row of x by its own factor."""
    for i in range(x.shape[0]):
        if size[i] != 1.0:
            for m in range(x.shape[1]):
                x[i, m] *= size[i]


@njit(cache=True, nogil=True, error_model="numpy")
def whiten(
    since: Array,
    rows: Array,
    drifting: Array,
    driven: Array,
    readback: Array,
    drift: Drift,
    start: Array,
    earth: Array,
    lost: Bools,
) -> tuple[Array, Array]:
    """Whiten sums of increments with readback noise, a random walk of φ and drift, in place.

    With φ_k+1 = E φ_k + D_k γ + w and z_k = φ_k − v_k, a Kalman filter estimates φ and the drift γ.
    Its innovations, each divided by the square root of its covariance, are independent. The same
    filter whitens the columns of the Jacobian (Kailath 1968, IEEE TAC 13, 646–655).

    Parameters
    ----------
    since : (e,) array
        Duration of each increment, s.
    rows : (e, 3, m) array
        Increments of the residual and of the columns, rad; replaced by whitened ones.
    drifting, driven : (e, 3, 3) arrays
        The same as for `increments`.
    readback : (e + 1, 3, 3) array
        Covariance of the attitude from the readback, minus the covariance that neighbouring
        increments share (`rate_bends`), rad².
    drift : Drift
        Drift of the biases, with s states.
    start : (s, s) array
        Covariance of the drift states at the start.
    earth : (3,) array
        Earth's rate, rad/s.
    lost : (e,) array of bool
        Whether each increment contains a gap, after which the attitude is initialised again.

    Returns
    -------
    x : (s, m) array
        Final states of the drift, for the residual and for the columns.
    p : (s, s) array
        Their covariance.
    """
    m, components = rows.shape[2], drift.times.size
    n = 3 + len(start)
    total, x, before = np.zeros((3, m)), np.zeros((n, m)), np.zeros((3, m))
    p, a, keep, drawn = np.zeros((n, n)), np.zeros((3, n)), np.ones(n), np.zeros(n)
    joint, root, gain = np.zeros((components, 3)), np.zeros((3, 3)), np.zeros((n, 3))
    moved = np.zeros((3, n))
    p[3:, 3:] = start
    for k in range(3):
        a[k, k] = 1.0
    copy_matrix(readback[0], p[:3, :3])
    for e in range(since.size):
        dt = since[e]
        for k in range(3):
            for c in range(components):
                for j in range(3):
                    a[k, 3 + 3 * c + j] = drifting[e, k, j]
        # −[ω_ie×] for φ.
        a[0, 1], a[0, 2], a[1, 2] = earth[2] * dt, -earth[1] * dt, earth[0] * dt
        a[1, 0], a[2, 0], a[2, 1] = -a[0, 1], -a[0, 2], -a[1, 2]
        np.dot(a, x, before)
        _copy_rows(before, x)
        propagate_drift(drift, dt, 3, keep, drawn, joint)
        _scale_rows(x, keep)
        predict(p, a, keep, driven[e], drawn, moved)
        add_drift_cross_covariance(drift, 3, joint, p)
        if lost[e]:
            # φ is initialised again; the drift continues.
            total[:], x[:3], rows[e] = 0.0, 0.0, 0.0
            p[:3, :], p[:, :3] = 0.0, 0.0
            copy_matrix(readback[e + 1], p[:3, :3])
            continue
        _copy_rows(total, before)
        for k in range(3):
            for c in range(m):
                total[k, c] = rows[e, k, c]
                for j in range(3):
                    total[k, c] += a[k, j] * before[j, c]
        s: Array = p[:3, :3] + readback[e + 1]
        inverse: Array = np.linalg.inv(np.linalg.cholesky(s)).astype(np.float64)
        copy_matrix(inverse, root)
        off = total - x[:3]
        np.dot(root, off, rows[e])
        np.dot(np.ascontiguousarray(p[:, :3]), root.T @ root, gain)
        x += gain @ off
        top = p[:3].copy()
        p -= gain @ top
        for k in range(n):
            for j in range(k):
                p[j, k] = p[k, j]
    return x[3:].copy(), p[3:, 3:].copy()


@njit(cache=True, nogil=True, error_model="numpy")
def whiten_independent_axes(
    time: Array, rows: Array, white: Array, drift: Drift, start: Array, begun: float
) -> tuple[Array, Array]:
    """Whiten means from axes that drift independently, in place.

    Parameters
    ----------
    time : (e,) array
        Midpoint of each mean, s.
    rows : (e, 3, m) array
        Residual and columns; replaced by whitened ones.
    white : (e, 3) array
        Variance of the noise in each mean.
    drift, start
        The same as for `whiten`.
    begun : float
        Start of the run, s.

    Returns
    -------
    x, p
        The same as for `whiten`, after the last mean.
    """
    components, m, n = drift.times.size, rows.shape[2], len(start)
    x, p = np.zeros((n, m)), start.copy()
    keep, drawn, joint = np.ones(n), np.zeros(n), np.zeros((components, 3))
    a, driven, moved = np.zeros((0, n)), np.zeros((0, 0)), np.zeros((0, n))
    ph, last, off = np.zeros(n), begun, np.zeros(m)
    for e in range(time.size):
        propagate_drift(drift, time[e] - last, 0, keep, drawn, joint)
        _scale_rows(x, keep)
        predict(p, a, keep, driven, drawn, moved)
        add_drift_cross_covariance(drift, 0, joint, p)
        last = time[e]
        for k in range(3):
            ph[:] = 0.0
            for q in range(m):
                off[q] = rows[e, k, q]
            s = white[e, k]
            for c in range(components):
                ph += p[3 * c + k]
                off -= x[3 * c + k]
            for c in range(components):
                s += ph[3 * c + k]
            for q in range(m):
                rows[e, k, q] = off[q] / np.sqrt(s)
            for i in range(n):
                if ph[i] != 0.0:
                    for q in range(m):
                        x[i, q] += ph[i] / s * off[q]
                    for j in range(n):
                        p[i, j] -= ph[i] * ph[j] / s
    return x, p
