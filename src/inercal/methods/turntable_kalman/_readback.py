"""Compiled: the observation of the gyros' attitude by a readback, at the time of the readback.

A readback is compared with the attitude at its time t′. The error there is

    φ(t′) = φ(t) + G dθ,  G = ∫ C M φ(f, ω) dt from t′ to t

G is stored for the samples that a readback may refer to; feedback at t turns their attitudes too.
"""
# Numba's decorator has no types.
# pyright: reportUntypedFunctionDecorator=false

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from inercal.arrays import Array
from inercal.estimate.kalman import update
from inercal.methods.turntable.drift_propagation import sum_drift_components
from inercal.methods.turntable.strapdown import (
    bracketing_rows,
    copy_matrix,
    interpolate_attitude,
    product,
    rotation_error,
    turn_level,
)
from inercal.methods.turntable_kalman._filter_steps import (
    FilterSamples,
    KernelModel,
    KernelWorkspace,
    Transition,
    copy_slice,
)

Indices = NDArray[np.int64]
MAX_LINEAR_DELAY = 1e-4  # s: over it the angle is linear within 0.04″, even at 1000 °/s²
MAX_ITERATIONS, DELAY_TOLERANCE = 10, 1e-6  # of a delay, s
REST_RATE_VARIANCES = 20.0  # variances of a sample, within which a rate is noise


class AttitudeReadback(NamedTuple):
    """At e samples, ascending."""

    epochs: Indices  # (e,)
    age: Array  # (e,) s, how much older than the sample it is by its stamp
    attitude: Array  # (e, 3, 3)
    table_sensitivity: Array  # (e, 3, q), ∂(φ as observed)/∂(the table's parameters)
    variance: Array  # (e,) rad², of the attitude


class AttitudeSettings(NamedTuple):
    """Parameters of the comparison of readback and attitude."""

    gate: float  # standard deviations beyond which an innovation is rejected
    alignment_variance: float  # of φ at an alignment, rad²
    gap: float  # s, a step of time beyond which the attitude is taken from readback anew
    timing_states: (
        Indices  # (3,), indices of latency, clock and azimuth among the states; -1 if no state
    )
    delay: float  # s, latency where it is not a state
    feedback: bool  # whether estimates are fed back
    azimuth: float  # rad, the azimuth of the model's earth rate


class AttitudeState(NamedTuple):
    """The state of the filter. The part of x that is fed back is zero."""

    c: Array  # (3, 3)
    theta: Array  # (p,)
    x: Array  # (n,)
    p: Array  # (n, n)
    sensitivity_integral: Array  # (size of φ, 3, 3), Σ C M φ Δt since the epoch before
    # (5,) s: of the sample and of the epoch before, where the clock began, the step that led to the
    # sample before, and where the last gap ended
    time: Array
    rates: Array  # (3, 3), of the last two samples, the newer first, and how they bent, rad/s³
    acceleration_variance: (
        Array  # (1,) rad², variance of φ by sudden accelerations since the epoch before
    )
    alignment_due: NDArray[np.bool_]  # (1,), whether an alignment is due
    rejections: Indices  # (2,), readbacks rejected in a row, and in all
    # (k,), (k, 3, 3) and (k, size of φ, 3, 3), a ring: attitude of the last samples, and −G from
    # the epoch before
    times: Array
    attitudes: Array
    sensitivity_integrals: Array
    newest_row: Indices  # (1,), their row of the sample before
    # Time and readback of the last samples, where the readback waits for the IMU; or time, rates
    # and hold of samples that wait for their readback.
    pending_samples: Array
    nis: float = 0.0
    epochs: int = 0


class AttitudeRun(NamedTuple):
    """The arguments of every step of the filter."""

    samples: FilterSamples
    readback: AttitudeReadback
    model: KernelModel
    settings: AttitudeSettings
    state: AttitudeState
    workspace: KernelWorkspace


class ReadbackTerms(NamedTuple):
    """A readback minus the attitude, z = h x + noise."""

    z: Array  # (3,) rad
    extra_variance: Array  # (3,) rad², variance beside that of the readback
    h: Array  # (3, n)


