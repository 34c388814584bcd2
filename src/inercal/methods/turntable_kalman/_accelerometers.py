"""Compiled: the accelerometers' filter, sample by sample; the tests have its dense oracle.

States: δV (3), φ (3), p coefficients, drift of the biases (`turntable.drift`), q of the table's
parameters, and, where there are two more, the error of each hold's angles about east and north.

The attitude of a table at rest is constant, including the earth's turn, so the gyros are not used:
their errors would be taken for tilt. The specific force is known too, g along the vertical of that
attitude. Coefficients are multiplied by it and not by the corrected reading: the product of its
error with those of the coefficients is of second order and made a filter with a small variance of
the velocity diverge.
"""
# Numba's decorator has no types.
# pyright: reportUntypedFunctionDecorator=false

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from inercal.arrays import Array
from inercal.estimate.kalman import FilterSteps, store_covariance_rows, update
from inercal.methods.turntable.drift_propagation import propagate_drift, sum_drift_components
from inercal.methods.turntable.strapdown import (
    accumulate_sensitivity,
    copy_matrix,
    correct_reading,
    fill_force_terms,
    fill_temperature_terms,
    inverse_scale_matrix_at_temperature,
    product,
    rotation_error,
    turn_level,
    write_transition_columns,
)
from inercal.methods.turntable.terms import FORCE
from inercal.methods.turntable_kalman._filter_steps import (
    FilterSamples,
    KernelModel,
    KernelWorkspace,
    Transition,
    copy_slice,
    is_rejected,
    new_workspace,
    predict_covariance,
    update_workspace,
    white_noise_covariance,
    write_estimate,
)

Indices = NDArray[np.int64]


class VelocityReadback(NamedTuple):
    """At e samples, ascending; the first of each hold is among them."""

    epochs: Indices  # (e,)
    attitude: Array  # (e, 3, 3)
    table_sensitivity: Array  # (e, 2, q), ∂(φ as observed)/∂(the table's parameters)
    hold_variance: Array  # (e, 2) rad², variance of a hold's angles about east and north
    noise: Array  # (e, 2) rad², of the readback's noise


class VelocitySettings(NamedTuple):
    """Variances that are not in the model of the triad."""

    velocity_variance: float  # of velocity at rest, (m/s)²
    hold_attitude_variance: float  # of φ where a hold begins, rad²
    gate: float  # standard deviations beyond which an innovation of the readback is rejected


class VelocityState(NamedTuple):
    """The state of the filter. The part of x that is fed back is zero."""

    c: Array  # (3, 3)
    theta: Array  # (p,)
    x: Array  # (n,)
    p: Array  # (n, n)
    sensitivity_integral: Array  # (size of φ, 3, 3), Σ C M φ Δt since the epoch before
    time: Array  # (3,) s, of the sample and of the epoch before, and of the start
    force: Array  # (3,), of the sample before
    velocity: Array  # (3,) m/s
    hold: Indices  # (1,), number of the sample's before
    rejections: Indices  # (2,), readbacks rejected in a row, and in all
    nis: float = 0.0
    epochs: int = 0


class VelocityRun(NamedTuple):
    """The arguments of every step of the filter."""

    samples: FilterSamples
    readback: VelocityReadback
    model: KernelModel
    settings: VelocitySettings
    state: VelocityState
    workspace: KernelWorkspace


