"""Carry out the steps that both filters share, and define the arguments of their kernels.

Kernels change arrays in place, so a recording may be processed in pieces.

Each kernel has its own loop over epochs. A common loop would need the filter's steps as function
arguments, and Numba does not cache kernels with such arguments, so each process would compile it
again. A Python loop over compiled steps would cost several calls of 10 µs per epoch of 30 µs.
"""

from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.estimation.kalman import predict, update
from inercal.estimation.kernel_options import kernel, kernel_step, record
from inercal.methods.turntable import BIAS, Terms
from inercal.methods.turntable.drift import Drift
from inercal.methods.turntable.drift_propagation import add_drift_cross_covariance
from inercal.methods.turntable.strapdown import inverse_scale_matrix, sum_reading_terms

# Standard deviations of an epoch's innovation. By chance one in 900 epochs exceeds this limit,
# which costs nothing. An error of five standard deviations must be rejected even if noise hides
# part of it.
INNOVATION_GATE = 4.0
MAX_REJECTIONS = 3  # in a row


@record
class FilterSamples(NamedTuple):
    """The samples of a piece of a recording; n of them."""

    time: Array  # (n,) s
    reading: Array  # (n, 3), m/s² or rad/s
    hold: Indices  # (n,), index of the hold; negative while the table moves
    temperature_offset: Array  # (n,) K, ΔT; (0,) if the sensor does not depend on it


@record
class KernelModel(NamedTuple):
    """The model of three axes at the location of the bench."""

    terms: Terms
    white: Array  # (3,), variance of the integrated noise, SI²/s
    drift: Drift  # of the biases
    size: int  # number of drift states
    earth: Array  # (3,) rad/s, level frame
    gravity: float  # m/s²


class Transition(NamedTuple):
    """Φ and Q from one epoch to the next, in the form that `kalman.predict` uses."""

    a: Array
    keep: Array
    driven: Array
    drawn: Array
    joint: Array  # (components, 3), covariance between the drift's noise and that of J


@record
class KernelWorkspace(NamedTuple):
    """Arrays for intermediate results of a kernel, which allocates no memory."""

    used_terms: Indices  # the terms of φ that the coefficients use
    added_terms: Indices  # the used terms that M does not include
    biases: Indices  # the coefficients that are biases
    m: Array  # M, (3, 3)
    reading_terms: Array  # factor of each term of φ in the readings, (size of φ, 3)
    phi: Array  # φ in the last step, (size of φ,)
    cm: Array  # C M at the middle of the step, row after row, (9,)
    half: Array  # C at the middle of the step, (3, 3)
    turn: Array  # rotation vectors, (3,)
    rate: Array  # rate of the body in the level frame, (3,)
    fed: Array  # drift that readings are corrected for, (3,)
    square: Array  # temporary, (3, 3)
    driven: Array  # as in `Transition`, (k, k), (n,) and (c, 3)
    drawn: Array
    joint: Array
    moved: Array  # (k, n)
    z: Array  # observations, (m,)
    innovation: Array  # (m,)
    variance: Array  # variances of the observations, (m,)
    ph: Array  # temporary, (n,)
    x: Array  # a trial estimate, (n,), and its covariance, (n, n)
    p: Array
    total: Array  # Σ C M φ Δt in the last epoch, (size of φ, 9)
    other: Array  # attitude slightly earlier or later, (3, 3)
    either: Array  # temporary, (3, 3)
    mean_rows: Indices  # states that the mean of a bias depends on, (components + 2,)
    mean_weights: Array  # weights of these states


def allocate_workspace(
    model: KernelModel, indices: tuple[Indices, Indices, Indices], n: int, k: int, m: int
) -> KernelWorkspace:
    """Return a workspace for n states, k before the coefficients, and m observations.

    `indices` contains the first three fields.
    """
    size, components = model.terms.size, len(model.drift.times)
    phi = np.zeros(size)
    phi[0] = 1.0
    return KernelWorkspace(
        *indices,
        np.zeros((3, 3)), np.zeros((size, 3)), phi, np.zeros(9), np.zeros((3, 3)),
        np.zeros(3), np.zeros(3), np.zeros(3), np.zeros((3, 3)),
        np.zeros((k, k)), np.zeros(n), np.zeros((components, 3)), np.zeros((k, n)),
        np.zeros(m), np.zeros(m), np.zeros(m), np.zeros(n),
        np.zeros(n), np.zeros((n, n)), np.zeros((size, 9)), np.zeros((3, 3)), np.zeros((3, 3)),
        np.zeros(components + 2, np.int64), np.zeros(components + 2),
    )  # fmt: skip


