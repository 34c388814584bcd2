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
# Numba's decorator has no types.
# pyright: reportUntypedFunctionDecorator=false

from typing import NamedTuple

import numpy as np
from numba import njit

from inercal.arrays import Array


class FilterSteps(NamedTuple):
    """The steps of a filter of n states at each of e epochs: a prediction, then m observations.

    A filter writes into row `epoch % len(s)`: without smoothing one row is enough.
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
    """Return empty arrays for the steps of a filter; of one epoch where nothing is smoothed.

    Parameters
    ----------
    epochs, n, k, m : int
        e, states, driven states, observations.
    wanted : (r, n) array
    """
    e = epochs if wanted.size else 1
    return FilterSteps(
        np.zeros((e, k, n)),
        np.ones((e, n)),
        np.zeros((e, m, n)),
        np.zeros((e, m, n)),
        np.zeros((e, m)),
        np.zeros((e, m)),
        wanted,
        np.zeros((e, len(wanted), n)),
    )


@njit(cache=True, nogil=True, error_model="numpy")
def predict(p: Array, a: Array, keep: Array, driven: Array, drawn: Array) -> None:
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
    """
    k, n = a.shape
    moved = np.zeros((k, n))
    for i in range(k):
        for m in range(n):
            if a[i, m] != 0.0:
                for j in range(n):
                    moved[i, j] += a[i, m] * p[m, j]
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


@njit(cache=True, nogil=True, error_model="numpy")
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
    ph = np.zeros(n)
    for m in range(n):
        if h[m] != 0.0:
            for j in range(n):
                ph[j] += h[m] * p[m, j]
    s, off = r, z
    for m in range(n):
        s += h[m] * ph[m]
        off -= h[m] * x[m]
    for j in range(n):
        one = ph[j] / s
        gain[j] = one
        x[j] += one * off
        for m in range(j, n):
            p[j, m] -= one * ph[m]
            p[m, j] = p[j, m]
    return off, s


@njit(cache=True, nogil=True, error_model="numpy")
def store_covariance_rows(p: Array, steps: FilterSteps, row: int) -> None:
    """Write wanted @ P to a row of the steps."""
    for r in range(len(steps.wanted)):
        kept = steps.rows[row, r]
        kept[:] = 0.0
        for s in range(len(p)):
            weight = steps.wanted[r, s]
            if weight != 0.0:
                for j in range(len(p)):
                    kept[j] += weight * p[s, j]


@njit(cache=True, nogil=True, error_model="numpy")
def smoother_corrections(steps: FilterSteps, against: Array, p: Array) -> tuple[Array, Array]:
    """Return corrections of the filter's estimates by the smoother, and variances, (e, r) each.

    They are of the sums `steps.wanted`, after each epoch.

    Parameters
    ----------
    steps : FilterSteps
    against : (r, n) array
        Weights of sums of the states after the last epoch; variances are of the differences from
        these sums.
    p : (n, n) array
        Covariance after the last epoch.
    """
    count, r, n = steps.rows.shape
    by, large = np.zeros(n), np.zeros((n, n))  # λ, Λ
    added, variance = np.zeros((count, r)), np.zeros((count, r))
    moved, ahead = np.zeros(n), np.zeros((n, n))
    back, apart = against.copy(), np.any(against != 0.0)
    for e in range(count - 1, -1, -1):
        for i in range(r):
            row = steps.rows[e, i]
            added[e, i] = row @ by
            variance[e, i] = row @ steps.wanted[i] - row @ (large @ row)
            if apart:
                variance[e, i] += against[i] @ (p @ against[i]) - 2 * (row @ back[i])
        for j in range(steps.s.shape[1] - 1, -1, -1):
            if steps.s[e, j] > 0:
                _reverse_update(steps.h[e, j], steps.gain[e, j], steps.off[e, j], steps.s[e, j],
                               by, large)  # fmt: skip
                if apart:
                    for i in range(r):
                        along = steps.gain[e, j] @ back[i]
                        for m in range(n):
                            back[i, m] -= steps.h[e, j, m] * along
        _reverse_predict(steps.a[e], steps.keep[e], by, large, moved, ahead)
        if apart:
            for i in range(r):
                _apply_transposed_transition(steps.a[e], steps.keep[e], back[i], moved)
    return added, variance


@njit(cache=True, nogil=True, error_model="numpy")
def _reverse_update(h: Array, gain: Array, off: float, s: float, by: Array, large: Array) -> None:
    """Carry λ and Λ back over an update, in place."""
    n = h.size
    moved = large @ gain
    along, twice = off / s - gain @ by, 1 / s + gain @ moved
    for i in range(n):
        by[i] += h[i] * along
        for m in range(i, n):
            large[i, m] += h[i] * h[m] * twice - h[i] * moved[m] - moved[i] * h[m]
            large[m, i] = large[i, m]


@njit(cache=True, nogil=True, error_model="numpy")
def _reverse_predict(
    a: Array, keep: Array, by: Array, large: Array, moved: Array, ahead: Array
) -> None:
    """Carry λ and Λ back over a prediction, in place; `moved` and `ahead` are overwritten."""
    k, n = a.shape
    _apply_transposed_transition(a, keep, by, moved)
    for i in range(n):
        for j in range(n):
            ahead[i, j] = large[i, j] * keep[j] if j >= k else 0.0
        for m in range(k):
            for j in range(n):
                ahead[i, j] += large[i, m] * a[m, j]
    for i in range(n):
        for j in range(i, n):
            total = keep[i] * ahead[i, j] if i >= k else 0.0
            for m in range(k):
                total += a[m, i] * ahead[m, j]
            large[i, j] = total
            large[j, i] = total


@njit(cache=True, nogil=True, error_model="numpy")
def _apply_transposed_transition(a: Array, keep: Array, by: Array, moved: Array) -> None:
    """Write Φᵀ λ in place of λ; `moved` is overwritten."""
    k, n = a.shape
    for i in range(n):
        moved[i] = keep[i] * by[i] if i >= k else 0.0
        for m in range(k):
            moved[i] += a[m, i] * by[m]
    for i in range(n):
        by[i] = moved[i]