@njit(cache=True, nogil=True, error_model="numpy")
def run_accelerometer_filter(
    samples: FilterSamples,
    readback: VelocityReadback,
    model: KernelModel,
    settings: VelocitySettings,
    state: VelocityState,
    steps: FilterSteps,
    history: Array,
) -> float:
    """Run the accelerometers' filter over a piece of a recording; return the sum of NIS so far.

    Parameters
    ----------
    samples, readback, model, settings
    state : VelocityState
        Its arrays are changed in place.
    steps : FilterSteps
        Written at each epoch.
    history : (e, 6 + 2 n) array
        As of `run_gyro_filter`, with five observations.
    """
    x, p, theta = state.x, state.p, state.theta
    count, n = theta.size, x.size
    gm = 6 + count
    table, components, drift = gm + model.size, model.drift.times.size, np.zeros(3)
    sum_drift_components(x, gm, components, drift)
    run = VelocityRun(samples, readback, model, settings, state, new_workspace(model, theta, drift))
    _write_rest_force(run)
    drawn, driven, z, joint = np.zeros(n), np.zeros((6, 6)), np.zeros(5), np.zeros((components, 3))
    said = np.zeros(2)  # innovations of the readback
    # A literal 0 would have `_propagate_velocity` compiled a second time, for itself.
    total, first = state.nis, int(np.int64(0))
    for e in range(readback.epochs.size):
        row = e % len(steps.s)
        h, gain = steps.h[row], steps.gain[row]
        to = Transition(steps.a[row], steps.keep[row], driven, drawn, joint)
        here = samples.hold[readback.epochs[e]]
        first = _propagate_velocity(first, readback.epochs[e] + 1, run)
        if here != state.hold[0]:
            state.hold[0] = here
            _begin_hold(e, run, to)
            predict_covariance(model, gm, to, p)
            history[e, :6] = 0.0
            steps.s[row] = 0.0
        else:
            _transition(run, to)
            predict_covariance(model, gm, to, p)
            _observe(e, run, z, h)
            for k in range(2):
                said[k] = z[3 + k]
                for j in range(table, n):
                    said[k] -= h[3 + k, j] * x[j]
            if is_rejected(said, h[3:], p, readback.noise[e], settings.gate, state.rejections):
                history[e, :6] = 0.0
                steps.s[row] = 0.0
            else:
                nis = 0.0
                for k in range(5):
                    history[e, k] = z[k]
                    for j in range(table, n):
                        history[e, k] -= h[k, j] * x[j]
                    variance = settings.velocity_variance if k < 3 else readback.noise[e, k - 3]
                    off, s = update(x, p, h[k], z[k], variance, gain[k])
                    steps.off[row, k], steps.s[row, k] = off, s
                    nis += off * off / s
                history[e, 5] = nis
                total += nis
                _feed_back(run)
        sum_drift_components(x, gm, components, drift)
        update_workspace(run.workspace, model, theta, drift)
        _write_rest_force(run)
        elapsed, result = state.time[1] - state.time[2], history[e, 6:]
        write_estimate(model, elapsed, 6, theta, x, p, result[:n], result[n:])
        store_covariance_rows(p, steps, row)
    _propagate_velocity(first, samples.time.size, run)
    return total


@njit(cache=True, nogil=True, error_model="numpy")
def _write_rest_force(run: VelocityRun) -> None:
    """Write φ of the force that is sensed at rest, and C M: both stay until the next epoch."""
    state, done = run.state, run.workspace
    for k in range(3):
        done.u[k] = run.model.gravity * state.c[2, k]
    fill_force_terms(done.phi, done.u)
    product(state.c, done.m, done.cm)


@njit(cache=True, nogil=True, error_model="numpy")
def _propagate_velocity(first: int, end: int, run: VelocityRun) -> int:
    """Carry the velocity over a hold's samples, and sum up what drives it.

    Return the sample to follow.
    """
    # Access to a field of a tuple counts references: once here, not at each sample.
    samples, _readback, model, _settings, state, done = run
    time, forces, hold, warmth = samples
    terms, theta, warmed = model.terms, state.theta, warmth.size > 0
    used, m, by, phi, cm, mean, u = (
        done.used_terms, done.m, done.reading_terms, done.phi, done.cm, done.mean, done.u,
    )  # fmt: skip
    c, result, force, velocity = state.c, state.sensitivity_integral, state.force, state.velocity
    gravity, number, now = model.gravity, state.hold[0], state.time[0]
    for i in range(first, end):
        dt = time[i] - now
        now = time[i]
        if hold[i] >= 0 and hold[i] == number:
            for k in range(3):
                mean[k] = 0.5 * (forces[i, k] + force[k])
            if warmed:
                fill_temperature_terms(phi, warmth[i])
                inverse_scale_matrix_at_temperature(
                    terms.nominal, terms.axis, terms.weights, theta, FORCE, warmth[i], m
                )
                product(c, m, cm)
            correct_reading(mean, m, by, phi, used, FORCE, u)
            for k in range(3):
                gain = -gravity if k == 2 else 0.0
                for j in range(3):
                    gain += c[k, j] * u[j]
                velocity[k] += gain * dt
            accumulate_sensitivity(cm, phi, dt, used, result)
        for k in range(3):
            force[k] = forces[i, k]
    state.time[0] = now
    return end


