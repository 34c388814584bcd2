"""The two steps of a Kalman filter with few coupled states, and its smoother, compiled.

Of n states the first k have a dense transition; each of the others decays independently::

    Φ = [ A      ]  (k rows)        P ← Φ P Φᵀ + Q
        [ 0 diag ]

A filter of few states that many constants drive has this form: A P costs k n² where a dense
product costs n³. Observations are processed one by one, P ← P − (P h)(P h)ᵀ / s, s = hᵀ P h + r,
so that P stays symmetric to the last bit. Source: Bierman, Factorization Methods for Discrete
Sequential Estimation (1977), chapters II.6 and V.

The fixed-interval smoother processes the same steps from the last to the first, with
x̂_s = x̂ + P λ and P_s = P − P Λ P; λ and Λ are zero at the end, and before a step::

    update    λ ← λ + h (ν / s − kᵀ λ)    Λ ← (I − h kᵀ) Λ (I − k hᵀ) + h hᵀ / s
    predict   λ ← Φᵀ λ                    Λ ← Φᵀ Λ Φ

ν the innovation, s its variance, k = P h / s. It gives what Rauch, Tung and Striebel (1965, AIAA
Journal 3(8), 1445–1450) give, but inverts no covariance, which is nearly singular where constants
have a large variance at the start. Only P λ is added to an estimate, so that the errors that the
filter has fed back need no bookkeeping. The covariance of the states with a sum g of the states at
the end is P μ, with
μ = g there, μ ← (I − h kᵀ) μ before an update and Φᵀ μ before a prediction. Source: Bierman, Fixed
interval smoothing with discrete measurements, International Journal of Control 18(1), 1973, 65–75.
"""

from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.estimation.kernel_options import kernel, kernel_step


class FilterSteps(NamedTuple):
    """The steps of a filter of n states at each of e epochs: a prediction, then m observations.

    A filter writes into row `epoch % len(s)`: if nobody asks for them one row is enough.
    """

    a: Array  # (e, k, n) and (e, n): Φ as `predict` takes it, since the epoch before
    keep: Array
    h: Array  # (e, m, n)
    gain: Array  # (e, m, n), k
    off: Array  # (e, m), ν
    s: Array  # (e, m), 0 for an observation that was not made
    wanted: Array  # (r, n), weights of the sums of states to smooth
    rows: Array  # (e, r, n), wanted @ P after the epoch


def allocate_steps(epochs: int, n: int, k: int, m: int, wanted: Array) -> FilterSteps:
    """Return arrays for the steps of a filter.

    Parameters
    ----------
    epochs, n, k, m : int
        e, states, driven states, observations.
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


class SmootherState(NamedTuple):
    """What the smoother carries from the last epoch to the first, and its room to work."""

    by: Array  # (n,), λ
    large: Array  # (n, n), Λ
    back: Array  # (r, n), μ of each sum
    moved: Array  # (n,)
    ahead: Array  # (n, n)


def start_smoother(against: Array) -> SmootherState:
    """Return the smoother's state after the last epoch.

    Parameters
    ----------
    against : (r, n) array
        Weights of sums of the states after the last epoch; variances are of the differences from
        these sums.
    """
    n = against.shape[1]
    return SmootherState(
        np.zeros(n), np.zeros((n, n)), against.copy(), np.zeros(n), np.zeros((n, n))
    )


@kernel_step
def weighted_rows(symmetric: Array, v: Array, out: Array) -> None:
    """Write the product of a symmetric matrix and a vector, row by row: that vectorises."""
    for j in range(v.size):
        out[j] = 0.0
    for i in range(v.size):
        size = v[i]
        if size != 0.0:
            for j in range(v.size):
                out[j] += size * symmetric[i, j]


@kernel
def predict(p: Array, a: Array, keep: Array, driven: Array, drawn: Array, moved: Array) -> None:
    """Carry the covariance to the next epoch, in place.

    Parameters
    ----------
    p : (n, n) array
        Symmetric.
    a : (k, n) array
        The first k rows of Φ.
    keep : (n,) array
        Diagonal of Φ from state k on; 1 is a constant.
    driven : (k, k) array
        Q of the first k states.
    drawn : (n,) array
        Diagonal of Q from state k on.
    moved : (k, n) array
        Overwritten.
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
    """Take one observation z = hᵀ x + noise of variance r, in place; return ν and its variance.

    Parameters
    ----------
    x, p : (n,) and (n, n) arrays
        Estimate and covariance.
    h : (n,) array
    z, r : float
    gain : (n,) array
        k is written there.
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
            p[j, m] -= size * gain[m] * per  # in this order symmetric to the last bit
    for j in range(n):
        gain[j] *= per
        x[j] += gain[j] * off
    return off, s


@kernel_step
def store_covariance_rows(p: Array, steps: FilterSteps, row: int) -> None:
    """Write wanted @ P to a row of the steps."""
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
    """Carry the smoother back over epochs, in place.

    Parameters
    ----------
    steps : FilterSteps
        The last ones, or those before the ones that were smoothed.
    state : SmootherState
        Changed in place.
    last : (r,) array
        Variance of each sum of `start_smoother` after the last epoch.
    shown : (q,) array of int
        Epochs whose results are wanted, ascending.
    added, variance : (q, r) arrays
        Written: corrections of the filter's estimates after these epochs of the sums
        `steps.wanted`, and their variances.
    """
    by, large, back, moved, ahead = state
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
    """Carry λ and Λ back over an update, in place; `moved` is overwritten."""
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
    """Carry λ and Λ back over a prediction, in place; `moved` and `ahead` are overwritten."""
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
    """Write Φᵀ λ instead of λ; `moved` is overwritten."""
    k, n = a.shape
    for i in range(n):
        moved[i] = keep[i] * by[i] if i >= k else 0.0
    for m in range(k):
        for i in range(n):
            moved[i] += a[m, i] * by[m]
    for i in range(n):
        by[i] = moved[i]
