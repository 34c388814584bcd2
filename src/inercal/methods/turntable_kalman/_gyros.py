"""Compiled: the gyros' filter, sample by sample; its dense oracle stands in the tests.

Between samples rates are linear, with the second-order term of coning (Miller 1983, J. Guidance
6(4), 287–291). All state is in arrays that are changed in place, so that a recording may come in
pieces.
"""
# Numba's decorator has no types.
# pyright: reportUntypedFunctionDecorator=false

import numpy as np
from numba import njit
from numpy.typing import NDArray

from inercal.estimate.kalman import predict, update
from inercal.methods.turntable.strapdown import (
    BENT,
    KINK,
    add_up,
    apart,
    correct,
    delayed,
    driven_by,
    fill,
    matrix,
    rotate,
    sum_up,
    taken,
    turn_level,
)
from inercal.methods.turntable.terms import BASIS, FORCE, RATE, SQUARE

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


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
    gm, used = 3 + count, taken(weights)
    m, phi, by = np.zeros((3, 3)), np.zeros(BASIS), np.zeros((BASIS, 3))
    squares, a = used[-1] >= SQUARE, np.zeros((3, n))
    half, move, u, cm = np.zeros((3, 3)), np.zeros(3), np.zeros(3), np.zeros((3, 3))
    keep, drawn, driven = np.ones(n), np.zeros(n), np.zeros((3, 3))
    z, h, turn, fed = np.zeros(3), np.zeros((3, n)), np.zeros(3), np.zeros(3)
    moved, rate = np.zeros(3), np.zeros(3)
    matrix(nominal, axis, weights, theta, RATE, m)
    sum_up(axis, weights, theta, x[gm : gm + 3], used, by)
    phi[0] = 1.0
    total, e = 0.0, 0
    for i in range(time.size):
        dt = time[i] - last[0]
        if dt > realign:
            start[3] = 1.0
        for k in range(3):
            phi[FORCE + k] = gravity * c[2, k]
            move[k] = 0.5 * (rates[i, k] + last[1 + k])
        if squares:
            fill(phi, phi[FORCE : FORCE + 3])
        correct(move, m, by, phi, used, RATE, u)
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
            phi[RATE + k] = around if hold[i] >= 0 else u[k]
        half[:] = c
        rotate(half, fed)
        rotate(c, turn)
        for k in range(3):
            for j in range(3):
                cm[k, j] = 0.0
                for b in range(3):
                    cm[k, j] += half[k, b] * m[b, j]
        add_up(cm, phi, dt, used, made)
        last[0] = time[i]
        newest = (int(last[4]) + 1) % times.size
        last[4], times[newest] = newest, time[i]
        for k in range(3):
            bent = rates[i, k] - 2 * last[1 + k] + last[5 + k]
            if bent * bent * dt > BENT * noise[k]:
                last[8] += (KINK * bent * dt) ** 2
            last[5 + k], last[1 + k] = last[1 + k], rates[i, k]
            for j in range(3):
                past[newest, k, j] = c[k, j]
        if e == epochs.size or i != epochs[e]:
            continue
        since = time[i] - start[1]
        start[1] = time[i]
        kept = np.exp(-since / correlation)
        a[:] = 0.0
        driven_by(made, axis, weights, used, -1.0, 3, a)
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
                turn[k] = phi[RATE + k] * delay
                fastest += phi[RATE + k] * phi[RATE + k]
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
                # φ as it was then: what drove it since is taken back.
                for t in range(count):
                    size = 0.0
                    for b in used:
                        size += weights[t, b] * phi[b]
                    h[k, 3 + t] = cm[k, axis[t]] * size * (behind[e] + delay)
                for j in range(3):
                    h[k, gm + j] = cm[k, j] * (behind[e] + delay)
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
                matrix(nominal, axis, weights, theta, RATE, m)
        sum_up(axis, weights, theta, x[gm : gm + 3], used, by)
        for s in range(n):
            history[e, 4 + s] = theta[s - 3] + x[s] if 3 <= s < gm else x[s]
            history[e, 4 + n + s] = p[s, s]
        e += 1
    return total
