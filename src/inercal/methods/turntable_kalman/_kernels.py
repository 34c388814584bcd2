"""Compiled: strapdown and both filters, sample by sample; their dense oracle stands in the tests.

Level frame: east, north, up. C takes the body's frame to it, C_est = (I − [φ×]) C. Between samples
rates are linear, with the second-order term of coning (Miller 1983, J. Guidance 6(4), 287–291).
All state is in arrays that are changed in place, so that a recording may come in pieces.
"""
# Numba's decorator has no types.
# pyright: reportUntypedFunctionDecorator=false

import numpy as np
from numba import njit
from numpy.typing import NDArray

from inercal.estimate.kalman import predict, update

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
# Of a sample: (1, f, ω, six products of f), as in `terms`.
_FORCE, _RATE, _SQUARE = 1, 4, 7
BASIS = 13
# Where an acceleration begins or ends between two samples, a rate taken as linear makes an angle of
# a Δt² s (1 − s)/2 at the share s of the step: 0.09 a Δt² rms over s. Second differences of five
# standard deviations (25 × 6 variances of a sample) are taken for such.
_KINK, _BENT = 0.09, 150.0


@njit(cache=True, nogil=True, error_model="numpy")
def rotate(c: Array, v: Array) -> None:
    """Turn C by the rotation vector v of the body, in place: C ← C exp [v×]."""
    s = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    angle = np.sqrt(s)
    once = 1 - s / 6 + s * s / 120 if angle < 1e-2 else np.sin(angle) / angle
    twice = 0.5 - s / 24 + s * s / 720 if angle < 1e-2 else (1 - np.cos(angle)) / s
    for i in range(3):
        a, b, d = c[i, 0], c[i, 1], c[i, 2]
        # Rows of C times exp [v×]: a + once (a × v)ᵀ-wise + twice ((a × v) × v).
        e = b * v[2] - d * v[1]
        f = d * v[0] - a * v[2]
        g = a * v[1] - b * v[0]
        c[i, 0] = a + once * e + twice * (f * v[2] - g * v[1])
        c[i, 1] = b + once * f + twice * (g * v[0] - e * v[2])
        c[i, 2] = d + once * g + twice * (e * v[1] - f * v[0])


@njit(cache=True, nogil=True, error_model="numpy")
def turn_level(c: Array, v: Array) -> None:
    """Turn C by the rotation vector v of the level frame, in place: C ← exp [v×] C."""
    s = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    angle = np.sqrt(s)
    once = 1 - s / 6 + s * s / 120 if angle < 1e-2 else np.sin(angle) / angle
    twice = 0.5 - s / 24 + s * s / 720 if angle < 1e-2 else (1 - np.cos(angle)) / s
    for j in range(3):
        a, b, d = c[0, j], c[1, j], c[2, j]
        e = v[1] * d - v[2] * b
        f = v[2] * a - v[0] * d
        g = v[0] * b - v[1] * a
        c[0, j] = a + once * e + twice * (v[1] * g - v[2] * f)
        c[1, j] = b + once * f + twice * (v[2] * e - v[0] * g)
        c[2, j] = d + once * g + twice * (v[0] * f - v[1] * e)


@njit(cache=True, nogil=True, error_model="numpy")
def apart(ref: Array, c: Array, z: Array) -> None:
    """Write the rotation vector z of ref Cᵀ, in the level frame."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        up, down = 0.0, 0.0
        for m in range(3):
            up += ref[k, m] * c[j, m]
            down += ref[j, m] * c[k, m]
        z[i] = 0.5 * (up - down)
    trace = 0.0
    for i in range(3):
        for m in range(3):
            trace += ref[i, m] * c[i, m]
    sine = np.sqrt(z[0] * z[0] + z[1] * z[1] + z[2] * z[2])
    if sine > 1e-9:
        angle = np.arctan2(sine, 0.5 * (trace - 1))
        for i in range(3):
            z[i] *= angle / sine


@njit(cache=True, nogil=True, error_model="numpy")
def _invert(m: Array, out: Array) -> None:
    """Write the inverse of a 3 × 3 matrix."""
    for i in range(3):
        for j in range(3):
            a, b = (j + 1) % 3, (j + 2) % 3
            d, e = (i + 1) % 3, (i + 2) % 3
            out[i, j] = m[a, d] * m[b, e] - m[a, e] * m[b, d]
    det = m[0, 0] * out[0, 0] + m[0, 1] * out[1, 0] + m[0, 2] * out[2, 0]
    for i in range(3):
        for j in range(3):
            out[i, j] /= det


@njit(cache=True, nogil=True, error_model="numpy")
def matrix(nominal: Array, axis: Indices, weights: Array, c: Array, first: int, out: Array) -> None:
    """Write M = (N + S)⁻¹, S the part of the coefficients that is linear in u (φ from `first`)."""
    made = nominal.copy()
    for m in range(axis.size):
        for k in range(3):
            made[axis[m], k] += c[m] * weights[m, first + k]
    _invert(made, out)


@njit(cache=True, nogil=True, error_model="numpy")
def _fill(phi: Array, f: Array) -> None:
    """Write what depends on f into φ."""
    phi[0] = 1.0
    for k in range(3):
        phi[_FORCE + k] = f[k]
        phi[_SQUARE + k] = f[k] * f[k]
    phi[_SQUARE + 3], phi[_SQUARE + 4] = f[0] * f[1], f[0] * f[2]
    phi[_SQUARE + 5] = f[1] * f[2]


@njit(cache=True, nogil=True, error_model="numpy")
def _used(weights: Array) -> Indices:
    """Return which of φ a triad's coefficients take part of, 1 among them: biases drift."""
    return np.array([b for b in range(BASIS) if b == 0 or np.any(weights[:, b] != 0.0)])


