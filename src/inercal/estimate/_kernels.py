"""Compiled normal equations of many small problems at once.

The trials lie side by side in the innermost axis ("lanes"), so that every operation of a textbook
Cholesky factorisation becomes one vector operation over trials. `gauss_newton_steps` holds the
dense oracle.

The number of lanes is an argument: were it a constant, the compiler would unroll the inner loops
instead of vectorising them.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from inercal.arrays import Array

Bools = NDArray[np.bool_]

# Enough to fill the vector units; a block of 25 × 25 matrices still fits the second cache.
LANES = 32


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _cholesky_block(
    rows: Array,
    weight: Array,
    u: Array,
    prior: Array,
    damping: Array,
    first: int,
    a: Array,
    b: Array,
    d: Array,
    good: Bools,
) -> None:
    """Assemble one block of H = AᵀA + P, A = diag(weight) · rows, and overwrite it with its factor.

    Lanes from trial `first` on. Afterwards a (k, k, lanes) holds L of D(H + λ diag H)D = L Lᵀ, with
    the inverse of its diagonal, where d (k, lanes) is D = diag(H)^-½; b (k, lanes) holds Aᵀu, and
    `good` (lanes,) says which matrices were positive definite.
    """
    k, lanes = d.shape
    row, s = np.empty((k, lanes)), np.empty(lanes)
    size, busy = np.empty(k), np.empty(k, np.int64)
    last = u.shape[0] - 1  # the spare lanes of the last block repeat the last trial
    for i in range(k):
        for j in range(i + 1):
            a[i, j] = prior[i, j]
        b[i] = 0.0
    for n in range(rows.shape[1]):
        size[:] = 0.0
        for lane in range(lanes):
            t = min(first + lane, last)
            one, w = rows[min(t, rows.shape[0] - 1), n], weight[min(t, weight.shape[0] - 1), n]
            s[lane] = u[t, n]
            for i in range(k):
                z = w * one[i]
                row[i, lane] = z
                size[i] += abs(z)
        # Most columns of a row are zero in all trials: an observation sees few parameters.
        count = 0
        for i in range(k):
            if size[i] > 0.0:
                busy[count] = i
                count += 1
        for m in range(count):
            left, total = row[busy[m]], b[busy[m]]
            for lane in range(lanes):
                total[lane] += left[lane] * s[lane]
            for n_right in range(m + 1):
                right, total = row[busy[n_right]], a[busy[m], busy[n_right]]
                for lane in range(lanes):
                    total[lane] += left[lane] * right[lane]

    good[:] = True
    for i in range(k):
        for lane in range(lanes):
            z = a[i, i, lane]
            d[i, lane] = 1.0 / np.sqrt(z if z > 0.0 else 1.0)
    for i in range(k):
        left = a[i]
        for j in range(i + 1):
            right = a[j]
            for lane in range(lanes):
                s[lane] = left[j, lane] * d[i, lane] * d[j, lane]
            if i == j:
                for lane in range(lanes):
                    s[lane] += damping[min(first + lane, last)]
            for n in range(j):
                for lane in range(lanes):
                    s[lane] -= left[n, lane] * right[n, lane]
            if j < i:
                for lane in range(lanes):
                    left[j, lane] = s[lane] * right[j, lane]
            else:
                for lane in range(lanes):
                    # The diagonal began at one: this is no more than rounding would leave.
                    ok = s[lane] > 1e-14
                    good[lane] &= ok
                    left[j, lane] = 1.0 / np.sqrt(s[lane] if ok else 1.0)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def solve(
    rows: Array, weight: Array, u: Array, prior: Array, pull: Array, damping: Array, lanes: int
) -> tuple[Array, Array, Bools]:
    """Solve (H + λ diag H) δ = g, H = AᵀA + P, g = Aᵀu + q, for each trial.

    Parameters
    ----------
    rows, weight : (trials, m, k) and (trials, m) arrays
        A is diag(weight) · rows; either may have one trial, shared by all.
    u : (trials, m) array
        Whitened residual.
    prior : (k, k) array
        P, symmetric.
    pull : (trials, k) array
        q, the gradient of the priors.
    damping : (trials,) array
        λ.
    lanes : int
        Trials worked on at once.

    Returns
    -------
    step : (trials, k) array
        δ.
    predicted : (trials,) array
        gᵀδ + λ δᵀ diag(H) δ: how far the linear model says that χ² falls.
    ok : (trials,) bool array
        False where the matrix is not positive definite.
    """
    trials, k = pull.shape
    step, predicted = np.zeros((trials, k)), np.zeros(trials)
    ok, good = np.zeros(trials, np.bool_), np.empty(lanes, np.bool_)
    a, d = np.empty((k, k, lanes)), np.empty((k, lanes))
    b, g = np.empty((k, lanes)), np.empty((k, lanes))
    for first in range(0, trials, lanes):
        _cholesky_block(rows, weight, u, prior, damping, first, a, b, d, good)
        used = min(lanes, trials - first)
        for lane in range(used):
            for i in range(k):
                b[i, lane] = (b[i, lane] + pull[first + lane, i]) * d[i, lane]
                g[i, lane] = b[i, lane]
        for i in range(k):
            row, s = a[i], b[i]
            for n in range(i):
                for lane in range(lanes):
                    s[lane] -= row[n, lane] * b[n, lane]
            for lane in range(lanes):
                s[lane] *= row[i, lane]
        for i in range(k - 1, -1, -1):
            row, s = a[i], b[i]
            for lane in range(lanes):
                s[lane] *= row[i, lane]
            for n in range(i):
                for lane in range(lanes):
                    b[n, lane] -= row[n, lane] * s[lane]
        for lane in range(used):
            t = first + lane
            ok[t] = good[lane]
            for i in range(k):
                z = b[i, lane]
                step[t, i] = z * d[i, lane]
                predicted[t] += z * (g[i, lane] + damping[t] * z)
    return step, predicted, ok


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def inverse(rows: Array, weight: Array, prior: Array, lanes: int) -> tuple[Array, Bools]:
    """Return (AᵀA + P)⁻¹ (trials, k, k), and where it exists (trials,); arguments as in `solve`."""
    trials, k = max(rows.shape[0], weight.shape[0]), rows.shape[2]
    result = np.empty((trials, k, k))
    ok, good = np.zeros(trials, np.bool_), np.empty(lanes, np.bool_)
    damping = np.zeros(trials)
    a, v, d = np.empty((k, k, lanes)), np.zeros((k, k, lanes)), np.empty((k, lanes))
    u, b, s = np.zeros((trials, rows.shape[1])), np.empty((k, lanes)), np.empty(lanes)
    for first in range(0, trials, lanes):
        _cholesky_block(rows, weight, u, prior, damping, first, a, b, d, good)
        # v[j, i] = (L⁻¹)ᵢⱼ: transposed, so that both sums below run along rows.
        for j in range(k):
            column = v[j]
            for lane in range(lanes):
                column[j, lane] = a[j, j, lane]
            for i in range(j + 1, k):
                row = a[i]
                s[:] = 0.0
                for n in range(j, i):
                    for lane in range(lanes):
                        s[lane] -= row[n, lane] * column[n, lane]
                for lane in range(lanes):
                    column[i, lane] = s[lane] * row[i, lane]
        for i in range(k):
            left = v[i]
            for j in range(i + 1):
                right, total = v[j], a[i, j]
                s[:] = 0.0
                for n in range(i, k):
                    for lane in range(lanes):
                        s[lane] += left[n, lane] * right[n, lane]
                for lane in range(lanes):
                    total[lane] = s[lane] * d[i, lane] * d[j, lane]
        for lane in range(min(lanes, trials - first)):
            one = result[first + lane]
            ok[first + lane] = good[lane]
            for i in range(k):
                for j in range(i + 1):
                    one[i, j] = a[i, j, lane]
                    one[j, i] = a[i, j, lane]
    return result, ok
