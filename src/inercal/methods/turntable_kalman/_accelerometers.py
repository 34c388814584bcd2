"""Compiled: the accelerometers' filter, sample by sample; its dense oracle stands in the tests.

All state is in arrays that are changed in place, so that a recording may come in pieces.
"""
# Numba's decorator has no types.
# pyright: reportUntypedFunctionDecorator=false

import numpy as np
from numba import njit
from numpy.typing import NDArray

from inercal.estimate.kalman import predict, update
from inercal.methods.turntable.strapdown import (
    add_up,
    apart,
    correct,
    driven_by,
    fill,
    matrix,
    rotate,
    sum_up,
    taken,
    turn_level,
)
from inercal.methods.turntable.terms import BASIS, FORCE, SQUARE

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


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
    gm, used = 6 + count, taken(weights)
    own = gm + 3 + beside.shape[2]  # where a hold's own error begins
    m, phi, by = np.zeros((3, 3)), np.zeros(BASIS), np.zeros((BASIS, 3))
    squares, a = used[-1] >= SQUARE, np.zeros((6, n))
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
    matrix(nominal, axis, weights, theta, FORCE, m)
    sum_up(axis, weights, theta, x[gm : gm + 3], used, by)
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
                fill(phi, u)
                correct(move, m, by, phi, used, FORCE, u)
            fill(phi, u)
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
            add_up(cm, phi, dt, used, made)
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
            driven_by(made, axis, weights, used, 1.0, 6, a)
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
            matrix(nominal, axis, weights, theta, FORCE, m)
        sum_up(axis, weights, theta, x[gm : gm + 3], used, by)
        for s in range(n):
            history[e, 6 + s] = theta[s - 6] if 6 <= s < gm else x[s]
            history[e, 6 + n + s] = p[s, s]
        e += 1
    return total
