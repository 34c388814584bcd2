"""Compute the motion sensed on a turntable with errors at a few instants, in compiled code.

Attitude, f, ω and its derivative are the same as in `inercal.benches.turntable.attitude`.
"""
# Numba's decorator has no types.
# pyright: reportUntypedFunctionDecorator=false

from math import cos, sin

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.estimation.kernel_options import njit

Integers = NDArray[np.int64]


@njit(cache=True, nogil=True)
def _rotate(mat: Array, axis: int, angle: float) -> None:
    """Replace `mat` by R_axis(angle) mat, in place."""
    j, k = (axis + 1) % 3, (axis + 2) % 3
    c, s = cos(angle), sin(angle)
    for m in range(3):
        a, b = mat[j, m], mat[k, m]
        mat[j, m], mat[k, m] = c * a - s * b, s * a + c * b


@njit(cache=True, nogil=True)
def _cross(a: Array, b: Array, out: Array) -> None:
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@njit(cache=True, nogil=True)
def sensed_motion(
    moved: Array,
    axes: Integers,
    thirds: Integers,
    squares: Array,
    base: Array,
    earth: Array,
    gravity: float,
    lever: Array,
    out: Array,
) -> None:
    """Write f, ω and the derivative of ω to `out`, (n, 9), for the axes' motion `moved`.

    `moved`, (n, k, 3), contains angles, rates and accelerations in rad, rad/s and rad/s². `axes`,
    (k,), are the axes' letters as numbers. For each pair of neighbouring axes, `thirds` and
    `squares`, (k − 1,), are the axis of the right-angle error and its size in rad. `base` is T, and
    `earth` is the earth's rate in the level frame, rad/s.
    """
    count = axes.size
    mat = np.empty((3, 3))
    u = np.empty((count, 3))
    v, dv, omega, w, dw, one, two = (
        np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    )  # fmt: skip
    for n in range(moved.shape[0]):
        mat[:] = 0.0
        mat[0, 0] = mat[1, 1] = mat[2, 2] = 1.0
        for i in range(count - 1, -1, -1):
            if i + 1 < count:
                _rotate(mat, thirds[i], squares[i])
            for m in range(3):
                u[i, m] = mat[axes[i], m]
            _rotate(mat, axes[i], moved[n, i, 0])
        v[:] = 0.0
        dv[:] = 0.0
        for i in range(count - 1, -1, -1):
            _cross(u[i], v, one)
            for m in range(3):
                dv[m] += moved[n, i, 2] * u[i, m] + moved[n, i, 1] * one[m]
            for m in range(3):
                v[m] += moved[n, i, 1] * u[i, m]
        for m in range(3):
            omega[m] = 0.0
            f = 0.0
            for j in range(3):
                toward = base[j, 0] * mat[0, m] + base[j, 1] * mat[1, m] + base[j, 2] * mat[2, m]
                omega[m] += earth[j] * toward
                f = gravity * toward if j == 2 else f
            out[n, m] = f
        _cross(omega, v, one)
        for m in range(3):
            w[m] = omega[m] + v[m]
            dw[m] = one[m] + dv[m]
        _cross(dw, lever, one)
        for m in range(3):
            out[n, m] += one[m]
            out[n, 3 + m], out[n, 6 + m] = w[m], dw[m]
        _cross(w, lever, one)
        _cross(w, one, two)
        for m in range(3):
            out[n, m] += two[m]
