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


def median_of_rows(rows: Array) -> Array:
    """Return what np.median returns for the rows, (r, …), r ≥ 1, without loading numpy.ma.

    >>> median_of_rows(np.array([[4.0, 1.0], [2.0, 3.0]])).tolist()
    [3.0, 2.0]
    """
    middle = [(len(rows) - 1) // 2, len(rows) // 2]
    return np.partition(rows, middle, axis=0)[middle].mean(axis=0)
