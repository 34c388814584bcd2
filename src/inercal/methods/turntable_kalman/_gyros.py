"""Compiled: the gyros' filter, sample by sample; its dense oracle stands in the tests.

Between samples rates are linear, with the second-order term of coning (Miller 1983, J. Guidance
6(4), 287–291). States: φ (3), p coefficients, drift of the biases (3), q of the table's parameters.
"""
# Numba's decorator has no types.
# pyright: reportUntypedFunctionDecorator=false

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from inercal.estimate.kalman import Steps, predict, update
from inercal.methods.turntable.strapdown import (
    BENT,
    KINK,
    add_up,
    apart,
    correct,
    delayed,
    driven_by,
    fill,
    rotate,
    turn_level,
)
from inercal.methods.turntable.terms import FORCE, RATE, SQUARE
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
    rates: Array  # (n, 3), readings, rad/s
    hold: Indices  # (n,), number of the hold; negative while the table moves


class Readback(NamedTuple):
    """At e samples, ascending."""

    epochs: Indices  # (e,)
    behind: Array  # (e,) s, how much older than the sample it is by its stamp
    attitude: Array  # (e, 3, 3)
    beside: Array  # (e, 3, q), how φ as it is observed moves with the table's parameters


class Settings(NamedTuple):
    """How the two are compared."""

    variance: float  # of the attitude by readback, rad²
    aligned: float  # of φ at an alignment, rad²
    gap: float  # s, a step of time beyond which the attitude is taken from readback anew
    late: Indices  # (3,), where latency, clock and azimuth stand among the states; -1 is not there
    closed: bool  # whether what is found is fed back


class State(NamedTuple):
    """How far the filter has come. What of x is fed back is kept zero."""

    c: Array  # (3, 3)
    theta: Array  # (p,)
    x: Array  # (n,)
    p: Array  # (n, n)
    made: Array  # (BASIS, 3, 3), Σ C M φ Δt since the epoch before
    time: Array  # (3,) s: of the sample and of the epoch before, and where the clock began
    rates: Array  # (2, 3), of the last two samples, the newer first
    bent: Array  # (1,) rad², variance of φ by kinks of the rate since the epoch before
    lost: NDArray[np.bool_]  # (1,), whether an alignment is due
    times: (
        Array  # (k,) and (k, 3, 3), of `delayed`: what the readback, being late, is compared with
    )
    past: Array
    newest: Indices  # (1,), their row of the sample before
    tail: Array  # (lag, 1 + axes): time and readback of the last samples
    nis: float = 0.0
    epochs: int = 0


@njit(cache=True, nogil=True, error_model="numpy")
def gyros(
    samples: Samples,
    readback: Readback,
    model: Model,
    settings: Settings,
    state: State,
    steps: Steps,
    history: Array,
) -> float:
    """Run the gyros' filter over a piece of a recording; return the sum of NIS.

    Parameters
    ----------
    samples, readback, model, settings
    state : State
        Its arrays are changed in place.
    steps : Steps
        Written at each epoch.
    history : (e, 4 + 2 n) array
        Written at each epoch: innovations (3), NIS, the estimates (x with the coefficients
        in their place, φ zero) and their variances.
    """
    x, p, theta = state.x, state.p, state.theta
    count, n = theta.size, x.size
    gm = 3 + count
    done = work(model, theta, x[gm : gm + 3])
    drawn, driven, z = np.zeros(n), np.zeros((3, 3)), np.zeros(3)
    total, first = 0.0, 0
    for e in range(readback.epochs.size):
        row = e % len(steps.s)
        a, keep, h, gain = steps.a[row], steps.keep[row], steps.h[row], steps.gain[row]
        first = _carry(first, readback.epochs[e] + 1, samples, model, settings, state, done)
        _transition(model, settings, state, done, a, keep, drawn, driven)
        anew = state.lost[0]
        if anew:
            _align(e, readback, settings, state, done, a, driven)
        if not settings.closed:
            _follow(x, a)
        predict(p, a, keep, driven, drawn)
        if anew:
            history[e, :4] = 0.0
            steps.s[row] = 0.0
        else:
            _observe(e, readback, model, settings, state, done, z, h)
            nis = 0.0
            for k in range(3):
                history[e, k] = z[k]
                for j in range(gm + 3, n):
                    history[e, k] -= h[k, j] * x[j]
            for k in range(3):
                off, s = update(x, p, h[k], z[k], settings.variance, gain[k])
                steps.off[row, k], steps.s[row, k] = off, s
                nis += off * off / s
            history[e, 3] = nis
            total += nis
            if settings.closed:
                _feed_back(state, done)
        corrected(done, model, theta, x[gm : gm + 3])
        for s in range(n):
            history[e, 4 + s] = theta[s - 3] + x[s] if 3 <= s < gm else x[s]
            history[e, 4 + n + s] = p[s, s]
        for r, s in enumerate(steps.wanted):
            steps.rows[row, r] = p[s]
    _carry(first, samples.time.size, samples, model, settings, state, done)
    return total


