"""Compiled: the accelerometers' filter, sample by sample; its dense oracle stands in the tests.

States: δV (3), φ (3), p coefficients, drift of the biases (3), q of the table's parameters, and,
where there are two more, the error of each hold's angles about east and north.
"""
# Numba's decorator has no types.
# pyright: reportUntypedFunctionDecorator=false

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from inercal.estimate.kalman import Steps, predict, update
from inercal.methods.turntable.strapdown import (
    add_up,
    apart,
    correct,
    driven_by,
    fill,
    rotate,
    turn_level,
)
from inercal.methods.turntable.terms import FORCE, SQUARE
from inercal.methods.turntable_kalman._common import (
    Model,
    Work,
    corrected,
    drifted,
    product,
    walked,
    work,
)

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class Samples(NamedTuple):
    """Of n samples."""

    time: Array  # (n,) s
    forces: Array  # (n, 3), readings, m/s²
    rates: Array  # (n, 3) rad/s, with coarse biases off
    hold: Indices  # (n,), number of the hold; negative while the table moves


class Readback(NamedTuple):
    """At e samples, ascending; the first of each hold is among them."""

    epochs: Indices  # (e,)
    attitude: Array  # (e, 3, 3)
    beside: Array  # (e, 2, q), how φ as it is observed moves with the table's parameters
    held: Array  # (e, 2) rad², variance of a hold's angles about east and north


class Settings(NamedTuple):
    """Variances beside the model's."""

    turning: float  # of the gyros' angles, rad²/s
    still: float  # of velocity at rest, (m/s)²
    readback: float  # of the attitude by readback, rad²
    fresh: float  # of φ where a hold begins, rad²


class State(NamedTuple):
    """How far the filter has come. What of x is fed back is kept zero."""

    c: Array  # (3, 3)
    theta: Array  # (p,)
    x: Array  # (n,)
    p: Array  # (n, n)
    made: Array  # (BASIS, 3, 3), Σ C M φ Δt since the epoch before
    time: Array  # (2,) s, of the sample and of the epoch before
    force: Array  # (3,) and (3,), of the sample before
    rate: Array
    velocity: Array  # (3,) m/s
    hold: Indices  # (1,), number of the sample's before
    nis: float = 0.0
    epochs: int = 0


@njit(cache=True, nogil=True, error_model="numpy")
def accelerometers(
    samples: Samples,
    readback: Readback,
    model: Model,
    settings: Settings,
    state: State,
    steps: Steps,
    history: Array,
) -> float:
    """Run the accelerometers' filter over a piece of a recording; return the sum of NIS.

    Parameters
    ----------
    samples, readback, model, settings
    state : State
        Its arrays are changed in place.
    steps : Steps
        Written at each epoch.
    history : (e, 6 + 2 n) array
        As of `gyros`, with five observations.
    """
    x, p, theta = state.x, state.p, state.theta
    count, n = theta.size, x.size
    gm = 6 + count
    done = work(model, theta, x[gm : gm + 3])
    drawn, driven, z = np.zeros(n), np.zeros((6, 6)), np.zeros(5)
    total, first = 0.0, 0
    for e in range(readback.epochs.size):
        row = e % len(steps.s)
        a, keep, h, gain = steps.a[row], steps.keep[row], steps.h[row], steps.gain[row]
        here = samples.hold[readback.epochs[e]]
        first = _carry(first, readback.epochs[e] + 1, samples, model, state, done)
        if here != state.hold[0]:
            state.hold[0] = here
            _begin(e, readback, model, settings, state, a, keep, drawn, driven)
            predict(p, a, keep, driven, drawn)
            history[e, :6] = 0.0
            steps.s[row] = 0.0
        else:
            _transition(model, settings, state, done, a, keep, drawn, driven)
            predict(p, a, keep, driven, drawn)
            _observe(e, readback, state, done, z, h)
            nis = 0.0
            for k in range(5):
                history[e, k] = z[k]
                for j in range(gm + 3, n):
                    history[e, k] -= h[k, j] * x[j]
                variance = settings.still if k < 3 else settings.readback
                off, s = update(x, p, h[k], z[k], variance, gain[k])
                steps.off[row, k], steps.s[row, k] = off, s
                nis += off * off / s
            history[e, 5] = nis
            total += nis
            _feed_back(state, done)
        corrected(done, model, theta, x[gm : gm + 3])
        for s in range(n):
            history[e, 6 + s] = theta[s - 6] if 6 <= s < gm else x[s]
            history[e, 6 + n + s] = p[s, s]
        for r, s in enumerate(steps.wanted):
            steps.rows[row, r] = p[s]
    _carry(first, samples.time.size, samples, model, state, done)
    return total


