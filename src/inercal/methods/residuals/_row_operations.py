"""Operate on the rows of a trial, which are contiguous along the last axis.

Each function writes one or two rows from a few others, so that the compiler can prove that they do
not overlap, and vectorises the loop. `INNER` turns off reference counting, so taking a row of an
array costs nothing. Functions compiled with `INNER` allocate nothing, and only compiled code can
call them. `second_order_moments` is the kernel of `hand_likelihood` for many trials.
"""
# Numba's decorator has no type annotations.
# pyright: reportUntypedFunctionDecorator=false

from typing import Any

from inercal.basics.arrays import Array, Indices
from inercal.estimation.kernel_options import INNER_VECTOR_OPTIONS, VECTOR_OPTIONS, njit

INNER: dict[str, Any] = {**INNER_VECTOR_OPTIONS, "nogil": True, "fastmath": {"contract"}}
# For functions that other code calls.
KERNEL: dict[str, Any] = {**VECTOR_OPTIONS, "nogil": True, "fastmath": {"contract"}}
# A sum may be computed in any order.
SUM: dict[str, Any] = {**INNER, "fastmath": {"contract", "reassoc", "nsz"}}


@njit(**INNER)
def fill(value: float, row: Array) -> None:
    """Fill a row."""
    for n in range(row.size):
        row[n] = value


@njit(**INNER)
def copy(row: Array, result: Array) -> None:
    """Copy a row."""
    for n in range(row.size):
        result[n] = row[n]


@njit(**INNER)
def add(step: Array, factor: float, total: Array) -> None:
    """Add factor · step to a row."""
    for n in range(step.size):
        total[n] += factor * step[n]


@njit(**INNER)
def scale(factor: Array, row: Array) -> None:
    """Multiply a row by factors, element by element."""
    for n in range(row.size):
        row[n] *= factor[n]


@njit(**INNER)
def add_product(a: Array, b: Array, total: Array) -> None:
    """Add a · b to a row."""
    for n in range(total.size):
        total[n] += a[n] * b[n]


@njit(**INNER)
def divide(slope: Array, step: Array) -> None:
    """Divide a row by slopes, element by element."""
    for n in range(step.size):
        step[n] /= slope[n]


@njit(**INNER)
def combine(x: Array, factor: Array, out: Array) -> None:
    """Write the linear combination of rows x (3, r), out (r,)."""
    a, b, c = factor[0], factor[1], factor[2]
    x0, x1, x2 = x[0], x[1], x[2]
    for n in range(out.size):
        out[n] = a * x0[n] + b * x1[n] + c * x2[n]


@njit(**INNER)
def combine_column(x: Array, factor: Array, i: int, out: Array) -> None:
    """Write the linear combination with the factors in column i, (3, 3)."""
    a, b, c = factor[0, i], factor[1, i], factor[2, i]
    x0, x1, x2 = x[0], x[1], x[2]
    for n in range(out.size):
        out[n] = a * x0[n] + b * x1[n] + c * x2[n]


@njit(**INNER)
def multiply(x: Array, y: Array, total: Array) -> None:
    """Write Σ x y over three rows."""
    x0, x1, x2, y0, y1, y2 = x[0], x[1], x[2], y[0], y[1], y[2]
    for n in range(total.size):
        total[n] = x0[n] * y0[n] + x1[n] * y1[n] + x2[n] * y2[n]


@njit(**INNER)
def multiply_column(x: Array, y: Array, m: int, total: Array) -> None:
    """Write Σ x y over three rows, for column m of y (3, 3, r)."""
    x0, x1, x2, y0, y1, y2 = x[0], x[1], x[2], y[0, m], y[1, m], y[2, m]
    for n in range(total.size):
        total[n] = x0[n] * y0[n] + x1[n] * y1[n] + x2[n] * y2[n]


@njit(**INNER)
def minor(a: Array, b: Array, c: Array, d: Array, result: Array) -> None:
    """Write a b − c d."""
    for n in range(result.size):
        result[n] = a[n] * b[n] - c[n] * d[n]


@njit(**INNER)
def set_slope(along: float, outer: Array, bent: float, slope: Array) -> None:
    """Write along · outer + bent."""
    for n in range(slope.size):
        slope[n] = along * outer[n] + bent


@njit(**INNER)
def raise_size(a: Array, size: Array) -> None:
    """Raise sizes to at least the absolute values in a row."""
    for n in range(a.size):
        size[n] = max(size[n], abs(a[n]))


@njit(**SUM)
def dot(a: Array, b: Array) -> float:
    """Return a·b."""
    total = 0.0
    for n in range(a.size):
        total += a[n] * b[n]
    return total


@njit(**SUM)
def dots(a: Array, b: Array, c: Array, d: Array) -> tuple[float, float, float, float]:
    """Return a·c, a·d, b·c and b·d."""
    ac, ad, bc, bd = 0.0, 0.0, 0.0, 0.0
    for n in range(a.size):
        ac += a[n] * c[n]
        ad += a[n] * d[n]
        bc += b[n] * c[n]
        bd += b[n] * d[n]
    return ac, ad, bc, bd


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
