"""Run the gyros' filter, sample by sample; the tests compare it with a plain version.

Rates are parabolas through the last three samples, with the second-order coning term (Miller 1983,
J. Guidance 6(4), 287–291). States: φ (3), p coefficients, drift of the biases (`turntable.drift`),
q table parameters. `_readback` contains the observation of φ.
"""

import numpy as np

from inercal.basics.arrays import Array
from inercal.estimation.kalman import FilterSteps, store_covariance_rows, update
from inercal.estimation.kernel_options import kernel, kernel_step, kernel_value
from inercal.methods.turntable import FORCE, RATE, SQUARE, TEMPERATURE
from inercal.methods.turntable.drift_propagation import propagate_drift, sum_drift_components
from inercal.methods.turntable.small_matrices import (
    Vector,
    copy_row,
    cross,
    matrix,
    times_matrix,
    transposed_times,
    vector,
    write_matrix,
    write_row,
    write_vector,
)
from inercal.methods.turntable.strapdown import (
    PARABOLA_ERROR,
    PARABOLA_THRESHOLD,
    accumulate_sensitivity,
    are_similar_steps,
    correct_reading,
    fill_force_terms,
    fill_temperature_terms,
    inverse_scale_matrix,
    turned,
    write_transition_columns,
)
from inercal.methods.turntable_kalman._filter_steps import (
    FilterSamples,
    KernelModel,
    KernelWorkspace,
    Transition,
    is_rejected,
    predict_covariance,
    update_workspace,
    white_noise_covariance,
    write_estimate,
)
from inercal.methods.turntable_kalman._readback import (
    REST_RATE_VARIANCES,
    AttitudeReadback,
    AttitudeSettings,
    AttitudeState,
    align,
    begin_epoch,
    feed_back,
    update_by_readback,
)


@kernel
def run_gyro_filter(
    samples: FilterSamples,
    readback: AttitudeReadback,
    model: KernelModel,
    settings: AttitudeSettings,
    state: AttitudeState,
    work: KernelWorkspace,
    steps: FilterSteps,
    history: Array,
) -> float:
    """Run the gyro filter over a piece of a recording and return the sum of NIS so far.

    Parameters
    ----------
    samples, readback, model, settings
    state : AttitudeState
        Its arrays are changed in place.
    work : KernelWorkspace
        Work arrays, which are overwritten.
    steps : FilterSteps
        Written at each epoch.
    history : (e, 4 + 2 n) array
        Written at each epoch: innovations (3), NIS, the estimates (x with the coefficients inserted
        and φ zero) and their variances. The estimate of a drifting bias is its mean so far.
    """
    x, p, theta, fed = state.x, state.p, state.theta, work.fed
    n, gm, components = x.size, 3 + theta.size, model.drift.times.size
    for k in range(3):
        fed[k] = 0.0
    if settings.feedback:
        sum_drift_components(x, gm, components, fed)  # drift that readings are corrected for
    update_workspace(work, model.terms, theta)
    z, spread, innovation = work.z, work.variance, work.innovation
    # A literal 0 would cause the loop over samples to be compiled a second time.
    total, first, epochs = state.nis, int(np.int64(0)), readback.epochs.size
    # One call for the samples up to each epoch and for those after the last, because the compiler
    # compiles each call separately.
    for e in range(epochs + 1):
        end = readback.epochs[e] + 1 if e < epochs else samples.time.size
        _propagate_attitude(first, end, samples, model, settings, state, work)
        if e == epochs:
            break
        first, row, seen = end, e % len(steps.s), history[e]
        h, gain = steps.h[row], steps.gain[row]
        to = Transition(steps.a[row], steps.keep[row], work.driven, work.drawn, work.joint)
        _transition(model, settings, state, work, to)
        lost = state.alignment_due[0]
        if lost:
            align(e, readback, settings, state, work, to)
        if settings.feedback:
            _propagate_azimuth_error(settings, x, to.a, work.turn)
        else:
            _propagate_error(x, to.a, work.turn)
        predict_covariance(model.drift, gm, to, work.moved, p)
        nis = 0.0
        if not lost:
            update_by_readback(e, readback, model, settings, state, work, h, gain)
            for k in range(3):
                innovation[k] = z[k]
                for j in range(n):
                    innovation[k] -= h[k, j] * x[j]
                spread[k] += readback.variance[e]
            lost = is_rejected(
                innovation, h, p, spread, settings.gate, state.rejections, work.p, work.x, work.ph
            )
        for k in range(3):
            if lost:
                seen[k] = steps.s[row, k] = 0.0
            else:
                seen[k] = innovation[k]
                off, s = update(x, p, h[k], z[k], spread[k], gain[k])
                steps.off[row, k], steps.s[row, k] = off, s
                nis += off * off / s
        seen[3] = nis
        total += nis
        # Rows of the ring that are rewritten before the next readback can be ignored.
        following = readback.epochs[e + 1] + 1 if e + 1 < epochs else samples.time.size
        lasts = following - end < state.times.size
        if lasts:
            begin_epoch(state, work)
        if settings.feedback:
            if not lost:
                feed_back(model, state, work, lasts)
            sum_drift_components(x, gm, components, fed)
        update_workspace(work, model.terms, theta)
        elapsed = state.time[1] - state.time[2]
        write_estimate(model, work, elapsed, theta, x, p, seen)
        store_covariance_rows(p, steps, row)
    return total


