"""Propagation of uncertainty to first order, C_y = J C_x Jᵀ (GUM 5.2.2, equation 13; S2, 6.2)."""

from collections.abc import Callable

import numpy as np

from inercal.basics.arrays import Array


def propagate(
    function: Callable[[Array], Array], x: Array, covariance: Array
) -> tuple[Array, Array]:
    """Return y = f(x) and its covariance.

    Parameters
    ----------
    function : callable
        (..., p) to (..., q).
    x : (..., p) array
        Values.
    covariance : (..., p, p) array
        Their covariance.

    Returns
    -------
    value : (..., q) array
        f(x).
    covariance : (..., q, q) array
        To first order.
    """
    value, j = value_and_jacobian(function, x, covariance)
    return value, j @ covariance @ np.swapaxes(j, -1, -2)


def value_and_jacobian(
    function: Callable[[Array], Array], x: Array, covariance: Array
) -> tuple[Array, Array]:
    """Return y = f(x), (..., q), and ∂f/∂x over the range of x, (..., q, p); as of `propagate`."""
    sd = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    return function(x), jacobian(function, x, 0.1 * sd)


def jacobian(function: Callable[[Array], Array], x: Array, step: Array) -> Array:
    """Return ∂f/∂x by central differences of fourth order, (..., q, p).

    Parameters
    ----------
    function : callable
        (..., p) to (..., q).
    x : (..., p) array
        Where.
    step : (..., p) or (p,) array
        Size of the steps: a part of the range over which f matters. A step that rounding of x
        would swallow is enlarged.
    """
    # Rounding costs ε f / h and curvature h⁴ f⁗ / 30: at h = 1e-4 x both are below 1e-11.
    step = np.broadcast_to(np.maximum(step, 1e-4 * np.abs(x)), x.shape)
    # Where the value and its uncertainty are both zero, any step will do: the column is not used.
    step = np.where(step > 0, step, 1e-4)
    columns: list[Array] = []
    for i in range(x.shape[-1]):
        h = np.zeros_like(step)
        h[..., i] = step[..., i]
        near = function(x + h) - function(x - h)
        far = function(x + 2 * h) - function(x - 2 * h)
        columns.append((8 * near - far) / (12 * step[..., i, None]))
    return np.stack(columns, axis=-1)
