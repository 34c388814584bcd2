"""Observe the gyros' attitude by a readback, at the time of the readback.

A readback is compared with the attitude at its time t′. The error there is

    φ(t′) = φ(t) + G dθ,  G = ∫ C M φ(f, ω) dt from t′ to t

G is stored for the samples that a readback may refer to. Feedback at t also corrects the attitudes
stored for these samples.

The noise of a reading counts once in the sum of all steps, but one part of the noise enters the
attitude at t′ and the other part comes later. Two neighbouring increments have the covariance γ σ²,
where σ² is the variance of a sample's angle. A random walk that is observed with noise of the
variance −γ σ² has the same covariance, so this variance is added to that of the readback. The sum
may be negative, but the variance of an innovation is not.
"""

from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Bools, Indices
from inercal.estimation.kalman import update
from inercal.estimation.kernel_options import kernel_step, record
from inercal.methods.turntable.drift_propagation import sum_drift_components
from inercal.methods.turntable.small_matrices import copy_matrix, product
from inercal.methods.turntable.strapdown import (
    bracketing_rows,
    interpolate_attitude,
    rotation_error,
    turn_level,
)
from inercal.methods.turntable_kalman._filter_steps import KernelModel, KernelWorkspace, Transition

MAX_LINEAR_DELAY = 1e-4  # s: within it the angle is linear to 0.04″, even at 1000 °/s²
MAX_ITERATIONS, DELAY_TOLERANCE = 10, 1e-6  # for the delay; tolerance in s
REST_RATE_VARIANCES = 20.0  # variances of a sample; a smaller rate counts as noise


@record
class AttitudeReadback(NamedTuple):
    """The readback at e samples, ascending."""

    epochs: Indices  # (e,)
    age: Array  # (e,) s, how much older than the sample the readback is, by its timestamp
    attitude: Array  # (e, 3, 3)
    table_sensitivity: Array  # (e, 3, q), ∂(observed φ)/∂(the table's parameters)
    variance: Array  # (e,) rad², of the attitude


@record
class AttitudeSettings(NamedTuple):
    """Parameters of the comparison of readback and attitude."""

    gate: float  # standard deviations above which an innovation is rejected
    alignment_variance: float  # of φ at an alignment, rad²
    gap: float  # s, time step above which the attitude is taken from the readback again
    # (3,), indices of latency, clock and azimuth among the states; -1 if no state
    timing_states: Indices
    delay: float  # s, latency if it is not a state
    feedback: bool  # whether estimates are fed back
    azimuth: float  # rad, azimuth of the earth's rate in the model


@record
class AttitudeState(NamedTuple):
    """The state of the filter. The part of x that is fed back is zero."""

    c: Array  # (3, 3)
    theta: Array  # (p,)
    x: Array  # (n,)
    p: Array  # (n, n)
    sensitivity_integral: Array  # (size of φ, 9), Σ C M φ Δt since the epoch before
    # (5,) s: times of the sample before and the epoch before, start of the clock, step before the
    # sample before, and end of the last gap
    time: Array
    # (5, 3), readings of the last two samples, the newer first, their curvature, rad/s³, and the
    # last two third differences
    rates: Array
    # (1,) rad², variance of φ due to sudden accelerations since the epoch before
    acceleration_variance: Array
    alignment_due: Bools  # (1,), whether an alignment is due
    rejections: Indices  # (2,), readbacks rejected in a row, and in total
    # (k,), (k, 3, 3) and (k, size of φ, 9), ring buffer: attitude at the last samples, and −G since
    # the epoch before
    times: Array
    attitudes: Array
    sensitivity_integrals: Array
    newest_row: Indices  # (1,), row of the sample before in the ring buffer
    # Time and readback of the last samples, if the readback waits for the IMU; or time, rates and
    # hold of samples that wait for their readback.
    pending_samples: Array
    nis: float = 0.0
    dof: int = 0  # of NIS, if the coefficients are treated as known


@kernel_step
def _readback_time(
    age: float, settings: AttitudeSettings, time: Array, x: Array, p: Array
) -> tuple[float, float]:
    """Return the time of a readback by the sensor's clock, s, and the variance of that time."""
    late = settings.timing_states
    lasting = time[0] - time[2]
    delay, variance = settings.delay, 0.0
    if late[0] >= 0:
        delay += x[late[0]]
        variance += p[late[0], late[0]]
    if late[1] >= 0:
        delay += x[late[1]] * lasting
        variance += p[late[1], late[1]] * lasting * lasting
    if late[0] >= 0 and late[1] >= 0:
        variance += 2 * p[late[0], late[1]] * lasting
    when: float = time[0] - age - delay
    return when, float(variance)


