"""Operate on vectors and 3 × 3 matrices, given as arrays or as tuples of numbers.

A `Vector` is a tuple of 3 numbers, a `Matrix` a tuple of 9, row after row. The compiler can keep
tuples in registers. It must read an array again after each write to another array, because the two
may overlap. Functions for arrays write the result to their last argument; functions for tuples
return it.
"""

from inercal.basics.arrays import Array
from inercal.estimation.kernel_options import kernel_step, kernel_value

Vector = tuple[float, float, float]
Matrix = tuple[float, float, float, float, float, float, float, float, float]


@kernel_step
def copy_matrix(matrix: Array, out: Array) -> None:
    """Copy a 3 × 3 matrix; Numba takes seconds to compile an assignment of slices."""
    for i in range(3):
        for j in range(3):
            out[i, j] = matrix[i, j]


@kernel_step
def product(a: Array, b: Array, out: Array) -> None:
    """Write the product of 3 × 3 matrices; `out` must be neither of them."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@kernel_value
def vector(of: Array) -> Vector:
    """Return the numbers of an array (3,)."""
    return of[0], of[1], of[2]


@kernel_value
def matrix(of: Array) -> Matrix:
    """Return the numbers of an array (3, 3), row after row."""
    return (
        of[0, 0], of[0, 1], of[0, 2], of[1, 0], of[1, 1], of[1, 2], of[2, 0], of[2, 1], of[2, 2],
    )  # fmt: skip


@kernel_value
def write_vector(v: Vector, out: Array) -> None:
    """Write the numbers of a vector to an array (3,)."""
    out[0], out[1], out[2] = v


@kernel_value
def write_matrix(m: Matrix, out: Array) -> None:
    """Write the numbers of a matrix to an array (3, 3)."""
    out[0, 0], out[0, 1], out[0, 2] = m[0], m[1], m[2]
    out[1, 0], out[1, 1], out[1, 2] = m[3], m[4], m[5]
    out[2, 0], out[2, 1], out[2, 2] = m[6], m[7], m[8]


@kernel_value
def write_row(m: Matrix, out: Array) -> None:
    """Write the numbers of a matrix to a row, an array (9,)."""
    out[0], out[1], out[2] = m[0], m[1], m[2]
    out[3], out[4], out[5] = m[3], m[4], m[5]
    out[6], out[7], out[8] = m[6], m[7], m[8]


@kernel_value
def copy_row(of: Array, out: Array) -> None:
    """Copy a row (9,); all elements are read before any is written."""
    write_row((of[0], of[1], of[2], of[3], of[4], of[5], of[6], of[7], of[8]), out)


@kernel_value
def cross(a: Vector, b: Vector) -> Vector:
    """Return a × b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel_value
def times_vector(m: Matrix, v: Vector) -> Vector:
    """Return M v."""
    return (
        m[0] * v[0] + m[1] * v[1] + m[2] * v[2],
        m[3] * v[0] + m[4] * v[1] + m[5] * v[2],
        m[6] * v[0] + m[7] * v[1] + m[8] * v[2],
    )


@kernel_value
def transposed_times(m: Matrix, v: Vector) -> Vector:
    """Return Mᵀ v."""
    return (
        m[0] * v[0] + m[3] * v[1] + m[6] * v[2],
        m[1] * v[0] + m[4] * v[1] + m[7] * v[2],
        m[2] * v[0] + m[5] * v[1] + m[8] * v[2],
    )


@kernel_value
def times_matrix(a: Matrix, b: Matrix) -> Matrix:
    """Return A B."""
    return (
        a[0] * b[0] + a[1] * b[3] + a[2] * b[6],
        a[0] * b[1] + a[1] * b[4] + a[2] * b[7],
        a[0] * b[2] + a[1] * b[5] + a[2] * b[8],
        a[3] * b[0] + a[4] * b[3] + a[5] * b[6],
        a[3] * b[1] + a[4] * b[4] + a[5] * b[7],
        a[3] * b[2] + a[4] * b[5] + a[5] * b[8],
        a[6] * b[0] + a[7] * b[3] + a[8] * b[6],
        a[6] * b[1] + a[7] * b[4] + a[8] * b[7],
        a[6] * b[2] + a[7] * b[5] + a[8] * b[8],
    )
