"""Run a Kalman filter with few coupled states, and its smoother, in compiled kernels.

The first k of the n states have a dense transition; each of the others decays independently::

    Φ = [ A      ]  (k rows)        P ← Φ P Φᵀ + Q
        [ 0 diag ]

A filter with a few dynamic states that are driven by many constants has this form: A P costs k n²
operations, while a dense product costs n³. Observations are processed one by one, P ← P − (P h)(P
h)ᵀ / s, s = hᵀ P h + r, so that P stays symmetric to the last bit. Source: Bierman, Factorization
Methods for Discrete Sequential Estimation (1977), chapters II.6 and V.

The fixed-interval smoother processes the same steps from the last to the first, with x̂_s = x̂ + P
λ and P_s = P − P Λ P. At the end λ and Λ are zero; going back over a step gives::

    update    λ ← λ + h (ν / s − kᵀ λ)    Λ ← (I − h kᵀ) Λ (I − k hᵀ) + h hᵀ / s
    predict   λ ← Φᵀ λ                    Λ ← Φᵀ Λ Φ

Here ν is the innovation, s its variance and k = P h / s. The results equal those of Rauch, Tung and
Striebel (1965, AIAA Journal 3(8), 1445–1450), but no covariance is inverted. A covariance is nearly
singular if constants have a large variance at the start. Only P λ is added to an estimate, so
errors that the filter has fed back need no bookkeeping. P μ is the covariance of the states with a
weighted sum of the final states, whose weights are g. At the end μ = g; then μ ← (I − h kᵀ) μ
before an update and μ ← Φᵀ μ before a prediction. Source: Bierman, Fixed interval smoothing with
discrete measurements, International Journal of Control 18(1), 1973, 65–75.
"""

from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.estimation.kernel_options import kernel, kernel_step, record


@record
class FilterSteps(NamedTuple):
    """Records of a filter's steps at each of e epochs: one prediction, then m observations.

    A filter writes to row `epoch % len(s)`, so a single row is enough if the records are not used.
    """

    a: Array  # (e, k, n) and (e, n): Φ from the previous epoch, in the form that `predict` needs
    keep: Array
    h: Array  # (e, m, n)
    gain: Array  # (e, m, n), k
    off: Array  # (e, m), ν
    s: Array  # (e, m), 0 for an observation that was not made
    wanted: Array  # (r, n), weights of the sums of states to smooth
    rows: Array  # (e, r, n), wanted @ P after the epoch


def allocate_steps(epochs: int, n: int, k: int, m: int, wanted: Array) -> FilterSteps:
    """Allocate the arrays for the steps of a filter.

    Parameters
    ----------
    epochs, n, k, m : int
        Numbers of epochs, states, driven states and observations.
    wanted : (r, n) array
    """
    return FilterSteps(
        np.zeros((epochs, k, n)),
        np.ones((epochs, n)),
        np.zeros((epochs, m, n)),
        np.zeros((epochs, m, n)),
        np.zeros((epochs, m)),
        np.zeros((epochs, m)),
        wanted,
        np.zeros((epochs, len(wanted), n)),
    )


@record
class SmootherState(NamedTuple):
    """The state of the smoother, which runs backwards over the epochs, and its work arrays."""

    by: Array  # (n,), λ
    large: Array  # (n, n), Λ
    back: Array  # (r, n), μ of each sum
    moved: Array  # (n,)
    ahead: Array  # (n, n)


def start_smoother(against: Array) -> SmootherState:
    """Return the initial state of the smoother, after the last epoch.

    Parameters
    ----------
    against : (r, n) array
        Weights of sums of the states after the last epoch. The smoother's variances are those of
        the differences from these sums.
    """
    n = against.shape[1]
    return SmootherState(
        np.zeros(n), np.zeros((n, n)), against.copy(), np.zeros(n), np.zeros((n, n))
    )


@kernel_step
def weighted_rows(symmetric: Array, v: Array, out: Array) -> None:
    """Write the product of a symmetric matrix and a vector, row by row, which vectorises well."""
    for j in range(v.size):
        out[j] = 0.0
    for i in range(v.size):
        size = v[i]
        if size != 0.0:
            for j in range(v.size):
                out[j] += size * symmetric[i, j]


@kernel
def predict(p: Array, a: Array, keep: Array, driven: Array, drawn: Array, moved: Array) -> None:
    """Propagate the covariance to the next epoch, in place.

    Parameters
    ----------
    p : (n, n) array
        Covariance, symmetric.
    a : (k, n) array
        The first k rows of Φ.
    keep : (n,) array
        Diagonal of Φ from state k on; 1 means a constant.
    driven : (k, k) array
        Process noise Q of the first k states.
    drawn : (n,) array
        Diagonal of Q from state k on.
    moved : (k, n) array
        Work array, overwritten.
    """
    k, n = a.shape
    for i in range(k):
        weighted_rows(p, a[i], moved[i])
    for i in range(k):
        for j in range(i, k):
            total = driven[i, j]
            for m in range(n):
                total += moved[i, m] * a[j, m]
            p[i, j] = total
            p[j, i] = total
    for j in range(k, n):
        if keep[j] != 1.0:
            for m in range(k, n):
                p[j, m] *= keep[j]
                p[m, j] *= keep[j]
        p[j, j] += drawn[j]
        for i in range(k):
            p[i, j] = moved[i, j] * keep[j]
            p[j, i] = p[i, j]