@kernel_step
def align(
    e: int,
    readback: AttitudeReadback,
    settings: AttitudeSettings,
    state: AttitudeState,
    work: KernelWorkspace,
    to: Transition,
) -> None:
    """Take the attitude from the first readback after a gap.

    φ, and its parts of Φ and Q, are initialised again; all other states are kept.
    """
    when, variance = _readback_time(readback.age[e], settings, state.time, state.x, state.p)
    if when < state.time[4]:
        return
    state.alignment_due[0] = False
    then, rate, onto, past = work.half, work.rate, work.square, state.attitudes
    interpolate_attitude(
        state.times, past, state.newest_row[0], when, then, rate, work.turn, work.square
    )
    spread = settings.alignment_variance
    for k in range(3):
        spread += rate[k] * rate[k] * variance
    # All attitudes since then are corrected by the same rotation.
    for i in range(3):
        for j in range(3):
            onto[i, j] = 0.0
            for k in range(3):
                onto[i, j] += readback.attitude[e, i, k] * then[j, k]
    product(onto, state.c, then)
    copy_matrix(then, state.c)
    for row in range(len(past)):
        product(onto, past[row], then)
        copy_matrix(then, past[row])
    for k in range(3):
        for j in range(to.keep.size):
            to.a[k, j] = 0.0
        for j in range(3):
            to.driven[k, j] = spread if j == k else 0.0


@kernel_step
def update_by_readback(
    e: int,
    readback: AttitudeReadback,
    model: KernelModel,
    settings: AttitudeSettings,
    state: AttitudeState,
    work: KernelWorkspace,
    h: Array,
    gain: Array,
) -> None:
    """Write the readback minus the attitude at its time, linearised at the most probable value.

    `work.z`, rad, is h x + noise, and `work.variance`, rad², is the variance that the delay adds to
    the readback. If the delay is uncertain, z = h x is iterated at the estimated delay by the
    Gauss–Newton method. Source: Bell and Cathey 1993, IEEE TAC 38(2), 294–297.
    """
    z, spread = work.z, work.variance
    x, p = state.x, state.p
    when, variance = _readback_time(readback.age[e], settings, state.time, x, p)
    is_certain, before = variance <= MAX_LINEAR_DELAY * MAX_LINEAR_DELAY, np.inf
    for iteration in range(MAX_ITERATIONS + 1):
        _linearise(e, readback, model, settings, state, work, x, p, when, variance, h)
        is_found = is_certain or abs(when - before) < DELAY_TOLERANCE
        if is_found or iteration == MAX_ITERATIONS:
            return
        x, p, before = work.x, work.p, when
        for i in range(x.size):
            x[i] = state.x[i]
            for j in range(x.size):
                p[i, j] = state.p[i, j]
        for k in range(3):
            update(x, p, h[k], z[k], readback.variance[e] + spread[k], gain[k])
        when, variance = _readback_time(readback.age[e], settings, state.time, x, p)


@kernel_step
def _linearise(
    e: int,
    readback: AttitudeReadback,
    model: KernelModel,
    settings: AttitudeSettings,
    state: AttitudeState,
    work: KernelWorkspace,
    x: Array,
    p: Array,
    when: float,
    variance: float,
    h: Array,
) -> None:
    """Write the readback minus the attitude at its time, linearised at x with covariance p.

    The variance of the difference is larger if the rate changes. `when` is the time of the
    readback, and `variance` is the variance of this time.
    """
    z, spread, beside = work.z, work.variance, readback.table_sensitivity
    late = settings.timing_states
    times, past, sums, newest = (
        state.times, state.attitudes, state.sensitivity_integrals, state.newest_row[0],
    )  # fmt: skip
    axis, weights, used, then, rate, turn, fed = (
        model.terms.axis, model.terms.weights, work.used_terms, work.half, work.rate, work.turn,
        work.fed,
    )  # fmt: skip
    total, gm, lasting = work.total, 3 + axis.size, state.time[0] - state.time[2]
    own, components = gm + model.size, model.drift.times.size  # index of the first table parameter
    interpolate_attitude(times, past, newest, when, then, rate, turn, work.square)
    for k in range(3):
        spread[k] = turn[k] * turn[k]
    # The noise of rates at rest is not motion, but the filter would estimate a delay from it.
    noise = max(model.white[0], model.white[1], model.white[2])
    for k in range(3):
        if rate[k] * rate[k] * state.time[3] < REST_RATE_VARIANCES * noise:
            rate[k] = 0.0
    if variance > MAX_LINEAR_DELAY * MAX_LINEAR_DELAY:
        _add_delay_curvature(model, state, work, p, when, variance, spread)
    rotation_error(readback.attitude[e], then, z)
    before, after, share = bracketing_rows(times, newest, when)
    common = _neighbour_share(share) * (times[after] - times[before])
    for k in range(3):
        for b in range(3):
            spread[k] -= common * work.cm[3 * k + b] * model.white[b] * work.cm[3 * k + b]
        for j in range(x.size):
            h[k, j] = 1.0 if j == k else 0.0
        for j in range(beside.shape[2]):
            h[k, own + j] = beside[e, k, j]
        if late[0] >= 0:
            h[k, late[0]] = -rate[k]
            z[k] -= rate[k] * x[late[0]]
        if late[1] >= 0:
            h[k, late[1]] = -rate[k] * lasting
            z[k] -= rate[k] * x[late[1]] * lasting
        # φ at that time: its increments since then are subtracted.
        for i in range(used.size):
            b = used[i]
            for t in range(axis.size):
                weight, j = weights[t, b], axis[t]
                if weight != 0.0:
                    early, later = sums[before, b, 3 * k + j], sums[after, b, 3 * k + j]
                    since = early + share * (later - early) - total[b, 3 * k + j]
                    h[k, 3 + t] -= weight * since
        for j in range(3):
            early, later = sums[before, 0, 3 * k + j], sums[after, 0, 3 * k + j]
            since = total[0, 3 * k + j] - (early + share * (later - early))
            for c in range(components):
                h[k, gm + 3 * c + j] = since
            z[k] += since * fed[j]