@njit(cache=True, nogil=True, error_model="numpy")
def _readback_time(e: int, run: AttitudeRun, x: Array, p: Array) -> tuple[float, float]:
    """Return when a readback was taken, by the sensor's clock, s, and the variance of that."""
    state, late = run.state, run.settings.timing_states
    lasting = state.time[0] - state.time[2]
    delay, variance = run.settings.delay, 0.0
    if late[0] >= 0:
        delay += x[late[0]]
        variance += p[late[0], late[0]]
    if late[1] >= 0:
        delay += x[late[1]] * lasting
        variance += p[late[1], late[1]] * lasting * lasting
    if late[0] >= 0 and late[1] >= 0:
        variance += 2 * p[late[0], late[1]] * lasting
    when: float = state.time[0] - run.readback.age[e] - delay
    return when, float(variance)


@njit(cache=True, nogil=True, error_model="numpy")
def align(e: int, run: AttitudeRun, to: Transition) -> None:
    """Take the attitude from the first readback after a gap.

    φ, Φ and Q of φ start anew; all other states stay.
    """
    state, done = run.state, run.workspace
    when, variance = _readback_time(e, run, state.x, state.p)
    if when < state.time[4]:
        return
    state.alignment_due[0] = False
    then, rate, turn = done.half, done.scratch, done.turn
    interpolate_attitude(state.times, state.attitudes, state.newest_row[0], when, then, rate, turn)
    spread = run.settings.alignment_variance
    for k in range(3):
        spread += rate[k] * rate[k] * variance
    # All attitudes since then turn by the same rotation.
    onto = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                onto[i, j] += run.readback.attitude[e, i, k] * then[j, k]
    product(onto, state.c, then)
    copy_matrix(then, state.c)
    for row in range(len(state.attitudes)):
        product(onto, state.attitudes[row], then)
        copy_matrix(then, state.attitudes[row])
    to.a[:] = 0.0
    to.driven[:] = 0.0
    for k in range(3):
        to.driven[k, k] = spread


@njit(cache=True, nogil=True, error_model="numpy")
def observe(e: int, run: AttitudeRun, fed: Array, x: Array, p: Array, seen: ReadbackTerms) -> None:
    """Write the readback minus the attitude at its time, linearised at x with covariance p.

    Its variance is larger where the rate changes. `fed` is the drift that is fed back.
    """
    readback, model, state, done = run.readback, run.model, run.state, run.workspace
    (z, spread, h), late, beside = seen, run.settings.timing_states, readback.table_sensitivity
    times, past, sums, newest = (
        state.times,
        state.attitudes,
        state.sensitivity_integrals,
        state.newest_row[0],
    )
    axis, weights, used, then, rate, turn = (
        model.terms.axis, model.terms.weights, done.used_terms, done.half, done.scratch, done.turn,
    )  # fmt: skip
    gm, lasting = 3 + axis.size, state.time[0] - state.time[2]
    own, components = gm + model.size, model.drift.times.size  # where the table's begin
    when, variance = _readback_time(e, run, x, p)
    interpolate_attitude(times, past, newest, when, then, rate, turn)
    for k in range(3):
        spread[k] = turn[k] * turn[k]
    # The noise of rates at rest is no motion: the filter would estimate a delay from it.
    noise = max(model.white[0], model.white[1], model.white[2])
    for k in range(3):
        if rate[k] * rate[k] * state.time[3] < REST_RATE_VARIANCES * noise:
            rate[k] = 0.0
    if variance > MAX_LINEAR_DELAY * MAX_LINEAR_DELAY:
        _add_delay_curvature(run, p, when, variance, spread)
    rotation_error(readback.attitude[e], then, z)
    before, after, share = bracketing_rows(times, newest, when)
    h[:] = 0.0
    for k in range(3):
        h[k, k] = 1.0
        for j in range(beside.shape[2]):
            h[k, own + j] = beside[e, k, j]
        if late[0] >= 0:
            h[k, late[0]] = -rate[k]
            z[k] -= rate[k] * x[late[0]]
        if late[1] >= 0:
            h[k, late[1]] = -rate[k] * lasting
            z[k] -= rate[k] * x[late[1]] * lasting
        # φ at that time: its increments since then are subtracted.
        for b in used:
            for t in range(axis.size):
                early, later = sums[before, b, k, axis[t]], sums[after, b, k, axis[t]]
                h[k, 3 + t] -= weights[t, b] * (early + share * (later - early))
        for j in range(3):
            early, later = sums[before, 0, k, j], sums[after, 0, k, j]
            since = -(early + share * (later - early))
            for c in range(components):
                h[k, gm + 3 * c + j] = since
            z[k] += since * fed[j]