@njit(cache=True, nogil=True, error_model="numpy")
def _carry(first: int, end: int, samples: Samples, model: Model, state: State, done: Work) -> int:
    """Carry attitude and velocity over a hold's samples, and sum up what drives velocity.

    Return the sample to follow.
    """
    # Each field of a tuple that is asked for counts references: once here, not at each sample.
    time, forces, rates, hold = samples
    used, m, by, phi, cm, half, mean, u, turn, fed = done
    c, made, force, rate, velocity = state.c, state.made, state.force, state.rate, state.velocity
    earth, gravity, number, now = model.earth, model.gravity, state.hold[0], state.time[0]
    # What depends on f² takes f as corrected before.
    times = 2 if used[-1] >= SQUARE else 1
    for i in range(first, end):
        dt = time[i] - now
        now = time[i]
        if hold[i] >= 0 and hold[i] == number:
            for k in range(3):
                mean[k] = 0.5 * (forces[i, k] + force[k])
                u[k] = mean[k]
            for _ in range(times):
                fill(phi, u)
                correct(mean, m, by, phi, used, FORCE, u)
            fill(phi, u)
            for k in range(3):
                around = 0.0
                for j in range(3):
                    around += c[j, k] * earth[j]
                turn[k] = (0.5 * (rates[i, k] + rate[k]) - around) * dt
                fed[k] = 0.5 * turn[k]
            half[:] = c
            rotate(half, fed)
            rotate(c, turn)
            product(half, m, cm)
            for k in range(3):
                gain = -gravity if k == 2 else 0.0
                for j in range(3):
                    gain += half[k, j] * u[j]
                velocity[k] += gain * dt
            add_up(cm, phi, dt, used, made)
        for k in range(3):
            force[k], rate[k] = forces[i, k], rates[i, k]
    state.time[0] = now
    return end


@njit(cache=True, nogil=True, error_model="numpy")
def _begin(
    e: int,
    readback: Readback,
    model: Model,
    settings: Settings,
    state: State,
    a: Array,
    keep: Array,
    drawn: Array,
    driven: Array,
) -> None:
    """Begin a hold: attitude from the table, velocity zero; Φ and Q keep all but what is its own.

    The drift goes on.
    """
    gm = 6 + state.theta.size
    own = gm + 3 + readback.beside.shape[2]  # where a hold's own error begins
    a[:] = 0.0
    driven[:] = 0.0
    keep[:] = 1.0
    drawn[:] = 0.0
    for k in range(3):
        driven[k, k], driven[3 + k, 3 + k] = settings.still, settings.fresh
    for s in range(own, keep.size):
        keep[s], drawn[s] = 0.0, readback.held[e, s - own]
        state.x[s] = 0.0
    drifted(model, state.time[0] - state.time[1], gm, state.x, keep, drawn)
    state.time[1] = state.time[0]
    state.velocity[:] = 0.0
    state.made[:] = 0.0
    state.c[:] = readback.attitude[e]


@njit(cache=True, nogil=True, error_model="numpy")
def _transition(
    model: Model,
    settings: Settings,
    state: State,
    done: Work,
    a: Array,
    keep: Array,
    drawn: Array,
    driven: Array,
) -> None:
    """Write Φ and Q since the epoch before, as `predict` takes them; begin a new epoch."""
    terms, gravity = model.terms, model.gravity
    since = state.time[0] - state.time[1]
    state.time[1] = state.time[0]
    driven[:] = 0.0
    a[:] = 0.0
    keep[:] = 1.0
    drawn[:] = 0.0
    driven_by(state.made, terms.axis, terms.weights, done.used, 1.0, 6, a)
    walked(done.cm, model.white, since, driven)
    for k in range(3):
        a[k, k] = a[3 + k, 3 + k] = 1.0
        driven[3 + k, 3 + k] = settings.turning * since
    drifted(model, since, 6 + terms.axis.size, state.x, keep, drawn)
    # −[ω_ie×] of φ, twice of δV, and (0, 0, g) × φ.
    w0, w1, w2 = model.earth[0] * since, model.earth[1] * since, model.earth[2] * since
    a[3, 4], a[3, 5], a[4, 5] = w2, -w1, w0
    a[4, 3], a[5, 3], a[5, 4] = -w2, w1, -w0
    a[0, 1], a[0, 2], a[1, 2] = 2 * w2, -2 * w1, 2 * w0
    a[1, 0], a[2, 0], a[2, 1] = -2 * w2, 2 * w1, -2 * w0
    a[0, 4], a[1, 3] = -gravity * since, gravity * since


@njit(cache=True, nogil=True, error_model="numpy")
def _observe(e: int, readback: Readback, state: State, done: Work, z: Array, h: Array) -> None:
    """Write velocity, and what the readback says beyond the attitude, z = h x + noise."""
    beside, off = readback.beside, done.fed
    gm, q, n = 6 + state.theta.size, beside.shape[2], state.x.size
    own = gm + 3 + q
    z[:3] = state.velocity
    apart(readback.attitude[e], state.c, off)
    h[:] = 0.0
    for k in range(3):
        h[k, k] = 1.0
    for k in range(2):
        z[3 + k] = off[k]
        h[3 + k, 3 + k] = 1.0
        for j in range(q):
            h[3 + k, gm + 3 + j] = beside[e, k, j]
        if own < n:
            h[3 + k, own + k] = -1.0


@njit(cache=True, nogil=True, error_model="numpy")
def _feed_back(state: State, done: Work) -> None:
    """Correct velocity and attitude, and take in the coefficients."""
    x, theta, velocity, turn = state.x, state.theta, state.velocity, done.turn
    for k in range(3):
        velocity[k] -= x[k]
    turn[:] = x[3:6]
    x[:6] = 0.0
    turn_level(state.c, turn)
    for s in range(theta.size):
        theta[s] += x[6 + s]
        x[6 + s] = 0.0
