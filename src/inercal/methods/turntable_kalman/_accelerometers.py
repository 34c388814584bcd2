"""Run the accelerometers' filter, sample by sample; the tests compare it with a plain version.

States: δV (3), φ (3), p coefficients, drift of the biases (`turntable.drift`), q table parameters,
and optionally two states for the error of each hold's angles about east and north.

The attitude of a stationary table is constant, including the earth's rotation. The gyros are
therefore not used, because their errors would be mistaken for tilt. The specific force is also
known: g along the vertical of this attitude. The filter multiplies the coefficients by this known
force instead of the corrected reading. With the corrected reading, the product of its error and the
coefficients' errors is of second order, and this product made a filter with a small velocity
variance diverge. Because the known force is constant, each reading counts in one step only, whereas
a trapezoid would spread its noise over two steps.
"""

from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.estimation.kalman import FilterSteps, store_covariance_rows, update
from inercal.estimation.kernel_options import kernel, kernel_step, record
from inercal.methods.turntable.drift_propagation import propagate_drift, sum_drift_components
from inercal.methods.turntable.small_matrices import (
    copy_matrix,
    matrix,
    times_matrix,
    times_vector,
    vector,
    write_row,
    write_vector,
)
from inercal.methods.turntable.strapdown import (
    accumulate_sensitivity,
    correct_reading,
    fill_force_terms,
    fill_temperature_terms,
    inverse_scale_matrix,
    rotation_error,
    turn_level,
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


@record
class VelocityReadback(NamedTuple):
    """The readback at e samples, ascending, which include the first sample of each hold."""

    epochs: Indices  # (e,)
    attitude: Array  # (e, 3, 3)
    # (e, 2, 2), horizontal directions, level frame, about which the readback's noise is independent
    directions: Array
    table_sensitivity: Array  # (e, 2, q), ∂(observed φ about them)/∂(the table's parameters)
    hold_variance: Array  # (e, 2) rad², variance of a hold's angles about east and north
    noise: Array  # (e, 2) rad², variance of the readback's noise about the directions


@record
class VelocitySettings(NamedTuple):
    """Variances that the model of the triad does not contain."""

    velocity_variance: float  # of the velocity at rest, (m/s)²
    hold_attitude_variance: float  # of φ at the start of a hold, rad²
    gate: float  # standard deviations above which a readback innovation is rejected


@record
class VelocityState(NamedTuple):
    """The state of the filter. The part of x that is fed back is zero."""

    c: Array  # (3, 3)
    theta: Array  # (p,)
    x: Array  # (n,)
    p: Array  # (n, n)
    sensitivity_integral: Array  # (size of φ, 9), Σ C M φ Δt since the epoch before
    time: Array  # (3,) s, of the sample before, the epoch before, and the start
    velocity: Array  # (3,) m/s
    hold: Indices  # (1,), index of the hold of the sample before
    rejections: Indices  # (2,), readbacks rejected in a row, and in total
    nis: float = 0.0
    dof: int = 0  # of NIS, if the coefficients are treated as known


@kernel
def run_accelerometer_filter(
    samples: FilterSamples,
    readback: VelocityReadback,
    model: KernelModel,
    settings: VelocitySettings,
    state: VelocityState,
    work: KernelWorkspace,
    steps: FilterSteps,
    history: Array,
) -> float:
    """Run the accelerometer filter over a piece of a recording and return the sum of NIS so far.

    Parameters
    ----------
    samples, readback, model, settings
    state : VelocityState
        Its arrays are changed in place.
    work : KernelWorkspace
        Work arrays, which are overwritten.
    steps : FilterSteps
        Written at each epoch.
    history : (e, 6 + 2 n) array
        The same as for `run_gyro_filter`, with five observations.
    """
    x, p, theta, fed = state.x, state.p, state.theta, work.fed
    n, gm = x.size, 6 + theta.size
    table, components = gm + model.size, model.drift.times.size
    sum_drift_components(x, gm, components, fed)
    update_workspace(work, model.terms, theta)
    _write_rest_force(model.gravity, state.c, work)
    z, innovation, variance = work.z, work.innovation, work.variance
    # A literal 0 would cause the loop over samples to be compiled a second time.
    total, first, epochs = state.nis, int(np.int64(0)), readback.epochs.size
    # One call for the samples up to each epoch and for those after the last, because the compiler
    # compiles each call separately.
    for e in range(epochs + 1):
        end = readback.epochs[e] + 1 if e < epochs else samples.time.size
        _propagate_velocity(first, end, samples, model, state, work)
        if e == epochs:
            break
        first, row, seen = end, e % len(steps.s), history[e]
        h, gain = steps.h[row], steps.gain[row]
        to = Transition(steps.a[row], steps.keep[row], work.driven, work.drawn, work.joint)
        here = samples.hold[readback.epochs[e]]
        begins = here != state.hold[0]
        if begins:
            state.hold[0] = here
            _begin_hold(e, readback, model, settings, state, to)
        else:
            _transition(model, state, work, to)
        predict_covariance(model.drift, gm, to, work.moved, p)
        nis, lost = 0.0, begins
        if not lost:
            _update_by_readback(e, readback, model, state, work, h)
            for k in range(5):
                variance[k] = settings.velocity_variance if k < 3 else readback.noise[e, k - 3]
                innovation[k] = z[k]
                for j in range(table, n):
                    innovation[k] -= h[k, j] * x[j]
            lost = is_rejected(
                innovation[3:], h[3:], p, variance[3:], settings.gate, state.rejections,
                work.p, work.x, work.ph,
            )  # fmt: skip
        for k in range(5):
            if lost:
                seen[k] = steps.s[row, k] = 0.0
            else:
                seen[k] = z[k]
                for j in range(table, n):
                    seen[k] -= h[k, j] * x[j]
                off, s = update(x, p, h[k], z[k], variance[k], gain[k])
                steps.off[row, k], steps.s[row, k] = off, s
                nis += off * off / s
        seen[5] = nis
        total += nis
        if not lost:
            _feed_back(state, work.turn)
        sum_drift_components(x, gm, components, fed)
        update_workspace(work, model.terms, theta)
        _write_rest_force(model.gravity, state.c, work)
        elapsed = state.time[1] - state.time[2]
        write_estimate(model, work, elapsed, theta, x, p, seen)
        store_covariance_rows(p, steps, row)
    return total


@kernel_step
def _write_rest_force(gravity: float, c: Array, work: KernelWorkspace) -> None:
    """Write φ for the force sensed at rest, and C M; both are constant until the next epoch."""
    fill_force_terms(work.phi, (gravity * c[2, 0], gravity * c[2, 1], gravity * c[2, 2]))
    write_row(times_matrix(matrix(c), matrix(work.m)), work.cm)


@kernel_step
def _propagate_velocity(
    first: int,
    end: int,
    samples: FilterSamples,
    model: KernelModel,
    state: VelocityState,
    work: KernelWorkspace,
) -> None:
    """Propagate the velocity over a hold's samples, and sum its sensitivities."""
    time, forces = samples.time, samples.reading
    hold, warmth = samples.hold, samples.temperature_offset
    terms, theta, warmed = model.terms, state.theta, warmth.size > 0
    used, m, by, phi = work.used_terms, work.m, work.reading_terms, work.phi
    result = state.sensitivity_integral
    c, velocity = matrix(state.c), vector(state.velocity)
    inverse, cm = matrix(m), work.cm
    gravity, number, now = model.gravity, state.hold[0], state.time[0]
    for i in range(first, end):
        dt, now = time[i] - now, time[i]
        if hold[i] >= 0 and hold[i] == number:
            if warmed:
                fill_temperature_terms(phi, warmth[i])
                inverse_scale_matrix(terms, theta, warmth[i], work.square, m)
                inverse = matrix(m)
                write_row(times_matrix(c, inverse), cm)
            f = correct_reading(vector(forces[i]), inverse, by, phi, work.added_terms)
            gain = times_vector(c, f)
            velocity = (
                velocity[0] + gain[0] * dt,
                velocity[1] + gain[1] * dt,
                velocity[2] + (gain[2] - gravity) * dt,
            )
            accumulate_sensitivity(cm, phi, dt, used, result)
    write_vector(velocity, state.velocity)
    state.time[0] = now


@kernel_step
def _begin_hold(
    e: int,
    readback: VelocityReadback,
    model: KernelModel,
    settings: VelocitySettings,
    state: VelocityState,
    to: Transition,
) -> None:
    """Start a hold, with the attitude from the table and zero velocity.

    Φ and Q leave the coefficients and the table's parameters unchanged, and propagate the drift.
    The states of the hold are initialised again.
    """
    _a, keep, driven, drawn, joint = to
    gm = 6 + state.theta.size
    own = gm + model.size + readback.table_sensitivity.shape[2]  # index of a hold's own error
    _clear(to)
    for k in range(3):
        driven[k, k] = settings.velocity_variance
        driven[3 + k, 3 + k] = settings.hold_attitude_variance
    for s in range(own, keep.size):
        keep[s], drawn[s] = 0.0, readback.hold_variance[e, s - own]
        state.x[s] = 0.0
    since = state.time[0] - state.time[1]
    propagate_drift(model.drift, since, gm, keep, drawn, joint)
    for s in range(gm, gm + model.size):
        state.x[s] *= keep[s]
    state.time[1] = state.time[0]
    sums = state.sensitivity_integral
    for k in range(3):
        state.velocity[k] = 0.0
    for b in range(len(sums)):
        for k in range(9):
            sums[b, k] = 0.0
    copy_matrix(readback.attitude[e], state.c)


@kernel_step
def _clear(to: Transition) -> None:
    """Write Φ for constant states, with zeros in its dense part, and zero noise."""
    a, keep, driven, drawn, _joint = to
    for k in range(len(a)):
        for j in range(keep.size):
            a[k, j] = 0.0
        for j in range(len(a)):
            driven[k, j] = 0.0
    for j in range(keep.size):
        keep[j], drawn[j] = 1.0, 0.0


@kernel_step
def _transition(
    model: KernelModel, state: VelocityState, work: KernelWorkspace, to: Transition
) -> None:
    """Write Φ and Q since the epoch before, and start a new epoch."""
    a, keep, driven, drawn, joint = to
    terms, gravity = model.terms, model.gravity
    since = state.time[0] - state.time[1]
    state.time[1] = state.time[0]
    _clear(to)
    sums = state.sensitivity_integral
    write_transition_columns(sums, terms, work.used_terms, 1.0, len(joint), a)
    white_noise_covariance(work.cm, model.white, since, driven)
    for k in range(3):
        a[k, k] = a[3 + k, 3 + k] = 1.0
    gm = 6 + terms.axis.size
    propagate_drift(model.drift, since, gm, keep, drawn, joint)
    for s in range(gm, gm + model.size):
        state.x[s] *= keep[s]
    # The force error is (0, 0, g) × φ. −[ω_ie×] is left out for both states, because the velocity
    # is relative to a table at rest.
    a[0, 4], a[1, 3] = -gravity * since, gravity * since


@kernel_step
def _update_by_readback(
    e: int,
    readback: VelocityReadback,
    model: KernelModel,
    state: VelocityState,
    work: KernelWorkspace,
    h: Array,
) -> None:
    """Write the velocity, and the readback minus the attitude, as z = h x + noise."""
    beside, off, z = readback.table_sensitivity, work.rate, work.z
    gm, q, n = 6 + state.theta.size, beside.shape[2], state.x.size
    own = gm + model.size + q
    rotation_error(readback.attitude[e], state.c, off)
    for k in range(5):
        for j in range(n):
            h[k, j] = 0.0
    for k in range(3):
        z[k] = state.velocity[k]
        h[k, k] = 1.0
    for k in range(2):
        z[3 + k] = 0.0
        for j in range(2):
            along = readback.directions[e, k, j]
            z[3 + k] += along * off[j]
            h[3 + k, 3 + j] = along
            if own < n:
                h[3 + k, own + j] = -along
        for j in range(q):
            h[3 + k, gm + model.size + j] = beside[e, k, j]


@kernel_step
def _feed_back(state: VelocityState, turn: Array) -> None:
    """Correct the velocity and attitude, and update the coefficients."""
    x, theta, velocity = state.x, state.theta, state.velocity
    for k in range(3):
        velocity[k] -= x[k]
        turn[k] = x[3 + k]
        x[k] = x[3 + k] = 0.0
    turn_level(state.c, turn)
    for s in range(theta.size):
        theta[s] += x[6 + s]
        x[6 + s] = 0.0
