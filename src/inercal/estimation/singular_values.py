"""Column lengths, and a singular value decomposition that always converges."""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false, reportUnknownMemberType=false

from typing import cast

import numpy as np

from inercal.basics.arrays import Array


def column_lengths(matrix: Array) -> Array:
    """Return the length of each column of an (m, n) matrix; a length of 0 is replaced by 1."""
    size = np.linalg.norm(matrix, axis=0)
    return np.where(size > 0, size, 1.0)


def svd(matrix: Array, *, full_matrices: bool = True) -> tuple[Array, Array, Array]:
    """Return U, s and Vᵀ of a finite matrix, (m, n).

    LAPACK's divide-and-conquer algorithm (gesdd) fails for rare matrices with very small numbers.
    Its older algorithm (gesvd) is slower but does not fail. A single column needs neither, and most
    candidates of a score test have one component.
    """
    if matrix.shape[1] == 1 and not full_matrices:
        length = float(np.linalg.norm(matrix))
        return matrix / (length or 1.0), np.array([length]), np.ones((1, 1))
    try:
        return np.linalg.svd(matrix, full_matrices=full_matrices)
    except np.linalg.LinAlgError:
        import scipy.linalg

        found = scipy.linalg.svd(matrix, full_matrices=full_matrices, lapack_driver="gesvd")
        return cast("tuple[Array, Array, Array]", found)