@kernel_step
def _neighbour_share(x: float) -> float:
    """Return γ at a fraction x of a step, for parabolas at samples and a cubic between them."""
    u = min(max(x, 0.0), 1.0)
    u *= 1 - u
    return (22 + u * (58 / 3 + u * (224 / 9 + u * 137 / 18))) / 144


@kernel_step
def _add_delay_curvature(
    model: KernelModel,
    state: AttitudeState,
    work: KernelWorkspace,
    p: Array,
    when: float,
    variance: float,
    spread: Array,
) -> None:
    """Add the mean squares of second-order terms in an uncertain delay.

    The mean square of α δτ²/2 is 3/4 (α σ²)². For δω δτ, where δω is the rate error due to the
    coefficients, it is at most 3 σ² var(ω).
    """
    sd, times, newest, either = np.sqrt(variance), state.times, state.newest_row[0], work.either
    for side in range(2):
        other = when + sd if side == 0 else when - sd
        interpolate_attitude(
            times, state.attitudes, newest, other, work.other, either[2], work.turn, work.square
        )
        rotation_error(work.other, work.half, either[side])
    before, after, _ = bracketing_rows(times, newest, when)
    step = times[after] - times[before]
    axis, weights, used, row = model.terms.axis, model.terms.weights, work.used_terms, work.ph
    sums = state.sensitivity_integrals
    for k in range(3):
        spread[k] += 0.75 * (either[0, k] + either[1, k]) ** 2
        if step <= 0:
            continue
        for t in range(axis.size):
            row[t] = 0.0
            for i in range(used.size):
                b, at = used[i], 3 * k + axis[t]
                moved = sums[after, b, at] - sums[before, b, at]
                row[t] += weights[t, b] * moved / step
        for s in range(axis.size):
            for t in range(axis.size):
                spread[k] += 3 * variance * row[s] * p[3 + s, 3 + t] * row[t]


@kernel_step
def begin_epoch(state: AttitudeState, work: KernelWorkspace) -> None:
    """Make the sums in the ring buffer, −G, start at this epoch."""
    sums, total, used = state.sensitivity_integrals, work.total, work.used_terms
    for row in range(len(sums)):
        for t in range(used.size):
            b = used[t]
            for k in range(9):
                sums[row, b, k] -= total[b, k]


@kernel_step
def feed_back(model: KernelModel, state: AttitudeState, work: KernelWorkspace, lasts: bool) -> None:
    """Rotate the attitude by φ, and add the corrections to the coefficients.

    If `lasts`, the earlier attitudes in the ring buffer are rotated too.
    """
    x, theta, past, sums, turn = (
        state.x, state.theta, state.attitudes, state.sensitivity_integrals, work.turn,
    )  # fmt: skip
    axis, weights, used = model.terms.axis, model.terms.weights, work.used_terms
    by = work.reading_terms  # recomputed factors of φ in the readings
    sum_drift_components(x, 3 + axis.size, model.drift.times.size, turn)
    for i in range(used.size):
        for j in range(3):
            by[used[i], j] = turn[j] - work.fed[j] if used[i] == 0 else 0.0
        for s in range(axis.size):
            by[used[i], axis[s]] += weights[s, used[i]] * x[3 + s]
    for row in range(len(past) if lasts else 0):
        for k in range(3):
            turn[k] = x[k]
            for i in range(used.size):
                b = used[i]
                for j in range(3):
                    turn[k] -= sums[row, b, 3 * k + j] * by[b, j]
        turn_level(past[row], turn)
    for k in range(3):
        turn[k] = x[k]
        x[k] = 0.0
    turn_level(state.c, turn)
    for s in range(theta.size):
        theta[s] += x[3 + s]
        x[3 + s] = 0.0
