"""Compiled: the gyros' filter, sample by sample; the tests have its dense oracle.

Rates are parabolas through the last three samples, with the second-order term of coning (Miller
1983, J. Guidance 6(4), 287–291). States: φ (3), p coefficients, drift of the biases
(`turntable.drift`), q of the table's parameters. `_readback` has the observation of φ.
"""

import numpy as np
from numpy.typing import NDArray

from inercal.arrays import Array
from inercal.estimate.kalman import FilterSteps, store_covariance_rows, update
from inercal.estimate.kernel_options import kernel, kernel_piece, kernel_step
from inercal.methods.turntable.drift_propagation import propagate_drift, sum_drift_components
from inercal.methods.turntable.strapdown import (
    PARABOLA_ERROR,
    PARABOLA_THRESHOLD,
    accumulate_sensitivity,
    are_similar_steps,
    copy_matrix,
    correct_reading,
    fill_force_terms,
    fill_temperature_terms,
    inverse_scale_matrix_at_temperature,
    product,
    rotate,
    write_transition_columns,
)
from inercal.methods.turntable.terms import FORCE, RATE, SQUARE, TEMPERATURE
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
    ReadbackTerms,
    align,
    begin_epoch,
    feed_back,
    observe,
)

Indices = NDArray[np.int64]


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
    """Run the gyros' filter over a piece of a recording; return the sum of NIS so far.

    Parameters
    ----------
    samples, readback, model, settings
    state : AttitudeState
        Its arrays are changed in place.
    work : KernelWorkspace
        Overwritten.
    steps : FilterSteps
        Written at each epoch.
    history : (e, 4 + 2 n) array
        Written at each epoch: innovations (3), NIS, the estimates (x with the coefficients
        in their place, φ zero) and their variances; a bias that drifts as the mean so far.
    """
    x, p, theta, fed = state.x, state.p, state.theta, work.fed
    n, gm, components = x.size, 3 + theta.size, model.drift.times.size
    for k in range(3):
        fed[k] = 0.0
    if settings.feedback:
        sum_drift_components(x, gm, components, fed)  # what readings are corrected by
    update_workspace(work, model.terms, theta)
    z, spread, innovation = work.z, work.variance, work.innovation
    # A literal 0 would have the loop over samples compiled a second time, for itself.
    total, first, epochs = state.nis, int(np.int64(0)), readback.epochs.size
    # One call for the samples to each epoch and those after the last: the compiler takes each call
    # for itself.
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
            observe(e, readback, model, settings, state, work, ReadbackTerms(z, spread, h), gain)
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
        # Rows of the ring that are written again before the next readback need no care.
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
        write_estimate(model.terms, model.drift, work, elapsed, theta, x, p, seen)
        store_covariance_rows(p, steps, row)
    return total