@njit(cache=True, nogil=True, error_model="numpy")
def _begin_hold(e: int, run: VelocityRun, to: Transition) -> None:
    """Begin a hold: attitude from the table, velocity zero.

    Φ and Q keep the coefficients and the table's parameters, and propagate the drift; the states of
    the hold start anew.
    """
    _samples, readback, model, settings, state, _done = run
    a, keep, driven, drawn, joint = to
    gm = 6 + state.theta.size
    own = gm + model.size + readback.table_sensitivity.shape[2]  # where a hold's own error begins
    a[:] = 0.0
    driven[:] = 0.0
    keep[:] = 1.0
    drawn[:] = 0.0
    for k in range(3):
        driven[k, k] = settings.velocity_variance
        driven[3 + k, 3 + k] = settings.hold_attitude_variance
    for s in range(own, keep.size):
        keep[s], drawn[s] = 0.0, readback.hold_variance[e, s - own]
        state.x[s] = 0.0
    since = state.time[0] - state.time[1]
    propagate_drift(model.drift, since, gm, state.x, keep, drawn, joint)
    state.time[1] = state.time[0]
    state.velocity[:] = 0.0
    state.sensitivity_integral[:] = 0.0
    copy_matrix(readback.attitude[e], state.c)


@njit(cache=True, nogil=True, error_model="numpy")
def _transition(run: VelocityRun, to: Transition) -> None:
    """Write Φ and Q since the epoch before; begin a new epoch."""
    model, state, done = run.model, run.state, run.workspace
    a, keep, driven, drawn, joint = to
    terms, gravity = model.terms, model.gravity
    since = state.time[0] - state.time[1]
    state.time[1] = state.time[0]
    driven[:] = 0.0
    a[:] = 0.0
    keep[:] = 1.0
    drawn[:] = 0.0
    write_transition_columns(
        state.sensitivity_integral,
        terms.axis,
        terms.weights,
        done.used_terms,
        1.0,
        6,
        len(joint),
        a,
    )
    white_noise_covariance(done.cm, model.white, since, driven)
    for k in range(3):
        a[k, k] = a[3 + k, 3 + k] = 1.0
    propagate_drift(model.drift, since, 6 + terms.axis.size, state.x, keep, drawn, joint)
    # (0, 0, g) × φ. −[ω_ie×] is in neither: the velocity is relative to a table at rest.
    a[0, 4], a[1, 3] = -gravity * since, gravity * since


@njit(cache=True, nogil=True, error_model="numpy")
def _observe(e: int, run: VelocityRun, z: Array, h: Array) -> None:
    """Write the velocity, and the readback minus the attitude, as z = h x + noise."""
    _samples, readback, model, _settings, state, done = run
    beside, off = readback.table_sensitivity, done.scratch
    gm, q, n = 6 + state.theta.size, beside.shape[2], state.x.size
    own = gm + model.size + q
    copy_slice(state.velocity, 0, z[:3])
    rotation_error(readback.attitude[e], state.c, off)
    h[:] = 0.0
    for k in range(3):
        h[k, k] = 1.0
    for k in range(2):
        z[3 + k] = off[k]
        h[3 + k, 3 + k] = 1.0
        for j in range(q):
            h[3 + k, gm + model.size + j] = beside[e, k, j]
        if own < n:
            h[3 + k, own + k] = -1.0


@njit(cache=True, nogil=True, error_model="numpy")
def _feed_back(run: VelocityRun) -> None:
    """Correct velocity and attitude, and take in the coefficients."""
    state, turn = run.state, run.workspace.turn
    x, theta, velocity = state.x, state.theta, state.velocity
    for k in range(3):
        velocity[k] -= x[k]
    copy_slice(x, 3, turn)
    x[:6] = 0.0
    turn_level(state.c, turn)
    for s in range(theta.size):
        theta[s] += x[6 + s]
        x[6 + s] = 0.0
