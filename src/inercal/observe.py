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
    sensor: Sensor, y: Array, c: Array, motion: Motion, df: Array, dw: Array
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
        Derivatives of specific force and rate to the nuisances.
    """
    residual = y - sensor.forward(motion, c)
    slope = sensor.slope(motion, c)
    through = slope[..., :3] @ df + slope[..., 3:] @ dw
    design = sensor.design(motion, c)
    shape = np.broadcast_shapes(design.shape[:-1], through.shape[:-1])
    jacobian = np.concatenate(
        [np.broadcast_to(part, (*shape, part.shape[-1])) for part in (design, through)], axis=-1
    )
    flat = (*residual.shape[:-2], -1)
    return residual.reshape(flat), jacobian.reshape(*shape[:-2], -1, jacobian.shape[-1])