@njit(cache=True, nogil=True, error_model="numpy")
def _sum_up(
    axis: Indices, weights: Array, c: Array, drift: Array, used: Indices, by: Array
) -> None:
    """Write what each of φ adds to the readings of the axes, (BASIS, 3), the drift with 1."""
    for b in used:
        for i in range(3):
            by[b, i] = drift[i] if b == 0 else 0.0
        for m in range(axis.size):
            by[b, axis[m]] += c[m] * weights[m, b]


@njit(cache=True, nogil=True, error_model="numpy")
def _correct(
    reading: Array, m: Array, by: Array, phi: Array, used: Indices, first: int, u: Array
) -> None:
    """Write u = M (reading − what is added beside the part linear in u, φ from `first`)."""
    u[:] = 0.0
    for j in range(3):
        left = reading[j]
        for b in used:
            if b < first or b >= first + 3:
                left -= by[b, j] * phi[b]
        for k in range(3):
            u[k] += m[k, j] * left


@njit(cache=True, nogil=True, error_model="numpy")
def _add_up(cm: Array, phi: Array, dt: float, used: Indices, made: Array) -> None:
    """Add C M φ dt, (BASIS, 3, 3)."""
    for b in used:
        size = phi[b] * dt
        for k in range(3):
            for j in range(3):
                made[b, k, j] += cm[k, j] * size


@njit(cache=True, nogil=True, error_model="numpy")
def _driven_by(
    made: Array, axis: Indices, weights: Array, used: Indices, sign: float, first: int, a: Array
) -> None:
    """Write the columns of coefficients, from `first` on, and of the drift; begin a new sum."""
    gm = first + axis.size
    for k in range(3):
        for s in range(axis.size):
            a[k, first + s] = 0.0
            for b in used:
                a[k, first + s] += sign * weights[s, b] * made[b, k, axis[s]]
        for j in range(3):
            a[k, gm + j] = sign * made[0, k, j]
    made[:] = 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def delayed(times: Array, past: Array, newest: int, when: float, out: Array, rate: Array) -> None:
    """Write the attitude at a time between kept ones, and the body's rate there in the level frame.

    Parameters
    ----------
    times, past : (k,) and (k, 3, 3) arrays
        Time and attitude of the last k samples, in a ring.
    newest : int
        Row of the last one.
    when : float
        s; beyond what is kept, and beyond the last one, the rate goes on.
    out : (3, 3) array
    rate : (3,) array
        rad/s.
    """
    k = times.size
    after, before = newest, (newest - 1) % k
    while times[before] > when and (before - 1) % k != newest:
        after, before = before, (before - 1) % k
    apart(past[after], past[before], rate)
    step, ahead = times[after] - times[before], when - times[before]
    turn = np.empty(3)
    for i in range(3):
        rate[i] = rate[i] / step if step > 0 else 0.0
        turn[i] = rate[i] * ahead
        for j in range(3):
            out[i, j] = past[before, i, j]
    turn_level(out, turn)


