"""Column lengths, and a singular value decomposition that always converges."""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false, reportUnknownMemberType=false

from typing import cast

import numpy as np

from inercal.basics.arrays import Array


def column_lengths(matrix: Array) -> Array:
    """Return the length of each column of (..., m, n) matrices; a length of 0 is replaced by 1."""
    size = np.linalg.norm(matrix, axis=-2)
    return np.where(size > 0, size, 1.0)


def svd(matrix: Array, *, full_matrices: bool = True) -> tuple[Array, Array, Array]:
    """Return U, s and Vᵀ of a finite matrix, (m, n).

    LAPACK's divide-and-conquer algorithm (gesdd) fails for rare matrices with very small numbers.
    Its older algorithm (gesvd) is slower but does not fail.
    """
    try:
        return np.linalg.svd(matrix, full_matrices=full_matrices)
    except np.linalg.LinAlgError:
        import scipy.linalg

        found = scipy.linalg.svd(matrix, full_matrices=full_matrices, lapack_driver="gesvd")
        return cast("tuple[Array, Array, Array]", found)


def svds(matrices: Array) -> tuple[Array, Array, Array]:
    """Return U, s and Vᵀ, without columns of zero weight, of finite matrices, (..., m, n).

    A single column needs no algorithm, and most candidates of a score test have one component.
    """
    if matrices.shape[-1] == 1:
        length = np.linalg.norm(matrices, axis=-2)
        unit = matrices / np.where(length > 0, length, 1.0)[..., None]
        return unit, length, np.ones((*length.shape, 1))
    try:
        return np.linalg.svd(matrices, full_matrices=False)
    except np.linalg.LinAlgError:
        flat = matrices.reshape(-1, *matrices.shape[-2:])
        parts = zip(*(svd(one, full_matrices=False) for one in flat), strict=True)
        u, s, v = (np.array(part).reshape(*matrices.shape[:-2], *part[0].shape) for part in parts)
        return u, s, v
