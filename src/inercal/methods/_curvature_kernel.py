"""Compute the moments of the second-order terms of `hand_likelihood` for many trials."""
# Numba's decorator has no type annotations.
# pyright: reportUntypedFunctionDecorator=false

from inercal.basics.arrays import Array, Indices
from inercal.estimation.kernel_options import njit
from inercal.methods.residuals._row_operations import INNER, KERNEL, add, fill


@njit(**INNER)
def _combine(eta: Array, place: Indices, spread: Array, out: Array) -> None:
    """Write the product η P, (parameters,), using only the nonzero components of η."""
    fill(0.0, out)
    for d in range(eta.size):
        if eta[d] != 0.0:
            add(spread[place[d]], eta[d], out)


@njit(**INNER)
def _product(eta: Array, place: Indices, row: Array) -> float:
    total = 0.0
    for d in range(eta.size):
        total += eta[d] * row[place[d]]
    return total


@njit(**KERNEL)
def second_order_moments(
    eta: Array,
    place: Indices,
    spread: Array,
    tau: Indices,
    rows: Indices,
    scratch: Array,
    shift: Array,
    covariance: Array,
) -> None:
    """Write E[Q] and cov(Q, Q) for all readings.

    Parameters
    ----------
    eta : (trials, t, m, 2, d) array
        η for t tilted rows, m axes and two tangents, with at most d parameters each.
    place : (t, m, 2, d) array of int
        Indices of these parameters.
    spread : (trials, p, p) array
        Covariance of all parameters.
    tau : (t, 2) array of int
        Indices of the tangents.
    rows : (t,) array of int
        Indices of the tilted rows, among all r rows.
    scratch : (t, m, 2, p) array
        Work array, which is overwritten.
    shift : (trials, r, m) array
        E[Q]; output, must be zero on entry.
    covariance : (trials, r m, r m) array
        cov(Q, Q); output, must be zero on entry.
    """
    t, m = eta.shape[1:3]
    for s in range(eta.shape[0]):
        own, joint = eta[s], spread[s]
        for n in range(t):
            for i in range(m):
                for k in range(2):
                    _combine(own[n, i, k], place[n, i, k], joint, scratch[n, i, k])
                    shift[s, rows[n], i] += scratch[n, i, k, tau[n, k]]
        for n in range(t):
            for i in range(m):
                at = rows[n] * m + i
                for j in range(n + 1):
                    for b in range(m):
                        total = 0.0
                        for k in range(2):
                            left = scratch[n, i, k]
                            for h in range(2):
                                between = joint[tau[n, k], tau[j, h]]
                                total += between * _product(own[j, b, h], place[j, b, h], left)
                                total += left[tau[j, h]] * scratch[j, b, h, tau[n, k]]
                        other = rows[j] * m + b
                        covariance[s, at, other] = total
                        covariance[s, other, at] = total
