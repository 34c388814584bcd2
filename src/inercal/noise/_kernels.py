"""Sum squared second differences, which take most of the time of an Allan deviation.

These functions read the cumulative sum only once, whereas NumPy reads it once for each operation.
"""

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.estimation.kernel_options import njit

_BLOCK = 4096  # differences per block for all factors; a block stays in the cache


@njit(cache=True, nogil=True, fastmath=True)
def squared_second_differences(
    x: Array,
    factors: NDArray[np.int64],
    strides: NDArray[np.int64],
    firsts: NDArray[np.int64],
) -> Array:
    """Return Σ (x[i+2m] − 2 x[i+m] + x[i])² over i for each factor m, (k,).

    Parameters
    ----------
    x : (n,) array
    factors, strides : (k,) array of int
    firsts : (k,) array of int
        First value of i, a multiple of the stride. The stride is then added repeatedly.
    """
    out = np.zeros(factors.size)
    for begin in range(0, x.size, _BLOCK):
        for j in range(factors.size):
            m, stride = factors[j], strides[j]
            end = min(begin + _BLOCK, x.size - 2 * m)
            total = 0.0
            start = max(begin, firsts[j])
            if stride == 1:
                if end > start:
                    # The compiler vectorizes slices with a known step.
                    early, middle, late = x[start:end], x[start + m : end + m], x[start + 2 * m :]
                    for i in range(early.size):
                        d = late[i] - 2.0 * middle[i] + early[i]
                        total += d * d
            else:
                for i in range((start + stride - 1) // stride * stride, end, stride):
                    d = x[i + 2 * m] - 2.0 * x[i + m] + x[i]
                    total += d * d
            out[j] += total
    return out