@njit(cache=True, nogil=True, error_model="numpy")
def iterate_observation(
    e: int, run: AttitudeRun, fed: Array, seen: ReadbackTerms, gain: Array
) -> None:
    """Iterate z = h x at the estimated delay, where the delay was uncertain.

    Source: Bell and Cathey 1993, IEEE TAC 38(2), 294–297: Gauss–Newton on what is most probable.
    """
    state, (z, spread, h) = run.state, seen
    when, variance = _readback_time(e, run, state.x, state.p)
    if variance <= MAX_LINEAR_DELAY * MAX_LINEAR_DELAY:
        return
    for _ in range(MAX_ITERATIONS):
        x, p, before = state.x.copy(), state.p.copy(), when
        for k in range(3):
            update(x, p, h[k], z[k], run.readback.variance[e] + spread[k], gain[k])
        observe(e, run, fed, x, p, seen)
        when, _v = _readback_time(e, run, x, p)
        if abs(when - before) < DELAY_TOLERANCE:
            return


@njit(cache=True, nogil=True, error_model="numpy")
def _add_delay_curvature(
    run: AttitudeRun, p: Array, when: float, variance: float, spread: Array
) -> None:
    """Add the mean squares of terms of second order in an uncertain delay.

    For α δτ²/2 this is 3/4 (α σ²)²; for δω δτ, with the error of the rate by the coefficients, at
    most 3 σ² var(ω).
    """
    model, state, done = run.model, run.state, run.workspace
    then, sd, newest = done.half, np.sqrt(variance), state.newest_row[0]
    other, one, two, unused = np.empty((3, 3)), np.empty(3), np.empty(3), np.empty(3)
    interpolate_attitude(state.times, state.attitudes, newest, when + sd, other, unused, two)
    rotation_error(other, then, one)
    interpolate_attitude(state.times, state.attitudes, newest, when - sd, other, unused, two)
    rotation_error(other, then, two)
    before, after, _ = bracketing_rows(state.times, newest, when)
    step = state.times[after] - state.times[before]
    axis, weights = model.terms.axis, model.terms.weights
    row = np.zeros(axis.size)
    for k in range(3):
        spread[k] += 0.75 * (one[k] + two[k]) ** 2
        if step <= 0:
            continue
        row[:] = 0.0
        for b in done.used_terms:
            for t in range(axis.size):
                moved = (
                    state.sensitivity_integrals[after, b, k, axis[t]]
                    - state.sensitivity_integrals[before, b, k, axis[t]]
                )
                row[t] += weights[t, b] * moved / step
        for s in range(axis.size):
            for t in range(axis.size):
                spread[k] += 3 * variance * row[s] * p[3 + s, 3 + t] * row[t]


@njit(cache=True, nogil=True, error_model="numpy")
def feed_back(run: AttitudeRun, fed: Array) -> None:
    """Turn the present and past attitudes by φ, and add the corrections of the coefficients.

    `fed` is the drift that was fed back before.
    """
    model, state, done = run.model, run.state, run.workspace
    x, theta, past, sums, turn = (
        state.x,
        state.theta,
        state.attitudes,
        state.sensitivity_integrals,
        done.turn,
    )
    axis, weights, used = model.terms.axis, model.terms.weights, done.used_terms
    by = np.zeros((sums.shape[1], 3))  # what each of φ adds to readings anew
    sum_drift_components(x, 3 + axis.size, model.drift.times.size, turn)
    for j in range(3):
        by[0, j] = turn[j] - fed[j]
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
    copy_slice(x, 0, turn)
    x[:3] = 0.0
    turn_level(state.c, turn)
    for s in range(theta.size):
        theta[s] += x[3 + s]
        x[3 + s] = 0.0
