"""Compiled: the gyros' filter, sample by sample; its dense oracle stands in the tests.

Rates are parabolas through the last three samples, with the second-order term of coning (Miller
1983, J. Guidance 6(4), 287–291). States: φ (3), p coefficients, drift of the biases (3), q of the
table's parameters. A readback is compared with the attitude of its own time t′: of what is there

    φ(t′) = φ(t) + G dθ,  G = ∫ C M φ(f, ω) dt from t′ to t

G is kept for the samples that may be asked for, and what is fed back at t turns them by as much.
"""
# Numba's decorator has no types.
# pyright: reportUntypedFunctionDecorator=false

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from inercal.estimate.kalman import Steps, predict, update
from inercal.methods.turntable.strapdown import (
    JUMPED,
    SUDDEN,
    add_up,
    alike,
    apart,
    around,
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
STRAIGHT = 1e-4  # s: within that a way does not bend by more than 0.04″, even at 1000 °/s²
STILL = 20.0  # variances of a sample
ITERATIONS, SAME = 10, 1e-6  # of a delay, s


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
    delay: float  # s, latency where it is no state
    closed: bool  # whether what is found is fed back


class State(NamedTuple):
    """How far the filter has come. What of x is fed back is kept zero."""

    c: Array  # (3, 3)
    theta: Array  # (p,)
    x: Array  # (n,)
    p: Array  # (n, n)
    made: Array  # (BASIS, 3, 3), Σ C M φ Δt since the epoch before
    # (5,) s: of the sample and of the epoch before, where the clock began, the step that led to the
    # sample before, and where the last gap ended
    time: Array
    rates: Array  # (3, 3), of the last two samples, the newer first, and how they bent, rad/s³
    bent: Array  # (1,) rad², variance of φ by sudden accelerations since the epoch before
    lost: NDArray[np.bool_]  # (1,), whether an alignment is due
    # (k,), (k, 3, 3) and (k, BASIS, 3, 3), a ring: attitude of the last samples, and −G from the
    # epoch before
    times: Array
    past: Array
    sums: Array
    newest: Indices  # (1,), their row of the sample before
    # Of the last samples time and readback, which comes later than they; or of those that wait for
    # theirs time, rates and hold.
    tail: Array
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
    fed, z, spread = np.zeros(3), np.zeros(3), np.zeros(3)
    if settings.closed:
        fed[:] = x[gm : gm + 3]  # the drift that readings are corrected by
    done = work(model, theta, fed)
    drawn, driven = np.zeros(n), np.zeros((3, 3))
    total, first = 0.0, 0
    for e in range(readback.epochs.size):
        row = e % len(steps.s)
        a, keep, h, gain = steps.a[row], steps.keep[row], steps.h[row], steps.gain[row]
        first = _carry(first, readback.epochs[e] + 1, samples, model, settings, state, done)
        _transition(model, settings, state, done, a, keep, drawn, driven)
        lost = state.lost[0]
        if lost:
            _align(e, readback, settings, state, done, a, driven)
        if not settings.closed:
            _follow(x, a)
        predict(p, a, keep, driven, drawn)
        if lost:
            history[e, :4] = 0.0
            steps.s[row] = 0.0
        else:
            _observe(e, readback, model, settings, state, done, fed, x, p, z, spread, h)
            _again(e, readback, model, settings, state, done, fed, z, spread, h, gain)
            nis = 0.0
            for k in range(3):
                history[e, k] = z[k]
                for j in range(n):
                    history[e, k] -= h[k, j] * x[j]
            for k in range(3):
                variance = settings.variance + spread[k]
                off, s = update(x, p, h[k], z[k], variance, gain[k])
                steps.off[row, k], steps.s[row, k] = off, s
                nis += off * off / s
            history[e, 3] = nis
            total += nis
            if settings.closed:
                _feed_back(model, state, done, fed)
        if settings.closed:
            fed[:] = x[gm : gm + 3]
        corrected(done, model, theta, fed)
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
    sums, step, ended = state.sums, state.time[3], state.time[4]
    squares = used[-1] >= SQUARE
    for i in range(first, end):
        dt = time[i] - now
        if dt > gap:
            lost, ended = True, time[i]
        bends = alike(dt, step)
        for k in range(3):
            phi[FORCE + k] = gravity * c[2, k]
            bend = 0.0
            if bends:
                slope, earlier = (rates[i, k] - before[0, k]) / dt, before[0, k] - before[1, k]
                bend = 2 * (slope - earlier / step) / (dt + step)
            mean[k] = 0.5 * (rates[i, k] + before[0, k]) - bend * dt * dt / 12
            bent = (bend - before[2, k]) * dt * dt
            before[2, k] = bend
            if bent * bent * dt > JUMPED * white[k]:
                kinks += (SUDDEN * bent * dt) ** 2
        if squares:
            fill(phi, phi[FORCE : FORCE + 3])
        correct(mean, m, by, phi, used, RATE, u)
        # The way within the step, against the level frame; half of it first.
        for k in range(3):
            around_earth = 0.0
            for j in range(3):
                around_earth += c[j, k] * earth[j]
            j1, j2 = (k + 1) % 3, (k + 2) % 3
            coning = before[0, j1] * rates[i, j2] - before[0, j2] * rates[i, j1]
            turn[k] = (u[k] - around_earth) * dt + coning * dt * dt / 12
            fed[k] = 0.5 * turn[k]
            # At rest the earth's rate alone is felt, and about an axis that does not turn. Readings
            # would do as well but for their noise: the angle's random walk is made of it, and scale
            # factors would be found from the two.
            beyond = u[k] - around_earth
            still = hold[i] >= 0 or beyond * beyond * dt < STILL * white[k]
            phi[RATE + k] = around_earth if still else u[k]
        half[:] = c
        rotate(half, fed)
        rotate(c, turn)
        product(half, m, cm)
        add_up(cm, phi, dt, used, made)
        now, step, newest = time[i], dt, (newest + 1) % times.size
        times[newest] = now
        for k in range(3):
            before[1, k], before[0, k] = before[0, k], rates[i, k]
            for j in range(3):
                past[newest, k, j] = c[k, j]
                for b in used:
                    sums[newest, b, k, j] = made[b, k, j]
    state.newest[0], state.time[0], state.bent[0], state.lost[0] = newest, now, kinks, lost
    state.time[3], state.time[4] = step, ended
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
    earth, terms, bent, made, sums = (
        model.earth, model.terms, state.bent[0], state.made, state.sums,
    )  # fmt: skip
    since = state.time[0] - state.time[1]
    state.time[1] = state.time[0]
    for row in range(len(sums)):
        for b in done.used:
            for k in range(3):
                for j in range(3):
                    sums[row, b, k, j] -= made[b, k, j]
    a[:] = 0.0
    driven_by(made, terms.axis, terms.weights, done.used, -1.0, 3, a)
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
def _stamp(
    e: int, readback: Readback, settings: Settings, state: State, x: Array, p: Array
) -> tuple[float, float]:
    """Return when a readback was taken, by the sensor's clock, s, and the variance of that."""
    late, lasting = settings.late, state.time[0] - state.time[2]
    delay, variance = settings.delay, 0.0
    if late[0] >= 0:
        delay += x[late[0]]
        variance += p[late[0], late[0]]
    if late[1] >= 0:
        delay += x[late[1]] * lasting
        variance += p[late[1], late[1]] * lasting * lasting
    if late[0] >= 0 and late[1] >= 0:
        variance += 2 * p[late[0], late[1]] * lasting
    when: float = state.time[0] - readback.behind[e] - delay
    return when, float(variance)


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
    """Take the attitude from the first readback of after a gap.

    φ is lost, in Φ and Q too, all else is kept.
    """
    when, variance = _stamp(e, readback, settings, state, state.x, state.p)
    if when < state.time[4]:
        return
    state.lost[0] = False
    then, rate, turn = done.half, done.fed, done.turn
    delayed(state.times, state.past, state.newest[0], when, then, rate, turn)
    spread = settings.aligned
    for k in range(3):
        spread += rate[k] * rate[k] * variance
    # All that was carried since is turned alike.
    onto = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                onto[i, j] += readback.attitude[e, i, k] * then[j, k]
    product(onto, state.c, then)
    state.c[:] = then
    for row in range(len(state.past)):
        product(onto, state.past[row], then)
        state.past[row] = then
    a[:] = 0.0
    driven[:] = 0.0
    for k in range(3):
        driven[k, k] = spread


@njit(cache=True, nogil=True, error_model="numpy")
def _observe(
    e: int,
    readback: Readback,
    model: Model,
    settings: Settings,
    state: State,
    done: Work,
    fed: Array,
    x: Array,
    p: Array,
    z: Array,
    spread: Array,
    h: Array,
) -> None:
    """Write what the readback says beyond the attitude when it was taken, z = h x + noise.

    About x, of covariance p; beside the readback's noise there is `spread`, (3,) rad², where the
    way bends. `fed` is the drift that is fed back.
    """
    late, beside = settings.late, readback.beside
    times, past, sums, newest = state.times, state.past, state.sums, state.newest[0]
    axis, weights, used, then, rate, turn = (
        model.terms.axis, model.terms.weights, done.used, done.half, done.fed, done.turn,
    )  # fmt: skip
    gm, lasting = 3 + axis.size, state.time[0] - state.time[2]
    when, variance = _stamp(e, readback, settings, state, x, p)
    delayed(times, past, newest, when, then, rate, turn)
    for k in range(3):
        spread[k] = turn[k] * turn[k]
    if variance > STRAIGHT * STRAIGHT:
        _curved(model, state, done, p, when, variance, spread)
    apart(readback.attitude[e], then, z)
    before, after, share = around(times, newest, when)
    h[:] = 0.0
    for k in range(3):
        h[k, k] = 1.0
        for j in range(beside.shape[2]):
            h[k, gm + 3 + j] = beside[e, k, j]
        if late[0] >= 0:
            h[k, late[0]] = -rate[k]
            z[k] -= rate[k] * x[late[0]]
        if late[1] >= 0:
            h[k, late[1]] = -rate[k] * lasting
            z[k] -= rate[k] * x[late[1]] * lasting
        # φ as it was then: what drove it since is taken back.
        for b in used:
            for t in range(axis.size):
                early, later = sums[before, b, k, axis[t]], sums[after, b, k, axis[t]]
                h[k, 3 + t] -= weights[t, b] * (early + share * (later - early))
        for j in range(3):
            early, later = sums[before, 0, k, j], sums[after, 0, k, j]
            h[k, gm + j] = -(early + share * (later - early))
            z[k] += h[k, gm + j] * fed[j]


@njit(cache=True, nogil=True, error_model="numpy")
def _again(
    e: int,
    readback: Readback,
    model: Model,
    settings: Settings,
    state: State,
    done: Work,
    fed: Array,
    z: Array,
    spread: Array,
    h: Array,
    gain: Array,
) -> None:
    """Take z = h x about the delay that it leads to, where little was known of that (iterated).

    Source: Bell and Cathey 1993, IEEE TAC 38(2), 294–297: Gauss–Newton on what is most probable.
    """
    when, variance = _stamp(e, readback, settings, state, state.x, state.p)
    if variance <= STRAIGHT * STRAIGHT:
        return
    for _ in range(ITERATIONS):
        x, p, before = state.x.copy(), state.p.copy(), when
        for k in range(3):
            update(x, p, h[k], z[k], settings.variance + spread[k], gain[k])
        _observe(e, readback, model, settings, state, done, fed, x, p, z, spread, h)
        when, _v = _stamp(e, readback, settings, state, x, p)
        if abs(when - before) < SAME:
            return


@njit(cache=True, nogil=True, error_model="numpy")
def _curved(
    model: Model, state: State, done: Work, p: Array, when: float, variance: float, spread: Array
) -> None:
    """Add the mean squares of what is of second order in a delay that is hardly known.

    Of α δτ²/2 that is 3/4 (α σ²)², of δω δτ, with the error of the rate by the coefficients, no
    more than 3 σ² var(ω).
    """
    then, sd, newest = done.half, np.sqrt(variance), state.newest[0]
    other, one, two, unused = np.empty((3, 3)), np.empty(3), np.empty(3), np.empty(3)
    delayed(state.times, state.past, newest, when + sd, other, unused, two)
    apart(other, then, one)
    delayed(state.times, state.past, newest, when - sd, other, unused, two)
    apart(other, then, two)
    before, after, _ = around(state.times, newest, when)
    step = state.times[after] - state.times[before]
    axis, weights = model.terms.axis, model.terms.weights
    row = np.zeros(axis.size)
    for k in range(3):
        spread[k] += 0.75 * (one[k] + two[k]) ** 2
        if step <= 0:
            continue
        row[:] = 0.0
        for b in done.used:
            for t in range(axis.size):
                moved = state.sums[after, b, k, axis[t]] - state.sums[before, b, k, axis[t]]
                row[t] += weights[t, b] * moved / step
        for s in range(axis.size):
            for t in range(axis.size):
                spread[k] += 3 * variance * row[s] * p[3 + s, 3 + t] * row[t]


@njit(cache=True, nogil=True, error_model="numpy")
def _feed_back(model: Model, state: State, done: Work, fed: Array) -> None:
    """Turn the attitude, now and as it was, by φ, and take in the coefficients.

    `fed` is the drift that was fed back before.
    """
    x, theta, past, sums, turn = state.x, state.theta, state.past, state.sums, done.turn
    axis, weights, used = model.terms.axis, model.terms.weights, done.used
    by = np.zeros((sums.shape[1], 3))  # what each of φ adds to readings anew
    for j in range(3):
        by[0, j] = x[3 + axis.size + j] - fed[j]
    for b in used:
        for s in range(axis.size):
            by[b, axis[s]] += weights[s, b] * x[3 + s]
    for row in range(len(past)):
        for k in range(3):
            turn[k] = x[k]
            for b in used:
                for j in range(3):
                    turn[k] -= sums[row, b, k, j] * by[b, j]
        turn_level(past[row], turn)
    turn[:] = x[:3]
    x[:3] = 0.0
    turn_level(state.c, turn)
    for s in range(theta.size):
        theta[s] += x[3 + s]
        x[3 + s] = 0.0