@kernel_step
def update_workspace(work: KernelWorkspace, terms: Terms, theta: Array) -> None:
    """Write M and the factors of φ for the current estimates."""
    inverse_scale_matrix(terms, theta, 0.0, work.square, work.m)
    sum_reading_terms(terms, theta, work.fed, work.used_terms, work.reading_terms)


@kernel_step
def predict_covariance(drift: Drift, first: int, to: Transition, moved: Array, p: Array) -> None:
    """Propagate a covariance to the next epoch, in place; drift states start at index `first`."""
    predict(p, to.a, to.keep, to.driven, to.drawn, moved)
    add_drift_cross_covariance(drift, first, to.joint, p)


@kernel
def is_rejected(
    innovation: Array,
    h: Array,
    p: Array,
    variance: Array,
    gate: float,
    rejections: Indices,
    trial: Array,
    gain: Array,
    off: Array,
) -> bool:
    """Return whether observations are rejected, νᵀ S⁻¹ ν > gate² with S = H P Hᵀ + R.

    Rejections are counted. After `MAX_REJECTIONS` in a row the next observations are accepted,
    because a lasting difference is not a false reading, and the NIS should show it.

    Parameters
    ----------
    innovation : (m,) array
        Innovation ν.
    h : (m, n) array
    p : (n, n) array
    variance : (m,) array
        Diagonal of R; it may be negative if S is not.
    gate : float
        Standard deviations; infinite if nothing should be rejected.
    rejections : (2,) array of int
        Number in a row, and in total; changed in place.
    trial, gain, off : (n, n), (n,) and (n,) arrays
        Work arrays, which are overwritten.
    """
    m, n, most = innovation.size, p.shape[0], gate * gate
    distance = 0.0
    for k in range(m):
        far = innovation[k] * innovation[k]
        distance += far / variance[k] if variance[k] > 0 else np.inf
    # S is at least R, and computing S costs m n² operations.
    if distance > most:
        for i in range(n):
            off[i] = 0.0
            for j in range(n):
                trial[i, j] = p[i, j]
        distance = 0.0
        for k in range(m):  # square of the part of each innovation that is independent of others
            left, s = update(off, trial, h[k], innovation[k], variance[k], gain)
            distance += left * left / s
    if distance <= most or rejections[0] >= MAX_REJECTIONS:
        rejections[0] = 0
        return False
    rejections[0] += 1
    rejections[1] += 1
    return True


@kernel_step
def white_noise_covariance(cm: Array, noise: Array, since: float, out: Array) -> None:
    """Write the covariance of integrated white noise, C M diag(noise) (C M)ᵀ Δt."""
    for k in range(3):
        for j in range(3):
            out[k, j] = 0.0
            for b in range(3):
                out[k, j] += cm[3 * k + b] * noise[b] * cm[3 * j + b] * since


@kernel_step
def write_estimate(
    model: KernelModel,
    work: KernelWorkspace,
    elapsed: float,
    theta: Array,
    x: Array,
    p: Array,
    out: Array,
) -> None:
    """Write estimates and variances; a drifting bias is written as its mean over the run so far.

    Parameters
    ----------
    model : KernelModel
    work : KernelWorkspace
    elapsed : float
        Time since the start, s.
    theta : (p,) array
        Coefficients that the state is added to.
    x, p : (n,) and (n, n) arrays
    out : (m + 1 + 2 n,) array
        Values, then variances, are written after the first m + 1 elements.
    """
    n, count, before, first = x.size, theta.size, len(work.driven), work.z.size + 1
    for s in range(n):
        out[first + s] = x[s]
        out[first + n + s] = p[s, s]
    for s in range(count):
        out[first + before + s] += theta[s]
    if model.drift.mean_over_run and elapsed > 0:
        _write_mean_biases(model, work, elapsed, x, p, out[first:])


@kernel_step
def _write_mean_biases(
    model: KernelModel, work: KernelWorkspace, elapsed: float, x: Array, p: Array, out: Array
) -> None:
    """Add the mean drift to the biases, and write their variances."""
    axes, weights, times = model.terms.axis, model.terms.weights, model.drift.times
    before, at, by = len(work.driven), work.mean_rows, work.mean_weights
    n, count, components = x.size, axes.size, times.size
    for b in range(work.biases.size):
        s = work.biases[b]
        own, axis, weight = before + s, axes[s], weights[s, BIAS]
        at[0], by[0] = own, 1.0
        for c in range(components + 1):
            # The mean of each component, then J
            mean = 1.0 if c == components else -times[c]
            mean = 0.0 if np.isinf(mean) else mean / elapsed
            at[1 + c], by[1 + c] = before + count + 3 * c + axis, mean / weight
        total = 0.0
        for i in range(components + 2):
            if i > 0:
                out[own] += by[i] * x[at[i]]
            for j in range(components + 2):
                total += by[i] * p[at[i], at[j]] * by[j]
        out[n + own] = total
