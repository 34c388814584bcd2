"""Propagation of uncertainty, first order: GUM (JCGM 100:2008) 5.2.2, with U_y = J U_x Jᵀ."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_STEP = np.finfo(float).eps ** (1 / 3)  # central differences: balances rounding and curvature


def propagate(
    function: Callable[[Array], Array], x: Array, covariance: Array
) -> tuple[Array, Array]:
    """Return y = function(x), (q,), and its covariance, (q, q).

    Parameters
    ----------
    function : callable
        (p,) to (q,), smooth.
    x : (p,) array
    covariance : (p, p) array
        Of x. Steps of the central differences follow the larger of |x| and the deviation.
    """
    value = function(x)
    size = np.maximum(np.abs(x), np.sqrt(np.diag(covariance)))
    step = _STEP * np.where(size > 0, size, 1.0)
    jacobian = np.empty((value.size, x.size))
    for k, h in enumerate(step):
        ahead, behind = x.copy(), x.copy()
        ahead[k] += h
        behind[k] -= h
        jacobian[:, k] = (function(ahead) - function(behind)) / (ahead[k] - behind[k])
    return value, jacobian @ covariance @ jacobian.T
