"""Array types, and ranges of samples."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Bools = NDArray[np.bool_]


def true_ranges(mask: Bools) -> Indices:
    """Return the half-open index ranges in which a mask is true; shapes (n,) to (k, 2).

    >>> true_ranges(np.array([True, False, True, True])).tolist()
    [[0, 1], [2, 4]]
    """
    return np.flatnonzero(np.diff(mask, prepend=False, append=False)).reshape(-1, 2)


def row_products(rows: Array, matrix: Array) -> Array:
    """Return each row, (..., p), times a matrix (p, q); other rows do not affect its rounding."""
    return (rows[..., None, :] @ matrix)[..., 0, :]