@kernel_step
def _propagate_attitude(
    first: int,
    end: int,
    samples: FilterSamples,
    model: KernelModel,
    settings: AttitudeSettings,
    state: AttitudeState,
    work: KernelWorkspace,
) -> None:
    """Propagate the attitude over samples, and sum the sensitivities of φ."""
    time, rates = samples.time, samples.reading
    hold, warmth = samples.hold, samples.temperature_offset
    terms, theta = model.terms, state.theta
    used, m, by, phi = work.used_terms, work.m, work.reading_terms, work.phi
    result, before = state.sensitivity_integral, state.rates
    times, past = state.times, state.attitudes
    earth, white, gravity, gap = vector(model.earth), model.white, model.gravity, settings.gap
    newest, now = state.newest_row[0], state.time[0]
    kinks, lost = state.acceleration_variance[0], state.alignment_due[0]
    sums, step, ended = state.sensitivity_integrals, state.time[3], state.time[4]
    squares, warmed = used[-1] >= SQUARE, warmth.size > 0
    c, inverse, cm = matrix(state.c), matrix(m), work.cm
    newer, older, bend = vector(before[0]), vector(before[1]), vector(before[2])
    third, early = vector(before[3]), vector(before[4])
    for i in range(first, end):
        dt = time[i] - now
        if dt > gap:
            lost, ended = True, time[i]
        reading = vector(rates[i])
        mean, bent = _parabola_mean(reading, newer, older, dt, step)
        square = dt * dt
        latest = (
            (bent[0] - bend[0]) * square,
            (bent[1] - bend[1]) * square,
            (bent[2] - bend[2]) * square,
        )
        kinks += _kink_variance(latest, third, early, dt, white)
        bend, third, early = bent, latest, third
        force = gravity * c[6], gravity * c[7], gravity * c[8]
        phi[FORCE], phi[FORCE + 1], phi[FORCE + 2] = force
        if squares:
            fill_force_terms(phi, force)
        if warmed:
            fill_temperature_terms(phi, warmth[i])
            inverse_scale_matrix(terms, theta, warmth[i], work.square, m)
            inverse = matrix(m)
        u = correct_reading(mean, inverse, by, phi, work.added_terms)
        # Rotation of the step relative to the level frame, and half of it.
        around = transposed_times(c, earth)
        coning = cross(newer, reading)
        square *= 1 / 12
        beyond = u[0] - around[0], u[1] - around[1], u[2] - around[2]
        turn = (
            beyond[0] * dt + coning[0] * square,
            beyond[1] * dt + coning[1] * square,
            beyond[2] * dt + coning[2] * square,
        )
        # About a stationary axis the sensed rate is the earth's. The reading is not used here,
        # because its noise correlates with the angle's random walk, and the filter would estimate a
        # scale factor from the correlation.
        rests, scale = hold[i] >= 0, dt / REST_RATE_VARIANCES
        still = rests or beyond[0] * beyond[0] * scale < white[0]
        phi[RATE] = around[0] if still else u[0]
        still = rests or beyond[1] * beyond[1] * scale < white[1]
        phi[RATE + 1] = around[1] if still else u[1]
        still = rests or beyond[2] * beyond[2] * scale < white[2]
        phi[RATE + 2] = around[2] if still else u[2]
        if warmed:
            for k in range(RATE, RATE + 3):
                phi[TEMPERATURE + k] = warmth[i] * phi[k]
        half = turned(c, (0.5 * turn[0], 0.5 * turn[1], 0.5 * turn[2]))
        write_row(times_matrix(half, inverse), cm)
        c = turned(c, turn)
        accumulate_sensitivity(cm, phi, dt, used, result)
        now, step, newest = time[i], dt, (newest + 1) % times.size
        older, newer = newer, reading
        if i < end - times.size:
            continue  # its row is rewritten before a readback
        times[newest] = now
        write_matrix(c, past[newest])
        for t in range(used.size):
            copy_row(result[used[t]], sums[newest, used[t]])
    write_matrix(c, state.c)
    write_vector(newer, before[0])
    write_vector(older, before[1])
    write_vector(bend, before[2])
    write_vector(third, before[3])
    write_vector(early, before[4])
    state.newest_row[0], state.alignment_due[0] = newest, lost
    state.time[0], state.time[3], state.time[4] = now, step, ended
    state.acceleration_variance[0] = kinks


