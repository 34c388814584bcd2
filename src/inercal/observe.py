"""Residuals shared by methods: what the readings say minus what the model says.

Vector observation: each row's mean reading against the reading of the motion it was made in,
y − h(f, ω; c), with exact derivatives to the coefficients and, by the chain rule, to whatever the
motion depends on.
"""

import numpy as np
from numpy.typing import NDArray

from inercal.motion import Motion
from inercal.sensors import Sensor

Array = NDArray[np.float64]


def vector(
    sensor: Sensor, y: Array, c: Array, motion: Motion, df: Array, dw: Array | None
) -> tuple[Array, Array]:
    """Return the residuals, (..., r·m), and ∂h/∂(c, q), (..., r·m, p + q).

    Parameters
    ----------
    sensor : Sensor
    y : (..., r, m) array
        Readings in SI.
    c : (..., p) array
        Coefficients in SI.
    motion : Motion
        Of each row, (..., r, 3).
    df, dw : (..., r, 3, q) arrays
        Derivatives of specific force and rate to the nuisances; `dw` None is zero.
    """
    reading, design, slope = sensor.linearise(motion, c)
    residual = y - reading
    p, q = design.shape[-1], df.shape[-1]
    rows = np.broadcast_shapes(design.shape[:-2], df.shape[:-2])
    jacobian = np.empty((*rows, len(sensor.axes), p + q))
    jacobian[..., :p] = design
    jacobian[..., p:] = slope[..., :3] @ df
    if dw is not None:
        jacobian[..., p:] += slope[..., 3:] @ dw
    flat = (*residual.shape[:-2], -1)
    return residual.reshape(flat), jacobian.reshape(*jacobian.shape[:-3], -1, p + q)