@njit(cache=True, nogil=True, error_model="numpy")
def gyros(
    time: Array,
    rates: Array,
    hold: Indices,
    epochs: Indices,
    behind: Array,
    reference: Array,
    beside: Array,
    nominal: Array,
    axis: Indices,
    weights: Array,
    earth: Array,
    gravity: float,
    noise: Array,
    drift: Array,
    correlation: float,
    variance: float,
    start: Array,
    late: Indices,
    realign: float,
    closed: bool,
    c: Array,
    theta: Array,
    x: Array,
    p: Array,
    made: Array,
    last: Array,
    times: Array,
    past: Array,
    history: Array,
) -> float:
    """Run the gyros' filter over a piece of a recording; return the sum of NIS.

    States: φ (3), p coefficients, drift of the biases (3), q of the table's parameters, of which
    the first two may be latency and clock.

    Parameters
    ----------
    time : (n,) array
    rates : (n, 3) array
        Readings, rad/s.
    hold : (n,) array of int
        Number of the hold that a sample belongs to; negative while the table moves.
    epochs : (e,) array
        Samples at which readback is taken in, ascending.
    behind : (e,) array
        How much older than the sample that readback is, s, by its stamp.
    reference : (e, 3, 3) array
        Attitude by readback.
    beside : (e, 3, q) array
        How φ as it is observed moves with the table's parameters, level frame.
    nominal, axis, weights
        Of `terms`.
    earth : (3,) array
        Its rate in the level frame.
    gravity : float
        m/s²; what the gyros feel of force is its reaction.
    noise : (3,) array
        Variance of each gyro's angle, rad²/s.
    drift : (3, 2) array
        Of each bias: variance of its drift, (rad/s)², and of its walk, (rad/s)²/s.
    correlation : float
        Time of the drift, s.
    variance : float
        Of the attitude by readback, rad².
    start : (4,) array
        Variance of φ at an alignment; the epoch's time before, the time origin of the clock, and
        whether an alignment is due.
    late : (3,) array
        Where latency, clock and azimuth stand among the states; -1 is not there.
    realign : float
        A step of time, s, beyond which the attitude is taken from readback anew.
    closed : bool
        Whether what is found is fed back.
    c, theta, x, p : arrays
        Attitude (3, 3), coefficients (p,), states (n,) and covariance (n, n): changed in place. The
        part of x that stands for φ and coefficients is fed back and kept zero.
    made : (BASIS, 3, 3) array
        Σ C M φ Δt since the epoch before, changed in place.
    last : (9,) array
        Time and rate of the sample before, its row in `past`, the rate of the one before that, and
        the variance of φ by kinks of the rate since the last epoch, rad²: changed in place.
    times, past : (k,) and (k, 3, 3) arrays
        Of `delayed`: what the readback, being late, is compared with. Changed in place.
    history : (e, 4 + 2 n) array
        Written at each epoch: innovations (3), NIS, the estimates (x with the coefficients
        in their place, φ zero) and their variances.
    """
    count, n = axis.size, x.size
    gm, used = 3 + count, _used(weights)
    m, phi, by = np.zeros((3, 3)), np.zeros(BASIS), np.zeros((BASIS, 3))
    squares, a = used[-1] >= _SQUARE, np.zeros((3, n))
    half, move, u, cm = np.zeros((3, 3)), np.zeros(3), np.zeros(3), np.zeros((3, 3))
    keep, drawn, driven = np.ones(n), np.zeros(n), np.zeros((3, 3))
    z, h, turn, fed = np.zeros(3), np.zeros((3, n)), np.zeros(3), np.zeros(3)
    moved, rate = np.zeros(3), np.zeros(3)
    matrix(nominal, axis, weights, theta, _RATE, m)
    _sum_up(axis, weights, theta, x[gm : gm + 3], used, by)
    phi[0] = 1.0
    total, e = 0.0, 0
    for i in range(time.size):
        dt = time[i] - last[0]
        if dt > realign:
            start[3] = 1.0
        for k in range(3):
            phi[_FORCE + k] = gravity * c[2, k]
            move[k] = 0.5 * (rates[i, k] + last[1 + k])
        if squares:
            _fill(phi, phi[_FORCE : _FORCE + 3])
        _correct(move, m, by, phi, used, _RATE, u)
        # The way within the step, against the level frame; half of it first.
        for k in range(3):
            around = 0.0
            for j in range(3):
                around += c[j, k] * earth[j]
            j1, j2 = (k + 1) % 3, (k + 2) % 3
            coning = last[1 + j1] * rates[i, j2] - last[1 + j2] * rates[i, j1]
            turn[k] = (u[k] - around) * dt + coning * dt * dt / 12
            fed[k] = 0.5 * turn[k]
            # At rest the earth's rate alone is felt. Readings would do as well but for their noise:
            # the angle's random walk is made of it, and scale factors would be found from the two.
            phi[_RATE + k] = around if hold[i] >= 0 else u[k]
        half[:] = c
        rotate(half, fed)
        rotate(c, turn)
        for k in range(3):
            for j in range(3):
                cm[k, j] = 0.0
                for b in range(3):
                    cm[k, j] += half[k, b] * m[b, j]
        _add_up(cm, phi, dt, used, made)
        last[0] = time[i]
        newest = (int(last[4]) + 1) % times.size
        last[4], times[newest] = newest, time[i]
        for k in range(3):
            bent = rates[i, k] - 2 * last[1 + k] + last[5 + k]
            if bent * bent * dt > _BENT * noise[k]:
                last[8] += (_KINK * bent * dt) ** 2
            last[5 + k], last[1 + k] = last[1 + k], rates[i, k]
            for j in range(3):
                past[newest, k, j] = c[k, j]
        if e == epochs.size or i != epochs[e]:
            continue
        since = time[i] - start[1]
        start[1] = time[i]
        kept = np.exp(-since / correlation)
        a[:] = 0.0
        _driven_by(made, axis, weights, used, -1.0, 3, a)
        for k in range(3):
            for j in range(3):
                a[k, j] = 1.0 if k == j else 0.0
                driven[k, j] = 0.0
                for b in range(3):
                    driven[k, j] += cm[k, b] * noise[b] * cm[j, b] * since
            driven[k, k] += last[8]
            keep[gm + k] = kept
            drawn[gm + k] = drift[k, 0] * (1 - kept * kept) + drift[k, 1] * since
            x[gm + k] *= kept
        last[8] = 0.0
        # −[ω_ie×] within an epoch.
        a[0, 1], a[0, 2], a[1, 2] = earth[2] * since, -earth[1] * since, earth[0] * since
        a[1, 0], a[2, 0], a[2, 1] = -a[0, 1], -a[0, 2], -a[1, 2]
        if late[2] >= 0:
            # The level frame is the table's: turned clockwise it sees the earth's rate go west.
            a[0, late[2]] = earth[1] * since
        if not closed:
            for k in range(3):
                moved[k] = x[k]
                for s in range(n):
                    moved[k] += (a[k, s] - (1.0 if s == k else 0.0)) * x[s]
            for k in range(3):
                x[k] = moved[k]
        predict(p, a, keep, driven, drawn)
        if start[3] > 0:
            # φ is lost, all else is kept; the readback is brought to the sample by the rate.
            start[3] = 0.0
            delay, fastest = behind[e], 0.0
            if late[0] >= 0:
                delay += x[late[0]]
            for k in range(3):
                turn[k] = phi[_RATE + k] * delay
                fastest += phi[_RATE + k] * phi[_RATE + k]
            c[:] = reference[e]
            rotate(c, turn)
            for k in range(3):
                p[k, :] = 0.0
                p[:, k] = 0.0
                p[k, k] = start[0] + (fastest * p[late[0], late[0]] if late[0] >= 0 else 0.0)
            times[:] = time[i]
            past[:] = c
            history[e, :4] = 0.0
        else:
            delay = 0.0
            if late[0] >= 0:
                delay += x[late[0]]
            if late[1] >= 0:
                delay += x[late[1]] * (time[i] - start[2])
            delayed(times, past, newest, time[i] - behind[e] - delay, half, rate)
            apart(reference[e], half, z)
            h[:] = 0.0
            for k in range(3):
                h[k, k] = 1.0
                for j in range(beside.shape[2]):
                    h[k, gm + 3 + j] = beside[e, k, j]
                if late[0] >= 0:
                    h[k, late[0]] = -rate[k]
                if late[1] >= 0:
                    h[k, late[1]] = -rate[k] * (time[i] - start[2])
                z[k] -= rate[k] * delay
                history[e, k] = z[k]
                for j in range(gm + 3, n):
                    history[e, k] -= h[k, j] * x[j]
            nis = 0.0
            for k in range(3):
                nis += update(x, p, h[k], z[k], variance)
            history[e, 3] = nis
            total += nis
            if closed:
                for k in range(3):
                    turn[k] = x[k]
                    x[k] = 0.0
                turn_level(c, turn)
                for row in range(times.size):
                    turn_level(past[row], turn)
                for s in range(count):
                    theta[s] += x[3 + s]
                    x[3 + s] = 0.0
                matrix(nominal, axis, weights, theta, _RATE, m)
        _sum_up(axis, weights, theta, x[gm : gm + 3], used, by)
        for s in range(n):
            history[e, 4 + s] = theta[s - 3] + x[s] if 3 <= s < gm else x[s]
            history[e, 4 + n + s] = p[s, s]
        e += 1
    return total