@njit(cache=True, nogil=True, error_model="numpy")
def _carry(
    first: int,
    end: int,
    samples: Samples,
    model: Model,
    settings: Settings,
    state: State,
    done: Work,
) -> int:
    """Carry the attitude over samples, and sum up what drives φ; return the sample to follow."""
    # Each field of a tuple that is asked for counts references: once here, not at each sample.
    time, rates, hold = samples
    used, m, by, phi, cm, half, mean, u, turn, fed = done
    c, made, before, times, past = state.c, state.made, state.rates, state.times, state.past
    earth, white, gravity, gap = model.earth, model.white, model.gravity, settings.gap
    newest, now, kinks, lost = state.newest[0], state.time[0], state.bent[0], state.lost[0]
    squares = used[-1] >= SQUARE
    for i in range(first, end):
        dt = time[i] - now
        lost = lost or dt > gap
        for k in range(3):
            phi[FORCE + k] = gravity * c[2, k]
            mean[k] = 0.5 * (rates[i, k] + before[0, k])
        if squares:
            fill(phi, phi[FORCE : FORCE + 3])
        correct(mean, m, by, phi, used, RATE, u)
        # The way within the step, against the level frame; half of it first.
        for k in range(3):
            around = 0.0
            for j in range(3):
                around += c[j, k] * earth[j]
            j1, j2 = (k + 1) % 3, (k + 2) % 3
            coning = before[0, j1] * rates[i, j2] - before[0, j2] * rates[i, j1]
            turn[k] = (u[k] - around) * dt + coning * dt * dt / 12
            fed[k] = 0.5 * turn[k]
            # At rest the earth's rate alone is felt. Readings would do as well but for their noise:
            # the angle's random walk is made of it, and scale factors would be found from the two.
            phi[RATE + k] = around if hold[i] >= 0 else u[k]
        half[:] = c
        rotate(half, fed)
        rotate(c, turn)
        product(half, m, cm)
        add_up(cm, phi, dt, used, made)
        now, newest = time[i], (newest + 1) % times.size
        times[newest] = now
        for k in range(3):
            bent = rates[i, k] - 2 * before[0, k] + before[1, k]
            if bent * bent * dt > BENT * white[k]:
                kinks += (KINK * bent * dt) ** 2
            before[1, k], before[0, k] = before[0, k], rates[i, k]
            for j in range(3):
                past[newest, k, j] = c[k, j]
    state.newest[0], state.time[0], state.bent[0], state.lost[0] = newest, now, kinks, lost
    return end


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
    earth, terms, bent = model.earth, model.terms, state.bent[0]
    since = state.time[0] - state.time[1]
    state.time[1] = state.time[0]
    a[:] = 0.0
    driven_by(state.made, terms.axis, terms.weights, done.used, -1.0, 3, a)
    walked(done.cm, model.white, since, driven)
    for k in range(3):
        a[k, k] = 1.0
        driven[k, k] += bent
    state.bent[0] = 0.0
    drifted(model, since, 3 + terms.axis.size, state.x, keep, drawn)
    # −[ω_ie×] within an epoch.
    a[0, 1], a[0, 2], a[1, 2] = earth[2] * since, -earth[1] * since, earth[0] * since
    a[1, 0], a[2, 0], a[2, 1] = -a[0, 1], -a[0, 2], -a[1, 2]
    if settings.late[2] >= 0:
        # The level frame is the table's: turned clockwise it sees the earth's rate go west.
        a[0, settings.late[2]] = earth[1] * since


