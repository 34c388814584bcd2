"""Sums of squared second differences, the hot loop of the Allan deviation.

One pass over three places of the cumulative sum; NumPy would pass over it once for each operation.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from inercal.arrays import Array

_UNROLLED = 4096  # terms in a partial sum: few digits are lost to the size of the total


@njit(cache=True, nogil=True, fastmath=True)
def squared_second_differences(
    x: Array, factors: NDArray[np.int64], strides: NDArray[np.int64]
) -> Array:
    """Return Σ (x[i+2m] − 2 x[i+m] + x[i])² over i = 0, stride, … for each factor m, (k,).

    Parameters
    ----------
    x : (n,) array
    factors, strides : (k,) array of int
    """
    out = np.zeros(factors.size)
    for j in range(factors.size):
        m, stride = factors[j], strides[j]
        count = (x.size - 2 * m - 1) // stride + 1
        total = 0.0
        for begin in range(0, count, _UNROLLED):
            part = 0.0
            for k in range(begin, min(begin + _UNROLLED, count)):
                i = k * stride
                d = x[i + 2 * m] - 2.0 * x[i + m] + x[i]
                part += d * d
            total += part
        out[j] = total
    return out
