"""Closed-form linear algebra for 3 × 3 matrices, (..., 3, 3), with cofactors.

For many small matrices, LAPACK spends more time on call overhead than on arithmetic.
"""

import numpy as np

from inercal.basics.arrays import Array

# The next index in the cycle 0, 1, 2, and the index after it.
_ROW, _COLUMN = np.indices((3, 3))
_ROW_1, _ROW_2 = (_ROW + 1) % 3, (_ROW + 2) % 3
_COLUMN_1, _COLUMN_2 = (_COLUMN + 1) % 3, (_COLUMN + 2) % 3


def _cofactors(matrix: Array) -> tuple[Array, Array]:
    """Return the cofactors, (3, 3, ...), and the determinant, (...)."""
    m = np.moveaxis(matrix, (-2, -1), (0, 1))
    cofactors = m[_ROW_1, _COLUMN_1] * m[_ROW_2, _COLUMN_2]
    cofactors -= m[_ROW_1, _COLUMN_2] * m[_ROW_2, _COLUMN_1]
    return cofactors, (m[0] * cofactors[0]).sum(axis=0)


def determinant(matrix: Array) -> Array:
    """Return the determinant, (...), of a matrix (..., 3, 3)."""
    m = np.moveaxis(matrix, (-2, -1), (0, 1))
    return (
        m[0, 0] * (m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1])
        + m[0, 1] * (m[1, 2] * m[2, 0] - m[1, 0] * m[2, 2])
        + m[0, 2] * (m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0])
    )


def solve(matrix: Array, right: Array) -> Array:
    """Solve matrix (..., 3, 3) · x = right (..., 3); x is not finite if the matrix is singular."""
    cofactors, size = _cofactors(matrix)
    b = np.moveaxis(right, -1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        x = (cofactors * b[:, None]).sum(axis=0) / size
    return np.ascontiguousarray(np.moveaxis(x, 0, -1))


def invert(matrix: Array) -> Array:
    """Return the inverse, (..., 3, 3), which is not finite where the matrix is singular."""
    cofactors, size = _cofactors(matrix)
    with np.errstate(divide="ignore", invalid="ignore"):
        cofactors /= size
    return np.ascontiguousarray(np.moveaxis(cofactors, (0, 1), (-1, -2)))
