"""Compiled: norms of the specific force of many trials, of a triad with errors along its axes only.

The readings of orthogonal axes are then independent, and the norm does not depend on directions::

    y = k0 + (1 + k1) f + k2 f² + k3 f³ + koq f|f|        S = ∂y/∂f, on each axis
    ‖f̂‖ = √Σ f²,   ∂‖f̂‖/∂y = f / (‖f̂‖ S),   ∂‖f̂‖/∂c = −∂‖f̂‖/∂y ∂y/∂c

The roots f are computed as by `inercal.sensors.inverse`: Newton's method from the affine part until
the last step is negligible; slopes of reversed sign are beyond the fold.
"""
# Numba's decorator has no types.
# pyright: reportUntypedFunctionDecorator=false

import numpy as np
from numba import njit
from numpy.typing import NDArray

from inercal.arrays import Array

Indices = NDArray[np.int64]

_TERMS = 5  # k0, k1, k2, k3, koq
_MAX_STEPS, _EPS, _TINY = 40, 2.0**-52, 2.0**-1022


@njit(cache=True, nogil=True, error_model="numpy")
def _invert_axis(y: Array, k: Array, size: Array, f: Array, step: Array, slope: Array) -> None:
    """Iterate the force along an axis, f (r,), of a `size`; write the last steps and the slopes."""
    k0, k1, k2, k3, koq = k[0], 1.0 + k[1], k[2], k[3], k[4]
    for _ in range(_MAX_STEPS):
        settled = 0
        for n in range(f.size):
            x = f[n]
            bent, cubic = k2 * x + koq * abs(x), k3 * x * x
            off = y[n] - k0 - (k1 + bent + cubic) * x
            step[n] = off / (k1 + 2.0 * bent + 3.0 * cubic)
            f[n] = x + step[n]
            settled += abs(step[n]) <= 4.0 * _EPS * size[n]
        if settled == f.size:
            break
    for n in range(f.size):
        x = f[n]
        slope[n] = k1 + 2.0 * (k2 * x + koq * abs(x)) + 3.0 * k3 * x * x


@njit(cache=True, nogil=True, error_model="numpy")
def noisy_norm_kernel(
    y: Array,
    covariance: Array,
    c: Array,
    axis: Indices,
    term: Indices,
    made: Array,
    jacobian: Array,
) -> tuple[Array, Array]:
    """Write the Jacobian of the norms, ∂‖f̂‖/∂c, and return their residuals and variances.

    Parameters
    ----------
    y : (1 or trials, r, 3) array
        Readings, SI.
    covariance : (1 or trials, r, 3, 3) array
        Covariance of the readings.
    c : (1 or trials, p) array
        Coefficients, SI.
    axis, term : (p,) arrays
        Axis of each coefficient, and its place among k0, k1, k2, k3, koq.
    made : (1 or trials, r) array
        Norm of the specific force on the bench, m/s².
    jacobian : (trials, r, p) array
        Output; finite everywhere.

    Returns
    -------
    residual : (trials, r) array
        `made` − ‖f̂‖; NaN where a reading is beyond the fold of the model.
    variance : (trials, r) array
        Variance of ‖f̂‖ from the noise of the readings.
    """
    trials, r, p = jacobian.shape
    residual, variance = np.empty((trials, r)), np.empty((trials, r))
    k, g, by = np.zeros((3, _TERMS)), np.empty(3), np.ones((3, _TERMS))
    read, f, size = np.empty((3, r)), np.empty((3, r)), np.empty(r)
    step, slope = np.empty((3, r)), np.empty((3, r))
    for t in range(trials):
        for j in range(p):
            k[axis[j], term[j]] = c[min(t, len(c) - 1), j]
        seen, noise = y[min(t, len(y) - 1)], covariance[min(t, len(covariance) - 1)]
        size[:] = _TINY
        at_zero = 1.0
        for a in range(3):
            at_zero *= 1.0 + k[a, 1]
            for n in range(r):
                read[a, n] = seen[n, a]
                f[a, n] = (seen[n, a] - k[a, 0]) / (1.0 + k[a, 1])
                size[n] = max(size[n], abs(f[a, n]))
        for a in range(3):
            _invert_axis(read[a], k[a], size, f[a], step[a], slope[a])
        for n in range(r):
            exists = slope[0, n] * slope[1, n] * slope[2, n] * at_zero > 0.0
            for a in range(3):
                exists &= abs(step[a, n]) <= 1e-12 * size[n]
            if not exists:
                f[:, n], slope[:, n] = 1.0, 1.0
            length = np.sqrt(f[0, n] ** 2 + f[1, n] ** 2 + f[2, n] ** 2)
            for a in range(3):
                x = f[a, n]
                by[a, 1], by[a, 2], by[a, 3], by[a, 4] = x, x * x, x * x * x, x * abs(x)
                g[a] = x / (length * slope[a, n])
            for j in range(p):
                jacobian[t, n, j] = -g[axis[j]] * by[axis[j], term[j]]
            total = 0.0
            for a in range(3):
                for b in range(3):
                    total += g[a] * noise[n, a, b] * g[b]
            residual[t, n] = made[min(t, len(made) - 1), n] - length if exists else np.nan
            variance[t, n] = total
    return residual, variance