@kernel_value
def _parabola_mean(
    now: Vector, before: Vector, earlier: Vector, dt: float, step: float
) -> tuple[Vector, Vector]:
    """Return the last step's mean of the parabola through three rates, and its curvature.

    `dt` is the last time step and `step` the time step before it, s.
    """
    # Divisions are the most expensive operations here.
    per_step, per_two, per_last = 0.0, 0.0, 0.0
    if are_similar_steps(dt, step):
        per_step, per_two, per_last = 1 / dt, 2 / (dt + step), 1 / step
    square = dt * dt * (1 / 12)
    x = ((now[0] - before[0]) * per_step - (before[0] - earlier[0]) * per_last) * per_two
    y = ((now[1] - before[1]) * per_step - (before[1] - earlier[1]) * per_last) * per_two
    z = ((now[2] - before[2]) * per_step - (before[2] - earlier[2]) * per_last) * per_two
    mean = (
        0.5 * (now[0] + before[0]) - x * square,
        0.5 * (now[1] + before[1]) - y * square,
        0.5 * (now[2] + before[2]) - z * square,
    )
    return mean, (x, y, z)


@kernel_value
def _kink_variance(a: Vector, b: Vector, c: Vector, dt: float, white: Array) -> float:
    """Return the variance of the angle if an acceleration began or ended in a step, rad².

    a, b and c are the last third differences, rad/s.
    """
    x = a[0] * a[0] + b[0] * b[0] + c[0] * c[0]
    y = a[1] * a[1] + b[1] * b[1] + c[1] * c[1]
    z = a[2] * a[2] + b[2] * b[2] + c[2] * c[2]
    total, least = 0.0, PARABOLA_THRESHOLD / dt
    if x > least * white[0]:
        total += max(x - 2 * (a[0] + b[0] + c[0]) * (a[0] + b[0] + c[0]), 0.0)
    if y > least * white[1]:
        total += max(y - 2 * (a[1] + b[1] + c[1]) * (a[1] + b[1] + c[1]), 0.0)
    if z > least * white[2]:
        total += max(z - 2 * (a[2] + b[2] + c[2]) * (a[2] + b[2] + c[2]), 0.0)
    return total * (PARABOLA_ERROR * dt) ** 2


@kernel_step
def _transition(
    model: KernelModel,
    settings: AttitudeSettings,
    state: AttitudeState,
    work: KernelWorkspace,
    to: Transition,
) -> None:
    """Write Φ and Q since the epoch before, and start a new epoch."""
    earth, terms, bent, result = (
        model.earth, model.terms, state.acceleration_variance[0], state.sensitivity_integral,
    )  # fmt: skip
    a, keep, driven, drawn, joint = to
    since = state.time[0] - state.time[1]
    state.time[1] = state.time[0]
    for t in range(work.used_terms.size):
        copy_row(result[work.used_terms[t]], work.total[work.used_terms[t]])
    for k in range(3):
        for j in range(keep.size):
            a[k, j] = 0.0
    write_transition_columns(result, terms, work.used_terms, -1.0, len(joint), a)
    white_noise_covariance(work.cm, model.white, since, driven)
    for k in range(3):
        a[k, k] = 1.0
        driven[k, k] += bent
    state.acceleration_variance[0] = 0.0
    gm = 3 + terms.axis.size
    propagate_drift(model.drift, since, gm, keep, drawn, joint)
    for s in range(gm, gm + model.size):
        state.x[s] *= keep[s]
    # The effect of −[ω_ie×] within an epoch.
    a[0, 1], a[0, 2], a[1, 2] = earth[2] * since, -earth[1] * since, earth[0] * since
    a[1, 0], a[2, 0], a[2, 1] = -a[0, 1], -a[0, 2], -a[1, 2]
    if settings.timing_states[2] >= 0:
        # The level frame is the table's. If the table is turned clockwise, the earth rate has a
        # western component.
        a[0, settings.timing_states[2]] = earth[1] * since


@kernel_step
def _propagate_azimuth_error(settings: AttitudeSettings, x: Array, a: Array, moved: Array) -> None:
    """Propagate φ with the estimated azimuth, because the attitude uses the stated one."""
    azimuth = settings.timing_states[2]
    if azimuth < 0:
        return
    for k in range(3):
        moved[k] = a[k, azimuth] * (x[azimuth] - settings.azimuth)
        for j in range(3):
            moved[k] += a[k, j] * x[j]
    for k in range(3):
        x[k] = moved[k]


@kernel_step
def _propagate_error(x: Array, a: Array, moved: Array) -> None:
    """Propagate φ if it is not fed back."""
    for k in range(3):
        moved[k] = x[k]
        for s in range(x.size):
            moved[k] += (a[k, s] - (1.0 if s == k else 0.0)) * x[s]
    for k in range(3):
        x[k] = moved[k]
