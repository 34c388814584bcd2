"""Compiled: the arguments of both filters' kernels, and the steps that they share.

Kernels change arrays in place, so that a recording may be processed in pieces.

Each kernel has its own loop over epochs. A common loop would take the filter's steps as functions,
and Numba caches no kernel that has functions among its arguments: each process would compile it
again. A loop in Python over compiled steps would cost several calls of 10 µs per epoch of 30 µs.
"""
# Numba's decorator has no types.
# pyright: reportUntypedFunctionDecorator=false

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from inercal.arrays import Array
from inercal.estimate.kalman import predict
from inercal.methods.turntable.drift import Drift
from inercal.methods.turntable.drift_propagation import add_drift_cross_covariance
from inercal.methods.turntable.strapdown import (
    inverse_scale_matrix,
    sum_reading_terms,
    used_term_indices,
)
from inercal.methods.turntable.terms import BIAS, Terms

Indices = NDArray[np.int64]
# Standard deviations of an epoch's innovation. Chance exceeds it in one of 900 epochs, which costs
# nothing; an error of five must not be used where the noise hides part of it.
INNOVATION_GATE = 4.0
MAX_REJECTIONS = 3  # in a row


class FilterSamples(NamedTuple):
    """Of n samples."""

    time: Array  # (n,) s
    reading: Array  # (n, 3), m/s² or rad/s
    hold: Indices  # (n,), number of the hold; negative while the table moves
    temperature_offset: Array  # (n,) K, ΔT; (0,) of a sensor that does not depend on it


class KernelModel(NamedTuple):
    """The model of three axes at a place."""

    terms: Terms
    white: Array  # (3,), variance of the integral of the noise, SI²/s
    drift: Drift  # of the biases
    size: int  # of the drift's states
    earth: Array  # (3,) rad/s, level frame
    gravity: float  # m/s²


class Transition(NamedTuple):
    """From one epoch to the next: Φ and Q as `kalman.predict` takes them."""

    a: Array
    keep: Array
    driven: Array
    drawn: Array
    joint: Array  # (components, 3), covariance of the drift's noise with that of J


class KernelWorkspace(NamedTuple):
    """Arrays for intermediate results of a kernel, allocated once."""

    used_terms: Indices  # the terms of φ that the coefficients use
    m: Array  # M, (3, 3)
    reading_terms: Array  # factor of each term of φ in the readings, (size of φ, 3)
    phi: Array  # φ of the last step, (size of φ,)
    cm: Array  # C M in its middle, (3, 3)
    half: Array  # C in its middle, (3, 3)
    mean: Array  # reading, (3,)
    u: Array  # as corrected, (3,)
    turn: Array  # rotation vectors, (3,)
    scratch: Array


@njit(cache=True, nogil=True, error_model="numpy")
def new_workspace(model: KernelModel, theta: Array, drift: Array) -> KernelWorkspace:
    """Return the workspace for coefficients (p,) and the drift of the biases (3,)."""
    size = model.terms.weights.shape[1]
    result = KernelWorkspace(
        used_term_indices(model.terms.weights),
        np.zeros((3, 3)),
        np.zeros((size, 3)),
        np.zeros(size),
        np.zeros((3, 3)),
        np.zeros((3, 3)),
        np.zeros(3),
        np.zeros(3),
        np.zeros(3),
        np.zeros(3),
    )
    result.phi[0] = 1.0
    update_workspace(result, model, theta, drift)
    return result


@njit(cache=True, nogil=True, error_model="numpy")
def update_workspace(work: KernelWorkspace, model: KernelModel, theta: Array, drift: Array) -> None:
    """Write M and the factors of φ by the present estimates."""
    terms = model.terms
    inverse_scale_matrix(terms.nominal, terms.axis, terms.weights, theta, terms.first, work.m)
    sum_reading_terms(terms.axis, terms.weights, theta, drift, work.used_terms, work.reading_terms)


@njit(cache=True, nogil=True, error_model="numpy")
def predict_covariance(model: KernelModel, first: int, to: Transition, p: Array) -> None:
    """Carry a covariance to the next epoch, in place; the drift's states begin at `first`."""
    predict(p, to.a, to.keep, to.driven, to.drawn)
    add_drift_cross_covariance(model.drift, first, to.joint, p)