@njit(cache=True, nogil=True, error_model="numpy")
def accelerometers(
    time: Array,
    forces: Array,
    rates: Array,
    hold: Indices,
    epochs: Indices,
    reference: Array,
    beside: Array,
    nominal: Array,
    axis: Indices,
    weights: Array,
    earth: Array,
    gravity: float,
    noise: Array,
    turning: float,
    drift: Array,
    correlation: float,
    variance: Array,
    fresh: Array,
    held: Array,
    c: Array,
    theta: Array,
    x: Array,
    p: Array,
    made: Array,
    last: Array,
    history: Array,
) -> float:
    """Run the accelerometers' filter over a piece of a recording; return the sum of NIS.

    States: δV (3), φ (3), p coefficients, drift of the biases (3), q of the table's parameters,
    and, where there are two more, the error of each hold's angles about east and north.

    Parameters
    ----------
    time, epochs, reference, nominal, axis, weights, earth, gravity
        As of `gyros`.
    beside : (e, 2, q) array
        As of `gyros`, about east and north.
    forces, rates : (n, 3) arrays
        Readings of the accelerometers, and rates with coarse biases off, SI.
    hold
        As of `gyros`.
    noise : (3,) array
        Variance of each accelerometer's velocity, (m/s)²/s.
    turning : float
        Variance of the gyros' angles, rad²/s.
    drift, correlation
        As of `gyros`, (m/s²)².
    variance : (2,) array
        Of velocity, (m/s)², and of attitude by readback, rad².
    fresh : (2,) array
        Variances of δV and φ when a hold begins.
    held : (e, 2) array
        Variance of the error of a hold's angles about east and north, at its first epoch.
    c, theta, x, p, made, history
        As of `gyros`; history (e, 6 + 2 n) with the five observations.
    last : (12,) array
        Time, force, rate of the sample before; number of its hold, time of the epoch before, and
        velocity: changed in place.
    """
    count, n = axis.size, x.size
    gm, used = 6 + count, _used(weights)
    own = gm + 3 + beside.shape[2]  # where a hold's own error begins
    m, phi, by = np.zeros((3, 3)), np.zeros(BASIS), np.zeros((BASIS, 3))
    squares, a = used[-1] >= _SQUARE, np.zeros((6, n))
    half, move, u, cm = np.zeros((3, 3)), np.zeros(3), np.zeros(3), np.zeros((3, 3))
    keep, drawn, driven = np.ones(n), np.zeros(n), np.zeros((6, 6))
    z, h, turn, fed = np.zeros(5), np.zeros((5, n)), np.zeros(3), np.zeros(3)
    apart_by = np.zeros(3)
    for k in range(3):
        h[k, k] = 1.0
    for k in range(2):
        h[3 + k, 3 + k] = 1.0
        if own < n:
            h[3 + k, own + k] = -1.0
    matrix(nominal, axis, weights, theta, _FORCE, m)
    _sum_up(axis, weights, theta, x[gm : gm + 3], used, by)
    phi[0] = 1.0
    total, e = 0.0, 0
    for i in range(time.size):
        here = hold[i]
        at = e < epochs.size and i == epochs[e]
        begins = here >= 0 and here != int(last[7])
        dt = time[i] - last[0]
        if here >= 0 and not begins:
            for k in range(3):
                move[k] = 0.5 * (forces[i, k] + last[1 + k])
                u[k] = move[k]
            # What depends on f² takes f as corrected before.
            for _ in range(2 if squares else 1):
                _fill(phi, u)
                _correct(move, m, by, phi, used, _FORCE, u)
            _fill(phi, u)
            for k in range(3):
                around = 0.0
                for j in range(3):
                    around += c[j, k] * earth[j]
                turn[k] = (0.5 * (rates[i, k] + last[4 + k]) - around) * dt
                fed[k] = 0.5 * turn[k]
            half[:] = c
            rotate(half, fed)
            rotate(c, turn)
            for k in range(3):
                gain = -gravity if k == 2 else 0.0
                for j in range(3):
                    cm[k, j] = 0.0
                    gain += half[k, j] * u[j]
                    for b in range(3):
                        cm[k, j] += half[k, b] * m[b, j]
                last[9 + k] += gain * dt
            _add_up(cm, phi, dt, used, made)
        last[0] = time[i]
        for k in range(3):
            last[1 + k], last[4 + k] = forces[i, k], rates[i, k]
        if begins:
            last[7] = here
            since = time[i] - last[8]
            last[8] = time[i]
            kept = np.exp(-since / correlation)
            for k in range(3):
                s = gm + k
                x[s] *= kept
                p[s, :] *= kept
                p[:, s] *= kept
                p[s, s] += drift[k, 0] * (1 - kept * kept) + drift[k, 1] * since
            for s in range(n):
                if s < 6 or s >= own:
                    p[s, :] = 0.0
                    p[:, s] = 0.0
                    x[s] = 0.0
                    p[s, s] = fresh[0] if s < 3 else fresh[1] if s < 6 else held[e, s - own]
            last[9:] = 0.0
            made[:] = 0.0
            c[:] = reference[e]
        if not at:
            continue
        if begins:
            history[e, :6] = 0.0
        else:
            since = time[i] - last[8]
            last[8] = time[i]
            kept = np.exp(-since / correlation)
            driven[:] = 0.0
            a[:] = 0.0
            _driven_by(made, axis, weights, used, 1.0, 6, a)
            for k in range(3):
                a[k, k] = a[3 + k, 3 + k] = 1.0
                keep[gm + k] = kept
                drawn[gm + k] = drift[k, 0] * (1 - kept * kept) + drift[k, 1] * since
                x[gm + k] *= kept
                for j in range(3):
                    for b in range(3):
                        driven[k, j] += cm[k, b] * noise[b] * cm[j, b] * since
                driven[3 + k, 3 + k] = turning * since
            # −[ω_ie×] of φ, twice of δV, and (0, 0, g) × φ.
            w0, w1, w2 = earth[0] * since, earth[1] * since, earth[2] * since
            a[3, 4], a[3, 5], a[4, 5] = w2, -w1, w0
            a[4, 3], a[5, 3], a[5, 4] = -w2, w1, -w0
            a[0, 1], a[0, 2], a[1, 2] = 2 * w2, -2 * w1, 2 * w0
            a[1, 0], a[2, 0], a[2, 1] = -2 * w2, 2 * w1, -2 * w0
            a[0, 4], a[1, 3] = -gravity * since, gravity * since
            predict(p, a, keep, driven, drawn)
            apart(reference[e], c, apart_by)
            for k in range(2):
                for j in range(beside.shape[2]):
                    h[3 + k, gm + 3 + j] = beside[e, k, j]
            nis = 0.0
            for k in range(5):
                z[k] = last[9 + k] if k < 3 else apart_by[k - 3]
                history[e, k] = z[k]
                for j in range(gm + 3, n):
                    history[e, k] -= h[k, j] * x[j]
                nis += update(x, p, h[k], z[k], variance[0] if k < 3 else variance[1])
            history[e, 5] = nis
            total += nis
            for k in range(3):
                last[9 + k] -= x[k]
                turn[k] = x[3 + k]
                x[k] = x[3 + k] = 0.0
            turn_level(c, turn)
            for s in range(count):
                theta[s] += x[6 + s]
                x[6 + s] = 0.0
            matrix(nominal, axis, weights, theta, _FORCE, m)
        _sum_up(axis, weights, theta, x[gm : gm + 3], used, by)
        for s in range(n):
            history[e, 6 + s] = theta[s - 6] if 6 <= s < gm else x[s]
            history[e, 6 + n + s] = p[s, s]
        e += 1
    return total


@njit(cache=True, nogil=True)
def due(time: Array, period: float, last: float) -> Indices:
    """Return the samples at which an epoch is due: a period or more after the one before."""
    found = np.empty(time.size, np.int64)
    count = 0
    for i in range(time.size):
        if time[i] - last >= period:
            found[count] = i
            count += 1
            last = time[i]
    return found[:count]


@njit(cache=True, nogil=True)
def due_in_holds(time: Array, hold: Indices, period: float, last: float, number: int) -> Indices:
    """Do the same within holds: the first sample of each, then every period."""
    found = np.empty(time.size, np.int64)
    count = 0
    for i in range(time.size):
        if hold[i] < 0:
            continue
        if hold[i] != number or time[i] - last >= period:
            found[count] = i
            count += 1
            last, number = time[i], hold[i]
    return found[:count]