@kernel
def update(x: Array, p: Array, h: Array, z: float, r: float, gain: Array) -> tuple[float, float]:
    """Process the observation z = hᵀ x + noise, variance r; return ν and its variance.

    Parameters
    ----------
    x, p : (n,) and (n, n) arrays
        Estimate and covariance.
    h : (n,) array
    z, r : float
    gain : (n,) array
        The gain k is written to this array.
    """
    n = x.size
    weighted_rows(p, h, gain)
    s, off = r, z
    for m in range(n):
        s += h[m] * gain[m]
        off -= h[m] * x[m]
    per = 1 / s
    for j in range(n):
        size = gain[j]
        for m in range(n):
            p[j, m] -= size * gain[m] * per  # this order keeps the matrix symmetric to the last bit
    for j in range(n):
        gain[j] *= per
        x[j] += gain[j] * off
    return off, s


@kernel_step
def store_covariance_rows(p: Array, steps: FilterSteps, row: int) -> None:
    """Write wanted @ P to one row of the step records."""
    for r in range(len(steps.wanted)):
        weighted_rows(p, steps.wanted[r], steps.rows[row, r])


@kernel
def smooth_steps(
    steps: FilterSteps,
    state: SmootherState,
    last: Array,
    shown: Indices,
    added: Array,
    variance: Array,
) -> None:
    """Run the smoother backwards over epochs, in place.

    Parameters
    ----------
    steps : FilterSteps
        The last epochs, or the epochs before those that were smoothed already.
    state : SmootherState
        State of the smoother, changed in place.
    last : (r,) array
        Variance after the last epoch of each sum given to `start_smoother`.
    shown : (q,) array of int
        Epochs whose results are requested, ascending.
    added, variance : (q, r) arrays
        Output arrays: corrections to the filter's estimates of the sums `steps.wanted` after these
        epochs, and the smoothed variances.
    """
    by, large, back = state.by, state.large, state.back
    moved, ahead = state.moved, state.ahead
    r, n = back.shape
    m = steps.s.shape[1]
    apart, q = False, shown.size - 1
    for i in range(r):
        for j in range(n):
            apart |= back[i, j] != 0.0
    for e in range(len(steps.s) - 1, -1, -1):
        if q >= 0 and shown[q] == e:
            for i in range(r):
                row = steps.rows[e, i]
                weighted_rows(large, row, moved)
                total, left = 0.0, last[i]
                for j in range(n):
                    total += row[j] * by[j]
                    left += row[j] * (steps.wanted[i, j] - 2 * back[i, j] - moved[j])
                added[q, i], variance[q, i] = total, left
            q -= 1
        for j in range(m - 1, -1, -1):
            if steps.s[e, j] > 0:
                h, gain = steps.h[e, j], steps.gain[e, j]
                _reverse_update(h, gain, steps.off[e, j], steps.s[e, j], by, large, moved)
                if apart:
                    for i in range(r):
                        along = 0.0
                        for b in range(n):
                            along += gain[b] * back[i, b]
                        for b in range(n):
                            back[i, b] -= h[b] * along
        _reverse_predict(steps.a[e], steps.keep[e], by, large, moved, ahead)
        if apart:
            for i in range(r):
                _apply_transposed_transition(steps.a[e], steps.keep[e], back[i], moved)


@kernel_step
def _reverse_update(
    h: Array, gain: Array, off: float, s: float, by: Array, large: Array, moved: Array
) -> None:
    """Propagate λ and Λ back over an update, in place; `moved` is overwritten."""
    n = h.size
    along, twice = off / s, 1 / s
    weighted_rows(large, gain, moved)
    for i in range(n):
        along -= gain[i] * by[i]
        twice += gain[i] * moved[i]
    # Λ + h vᵀ + v hᵀ
    for i in range(n):
        moved[i] = 0.5 * twice * h[i] - moved[i]
    for i in range(n):
        size = h[i]
        if size != 0.0:
            by[i] += size * along
            for m in range(n):
                large[i, m] += size * moved[m]
            for m in range(n):
                large[m, i] += size * moved[m]


@kernel_step
def _reverse_predict(
    a: Array, keep: Array, by: Array, large: Array, moved: Array, ahead: Array
) -> None:
    """Propagate λ and Λ back over a prediction, in place; this overwrites `moved`, `ahead`."""
    k, n = a.shape
    _apply_transposed_transition(a, keep, by, moved)
    for i in range(n):
        for j in range(k):
            ahead[i, j] = 0.0
        for j in range(k, n):
            ahead[i, j] = large[i, j] * keep[j]
        for m in range(k):
            size = large[i, m]
            for j in range(n):
                ahead[i, j] += size * a[m, j]
    for i in range(n):
        before = keep[i] if i >= k else 0.0
        for j in range(i, n):
            large[i, j] = before * ahead[i, j]
        for m in range(k):
            size = a[m, i]
            if size != 0.0:
                for j in range(i, n):
                    large[i, j] += size * ahead[m, j]
        for j in range(i + 1, n):
            large[j, i] = large[i, j]


@kernel_step
def _apply_transposed_transition(a: Array, keep: Array, by: Array, moved: Array) -> None:
    """Replace λ by Φᵀ λ; `moved` is overwritten."""
    k, n = a.shape
    for i in range(n):
        moved[i] = keep[i] * by[i] if i >= k else 0.0
    for m in range(k):
        for i in range(n):
            moved[i] += a[m, i] * by[m]
    for i in range(n):
        by[i] = moved[i]