@kernel_piece
def _propagate_attitude(
    first: int,
    end: int,
    samples: FilterSamples,
    model: KernelModel,
    settings: AttitudeSettings,
    state: AttitudeState,
    work: KernelWorkspace,
) -> None:
    """Carry the attitude over samples, and sum up what drives φ."""
    time, rates, hold, warmth = samples
    terms, theta = model.terms, state.theta
    used, m, by, phi, cm, half, mean, u, turn, middle = (
        work.used_terms, work.m, work.reading_terms, work.phi, work.cm, work.half, work.mean,
        work.u, work.turn, work.rate,
    )  # fmt: skip
    c, result, before = state.c, state.sensitivity_integral, state.rates
    times, past = state.times, state.attitudes
    earth, white, gravity, gap = model.earth, model.white, model.gravity, settings.gap
    newest, now = state.newest_row[0], state.time[0]
    kinks, lost = state.acceleration_variance[0], state.alignment_due[0]
    sums, step, ended = state.sensitivity_integrals, state.time[3], state.time[4]
    squares, warmed = used[-1] >= SQUARE, warmth.size > 0
    for i in range(first, end):
        dt = time[i] - now
        if dt > gap:
            lost, ended = True, time[i]
        bends = are_similar_steps(dt, step)
        # Divisions cost more than all else here.
        square, per_step, per_two, per_last = dt * dt * (1 / 12), 0.0, 0.0, 0.0
        if bends:
            per_step, per_two, per_last = 1 / dt, 2 / (dt + step), 1 / step
        for k in range(3):
            phi[FORCE + k] = gravity * c[2, k]
            slope, earlier = rates[i, k] - before[0, k], before[0, k] - before[1, k]
            bend = (slope * per_step - earlier * per_last) * per_two
            mean[k] = 0.5 * (rates[i, k] + before[0, k]) - bend * square
            bent = (bend - before[2, k]) * dt * dt
            before[2, k] = bend
            if bent * bent * dt > PARABOLA_THRESHOLD * white[k]:
                kinks += (PARABOLA_ERROR * bent * dt) ** 2
        if squares:
            fill_force_terms(phi, phi[FORCE : FORCE + 3])
        if warmed:
            fill_temperature_terms(phi, warmth[i])
            inverse_scale_matrix_at_temperature(
                terms.nominal,
                terms.axis,
                terms.weights,
                theta,
                terms.first,
                warmth[i],
                work.square,
                m,
            )
        correct_reading(mean, m, by, phi, work.added_terms, u)
        # Rotation of the step relative to the level frame, and half of it.
        for k in range(3):
            around_earth = 0.0
            for j in range(3):
                around_earth += c[j, k] * earth[j]
            j1, j2 = (k + 1) % 3, (k + 2) % 3
            coning = before[0, j1] * rates[i, j2] - before[0, j2] * rates[i, j1]
            turn[k] = (u[k] - around_earth) * dt + coning * square
            middle[k] = 0.5 * turn[k]
            # About an axis at rest the sensed rate is the earth's. The reading is not used here:
            # its noise correlates with the angle's random walk, and the filter would estimate a
            # scale factor from the correlation.
            beyond = u[k] - around_earth
            still = hold[i] >= 0 or beyond * beyond * dt < REST_RATE_VARIANCES * white[k]
            phi[RATE + k] = around_earth if still else u[k]
            if warmed:
                phi[TEMPERATURE + RATE + k] = warmth[i] * phi[RATE + k]
        copy_matrix(c, half)
        rotate(half, middle)
        rotate(c, turn)
        product(half, m, cm)
        accumulate_sensitivity(cm, phi, dt, used, result)
        now, step, newest = time[i], dt, (newest + 1) % times.size
        for k in range(3):
            before[1, k], before[0, k] = before[0, k], rates[i, k]
        if i < end - times.size:
            continue  # its row is written again before a readback
        times[newest] = now
        copy_matrix(c, past[newest])
        for t in range(used.size):
            copy_matrix(result[used[t]], sums[newest, used[t]])
    state.newest_row[0], state.alignment_due[0] = newest, lost
    state.time[0], state.time[3], state.time[4] = now, step, ended
    state.acceleration_variance[0] = kinks


@kernel_piece
def _transition(
    model: KernelModel,
    settings: AttitudeSettings,
    state: AttitudeState,
    work: KernelWorkspace,
    to: Transition,
) -> None:
    """Write Φ and Q since the epoch before; begin a new epoch."""
    earth, terms, bent, result = (
        model.earth, model.terms, state.acceleration_variance[0], state.sensitivity_integral,
    )  # fmt: skip
    a, keep, driven, drawn, joint = to
    since = state.time[0] - state.time[1]
    state.time[1] = state.time[0]
    for t in range(work.used_terms.size):
        copy_matrix(result[work.used_terms[t]], work.total[work.used_terms[t]])
    for k in range(3):
        for j in range(keep.size):
            a[k, j] = 0.0
    write_transition_columns(
        result, terms.axis, terms.weights, work.used_terms, -1.0, len(driven), len(joint), a
    )
    white_noise_covariance(work.cm, model.white, since, driven)
    for k in range(3):
        a[k, k] = 1.0
        driven[k, k] += bent
    state.acceleration_variance[0] = 0.0
    gm = 3 + terms.axis.size
    propagate_drift(model.drift, since, gm, keep, drawn, joint)
    for s in range(gm, gm + model.size):
        state.x[s] *= keep[s]
    # −[ω_ie×] within an epoch.
    a[0, 1], a[0, 2], a[1, 2] = earth[2] * since, -earth[1] * since, earth[0] * since
    a[1, 0], a[2, 0], a[2, 1] = -a[0, 1], -a[0, 2], -a[1, 2]
    if settings.timing_states[2] >= 0:
        # The level frame is the table's: turned clockwise, the earth's rate has a part to the west.
        a[0, settings.timing_states[2]] = earth[1] * since


@kernel_piece
def _propagate_azimuth_error(settings: AttitudeSettings, x: Array, a: Array, moved: Array) -> None:
    """Propagate φ with the estimated azimuth: the attitude is propagated with the stated one."""
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
    """Propagate φ where it is not fed back."""
    for k in range(3):
        moved[k] = x[k]
        for s in range(x.size):
            moved[k] += (a[k, s] - (1.0 if s == k else 0.0)) * x[s]
    for k in range(3):
        x[k] = moved[k]