@njit(cache=True, nogil=True, error_model="numpy")
def _follow(x: Array, a: Array) -> None:
    """Carry φ that is not fed back."""
    moved = np.zeros(3)
    for k in range(3):
        moved[k] = x[k]
        for s in range(x.size):
            moved[k] += (a[k, s] - (1.0 if s == k else 0.0)) * x[s]
    x[:3] = moved


@njit(cache=True, nogil=True, error_model="numpy")
def _align(
    e: int,
    readback: Readback,
    settings: Settings,
    state: State,
    done: Work,
    a: Array,
    driven: Array,
) -> None:
    """Take the attitude from readback: φ is lost, in Φ and Q too, all else is kept."""
    x, p, late = state.x, state.p, settings.late[0]
    state.lost[0] = False
    delay, fastest, spread = readback.behind[e], 0.0, settings.aligned
    if late >= 0:
        delay += x[late]
    # The readback is brought to the sample by the rate.
    for k in range(3):
        done.turn[k] = done.phi[RATE + k] * delay
        fastest += done.phi[RATE + k] * done.phi[RATE + k]
    if late >= 0:
        spread += fastest * p[late, late]
    state.c[:] = readback.attitude[e]
    rotate(state.c, done.turn)
    a[:] = 0.0
    driven[:] = 0.0
    for k in range(3):
        driven[k, k] = spread
    state.times[:] = state.time[0]
    state.past[:] = state.c


@njit(cache=True, nogil=True, error_model="numpy")
def _observe(
    e: int,
    readback: Readback,
    model: Model,
    settings: Settings,
    state: State,
    done: Work,
    z: Array,
    h: Array,
) -> None:
    """Write what the readback says beyond the attitude when it was taken, z = h x + noise."""
    x, late, beside, behind = state.x, settings.late, readback.beside, readback.behind[e]
    axis, weights, used, cm, phi, rate = (
        model.terms.axis, model.terms.weights, done.used, done.cm, done.phi, done.fed,
    )  # fmt: skip
    count, gm = axis.size, 3 + axis.size
    delay, lasting = 0.0, state.time[0] - state.time[2]
    if late[0] >= 0:
        delay += x[late[0]]
    if late[1] >= 0:
        delay += x[late[1]] * lasting
    when = state.time[0] - behind - delay
    delayed(state.times, state.past, state.newest[0], when, done.half, rate)
    apart(readback.attitude[e], done.half, z)
    h[:] = 0.0
    for k in range(3):
        h[k, k] = 1.0
        for j in range(beside.shape[2]):
            h[k, gm + 3 + j] = beside[e, k, j]
        if late[0] >= 0:
            h[k, late[0]] = -rate[k]
        if late[1] >= 0:
            h[k, late[1]] = -rate[k] * lasting
        z[k] -= rate[k] * delay
        # φ as it was then: what drove it since is taken back.
        for t in range(count):
            size = 0.0
            for b in used:
                size += weights[t, b] * phi[b]
            h[k, 3 + t] = cm[k, axis[t]] * size * (behind + delay)
        for j in range(3):
            h[k, gm + j] = cm[k, j] * (behind + delay)


@njit(cache=True, nogil=True, error_model="numpy")
def _feed_back(state: State, done: Work) -> None:
    """Turn the attitude, now and as it was, by φ, and take in the coefficients."""
    x, theta, past, turn = state.x, state.theta, state.past, done.turn
    turn[:] = x[:3]
    x[:3] = 0.0
    turn_level(state.c, turn)
    for row in range(len(past)):
        turn_level(past[row], turn)
    for s in range(theta.size):
        theta[s] += x[3 + s]
        x[3 + s] = 0.0
