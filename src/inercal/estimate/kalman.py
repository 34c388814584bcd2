"""The two steps of a Kalman filter whose first states alone are driven, compiled.

Of n states the first k follow a dense transition, the others decay each by itself::

    Φ = [ A      ]  (k rows)        P ← Φ P Φᵀ + Q
        [ 0 diag ]

which a filter of few states driven by many constants has: A P costs k n² where a dense product
costs n³. Observations are taken one by one, P ← P − (P h)(P h)ᵀ / s, s = hᵀ P h + r, which stays
symmetric to the last bit. Source: Bierman, Factorization Methods for Discrete Sequential
Estimation (1977), chapters II.6 and V.
"""
# Numba's decorator has no types.
# pyright: reportUntypedFunctionDecorator=false

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


@njit(cache=True, nogil=True, error_model="numpy")
def predict(p: Array, a: Array, keep: Array, driven: Array, drawn: Array) -> None:
    """Carry the covariance to the next epoch, in place.

    Parameters
    ----------
    p : (n, n) array
        Symmetric.
    a : (k, n) array
        The first k rows of Φ.
    keep : (n,) array
        Diagonal of Φ from state k on; 1 is a constant.
    driven : (k, k) array
        Q of the first k states.
    drawn : (n,) array
        Diagonal of Q from state k on.
    """
    k, n = a.shape
    moved = np.zeros((k, n))
    for i in range(k):
        for m in range(n):
            if a[i, m] != 0.0:
                for j in range(n):
                    moved[i, j] += a[i, m] * p[m, j]
    for i in range(k):
        for j in range(i, k):
            total = driven[i, j]
            for m in range(n):
                total += moved[i, m] * a[j, m]
            p[i, j] = total
            p[j, i] = total
    for j in range(k, n):
        if keep[j] != 1.0:
            for m in range(k, n):
                p[j, m] *= keep[j]
                p[m, j] *= keep[j]
        p[j, j] += drawn[j]
        for i in range(k):
            p[i, j] = moved[i, j] * keep[j]
            p[j, i] = p[i, j]


@njit(cache=True, nogil=True, error_model="numpy")
def update(x: Array, p: Array, h: Array, z: float, r: float) -> float:
    """Take one observation z = hᵀ x + noise of variance r, in place; return its NIS.

    Parameters
    ----------
    x, p : (n,) and (n, n) arrays
        Estimate and covariance.
    h : (n,) array
    z, r : float
    """
    n = x.size
    ph = np.zeros(n)
    for m in range(n):
        if h[m] != 0.0:
            for j in range(n):
                ph[j] += h[m] * p[m, j]
    s, off = r, z
    for m in range(n):
        s += h[m] * ph[m]
        off -= h[m] * x[m]
    for j in range(n):
        gain = ph[j] / s
        x[j] += gain * off
        for m in range(j, n):
            p[j, m] -= gain * ph[m]
            p[m, j] = p[j, m]
    return off * off / s
