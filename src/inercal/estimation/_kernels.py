"""Solve the normal equations of many small problems at once in compiled kernels.

The trials lie side by side along the innermost array dimension ("lanes"), so that every operation
of a textbook Cholesky factorisation becomes one vector operation over trials. `gauss_newton_steps`
contains the dense reference implementation. Kernels exchange a symmetric matrix (k, k) as its lower
triangle, row after row, (k (k + 1)/2,).

The number of lanes is an argument, because the compiler would unroll the inner loops instead of
vectorising them if it were a constant.
"""

import numpy as np

from inercal.basics.arrays import Array, Bools
from inercal.estimation.kernel_options import njit

# Enough to fill the vector units; a block of 25 × 25 matrices still fits in the L2 cache.
LANES = 32


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def normal_equations(rows: Array, weight: Array, u: Array, lanes: int) -> tuple[Array, Array]:
    """Return AᵀA, (trials, k (k + 1)/2), and Aᵀu, (trials, k), for each trial.

    Parameters
    ----------
    rows, weight : (trials, m, k) and (trials, m) arrays
        A is diag(weight) · rows. Either array may have a single trial that all trials share.
    u : (trials, m) array
        Whitened residuals; the array may have a single trial.
    lanes : int
        Number of trials processed at once.
    """
    trials, k = max(rows.shape[0], weight.shape[0]), rows.shape[2]
    normal, gradient = np.empty((trials, k * (k + 1) // 2)), np.empty((trials, k))
    a, b = np.empty((k, k, lanes)), np.empty((k, lanes))
    row, s = np.empty((k, lanes)), np.empty(lanes)
    size, busy = np.empty(k), np.empty(k, np.int64)
    for first in range(0, trials, lanes):
        a[:], b[:] = 0.0, 0.0
        for n in range(rows.shape[1]):
            size[:] = 0.0
            for lane in range(lanes):
                t = min(first + lane, trials - 1)  # unused lanes repeat the last trial
                one, w = rows[min(t, rows.shape[0] - 1), n], weight[min(t, weight.shape[0] - 1), n]
                s[lane] = u[min(t, u.shape[0] - 1), n]
                for i in range(k):
                    z = w * one[i]
                    row[i, lane] = z
                    size[i] += abs(z)
            # Most columns of a row are zero in all trials, because an observation depends on few
            # parameters.
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
        for lane in range(min(lanes, trials - first)):
            t, place = first + lane, 0
            for i in range(k):
                gradient[t, i] = b[i, lane]
                for j in range(i + 1):
                    normal[t, place] = a[i, j, lane]
                    place += 1
    return normal, gradient


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _factorise_block(
    normal: Array, prior: Array, damping: Array, first: int, a: Array, d: Array, good: Bools
) -> None:
    """Factorise one block of matrices H = N + P, which starts at trial `first`.

    On return, a (k, k, lanes) contains L from D(H + λ diag H)D = L Lᵀ, with the inverse of its
    diagonal, d (k, lanes) contains D = diag(H)^-½, and `good` (lanes,) marks the positive definite
    matrices.
    """
    k, lanes = d.shape
    s = np.empty(lanes)
    for lane in range(lanes):
        # The unused lanes of the last block repeat the last trial.
        one, place = normal[min(first + lane, normal.shape[0] - 1)], 0
        for i in range(k):
            for j in range(i + 1):
                a[i, j, lane] = one[place] + prior[i, j]
                place += 1
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
                    s[lane] += damping[min(first + lane, damping.size - 1)]
            for n in range(j):
                for lane in range(lanes):
                    s[lane] -= left[n, lane] * right[n, lane]
            if j < i:
                for lane in range(lanes):
                    left[j, lane] = s[lane] * right[j, lane]
            else:
                for lane in range(lanes):
                    # The diagonal started at one, so a value this small is only rounding.
                    ok = s[lane] > 1e-14
                    good[lane] &= ok
                    left[j, lane] = 1.0 / np.sqrt(s[lane] if ok else 1.0)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def solve(
    normal: Array, prior: Array, gradient: Array, damping: Array, lanes: int
) -> tuple[Array, Array, Bools]:
    """Solve (H + λ diag H) δ = g with H = N + P for each trial.

    Parameters
    ----------
    normal : (trials, k (k + 1)/2) array
        N = AᵀA of the observations; it may have a single trial that all trials share.
    prior : (k, k) array
        P, the symmetric information matrix of the priors.
    gradient : (trials, k) array
        g, from observations and priors.
    damping : (trials,) array
        λ.
    lanes : int
        Number of trials processed at once.

    Returns
    -------
    step : (trials, k) array
        δ.
    predicted : (trials,) array
        Decrease of χ² predicted by the linear model, gᵀδ + λ δᵀ diag(H) δ.
    ok : (trials,) bool array
        False if the matrix is not positive definite.
    """
    trials, k = gradient.shape
    step, predicted = np.zeros((trials, k)), np.zeros(trials)
    ok, good = np.zeros(trials, np.bool_), np.empty(lanes, np.bool_)
    a, d = np.empty((k, k, lanes)), np.empty((k, lanes))
    b, g = np.zeros((k, lanes)), np.zeros((k, lanes))
    for first in range(0, trials, lanes):
        _factorise_block(normal, prior, damping, first, a, d, good)
        used = min(lanes, trials - first)
        for lane in range(used):
            for i in range(k):
                b[i, lane] = gradient[first + lane, i] * d[i, lane]
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
def inverse(normal: Array, prior: Array, lanes: int) -> tuple[Array, Bools]:
    """Return (N + P)⁻¹, (trials, k, k), and whether it exists, (trials,); see `solve`."""
    trials, k = normal.shape[0], prior.shape[0]
    result = np.empty((trials, k, k))
    ok, good = np.zeros(trials, np.bool_), np.empty(lanes, np.bool_)
    damping, s = np.zeros(1), np.empty(lanes)
    a, v, d = np.empty((k, k, lanes)), np.zeros((k, k, lanes)), np.empty((k, lanes))
    for first in range(0, trials, lanes):
        _factorise_block(normal, prior, damping, first, a, d, good)
        # v[j, i] = (L⁻¹)ᵢⱼ is transposed, so that both sums below run along rows.
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