@njit(cache=True, nogil=True, error_model="numpy")
def is_rejected(
    innovation: Array, h: Array, p: Array, variance: Array, gate: float, rejections: Indices
) -> bool:
    """Tell whether observations are rejected, νᵀ S⁻¹ ν > gate² with S = H P Hᵀ + R; count them.

    After `MAX_REJECTIONS` in a row the next ones are taken: what differs for longer is no false
    reading, and the NIS is to show it.

    Parameters
    ----------
    innovation : (m,) array
        ν.
    h : (m, n) array
    p : (n, n) array
    variance : (m,) array
        Diagonal of R.
    gate : float
        Standard deviations; infinite where nothing is rejected.
    rejections : (2,) array of int
        In a row, and in all; changed in place.
    """
    m, n, most = innovation.size, p.shape[0], gate * gate
    distance = 0.0
    for k in range(m):
        distance += innovation[k] * innovation[k] / variance[k]
    # S is no less than R, and costs m n² to know.
    if distance > most:
        s, ph = np.zeros((m, m)), np.zeros(n)
        for k in range(m):
            for j in range(n):
                ph[j] = 0.0
            for i in range(n):
                if h[k, i] != 0.0:
                    for j in range(n):
                        ph[j] += h[k, i] * p[i, j]
            s[k, k] = variance[k]
            for q in range(m):
                for j in range(n):
                    s[k, q] += ph[j] * h[q, j]
        distance = 0.0
        rest = innovation.copy()
        for k in range(m):  # elimination: the square of each part that those before do not tell
            distance += rest[k] * rest[k] / s[k, k]
            for q in range(k + 1, m):
                share = s[q, k] / s[k, k]
                rest[q] -= share * rest[k]
                for j in range(k + 1, m):
                    s[q, j] -= share * s[k, j]
    if distance <= most or rejections[0] >= MAX_REJECTIONS:
        rejections[0] = 0
        return False
    rejections[0] += 1
    rejections[1] += 1
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def copy_slice(x: Array, first: int, out: Array) -> None:
    """Write the part of x from `first` on; see `strapdown.copy_matrix`."""
    for k in range(out.size):
        out[k] = x[first + k]


@njit(cache=True, nogil=True, error_model="numpy")
def white_noise_covariance(cm: Array, noise: Array, since: float, out: Array) -> None:
    """Write the covariance of integrated white noise, C M diag(noise) (C M)ᵀ Δt."""
    for k in range(3):
        for j in range(3):
            out[k, j] = 0.0
            for b in range(3):
                out[k, j] += cm[k, b] * noise[b] * cm[j, b] * since


@njit(cache=True, nogil=True, error_model="numpy")
def write_estimate(
    model: KernelModel,
    elapsed: float,
    before: int,
    theta: Array,
    x: Array,
    p: Array,
    value: Array,
    variance: Array,
) -> None:
    """Write estimates and their variances; a bias that drifts as the mean over the run so far.

    Parameters
    ----------
    model : KernelModel
    elapsed : float
        s since the start.
    before : int
        Where the coefficients begin in the state; the drift follows them.
    theta : (p,) array
        Coefficients, to which the state adds.
    x, p : (n,) and (n, n) arrays
    value, variance : (n,) arrays
        Written.
    """
    for s in range(x.size):
        value[s] = theta[s - before] + x[s] if before <= s < before + theta.size else x[s]
        variance[s] = p[s, s]
    times, _variance, _walk, mean_over_run = model.drift
    if not mean_over_run or elapsed <= 0:
        return
    axis, weights, components = model.terms.axis, model.terms.weights, times.size
    first = before + axis.size
    at, by = np.empty(components + 2, np.int64), np.empty(components + 2)
    for s in range(axis.size):
        others = 0.0
        for b in range(weights.shape[1]):
            if b != BIAS:
                others += abs(weights[s, b])
        if others > 0:
            continue
        at[0], by[0] = before + s, 1.0
        for c in range(components):
            mean = 0.0 if np.isinf(times[c]) else -times[c] / elapsed
            at[1 + c], by[1 + c] = first + 3 * c + axis[s], mean / weights[s, BIAS]
        at[components + 1] = first + 3 * components + axis[s]
        by[components + 1] = 1 / elapsed / weights[s, BIAS]
        total = 0.0
        for i in range(at.size):
            if i > 0:
                value[at[0]] += by[i] * x[at[i]]
            for j in range(at.size):
                total += by[i] * p[at[i], at[j]] * by[j]
        variance[at[0]] = total
