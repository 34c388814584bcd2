"""Residuals shared by methods: what the readings say minus what the model says.

Vector observation: each row's mean reading against the reading of the motion it was made in,
y − h(f, ω; c), with exact derivatives to the coefficients and, by the chain rule, to whatever the
motion depends on. Norm observation: the attitude is unknown, and only the norm of what was felt
is compared.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from inercal.motion import Motion
from inercal.sensors import Sensor, inverse

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


class Norm(NamedTuple):
    """What `norm` returns; shapes for r rows, m axes and p coefficients."""

    residual: Array  # (..., r), m/s²
    jacobian: Array  # (..., r, p + 1), of ‖f̂‖ − g to the coefficients and g
    felt: Array  # (..., r, 3), f̂
    up: Array  # (..., r, 3), f̂ / ‖f̂‖
    by_coefficient: Array  # (..., r, 3, p), ∂f̂/∂c
    by_reading: Array  # (..., r or 1, 3, m), ∂f̂/∂y
    by_rate: Array  # (..., r or 1, 3), ∂‖f̂‖/∂ω


def norm(sensor: Sensor, y: Array, c: Array, g: Array, w: Array | None = None) -> Norm:
    """Return the residuals 0 − (‖f̂‖ − g) of readings in unknown attitudes, with f̂ = h⁻¹(y; c).

    By h(f̂; c) = y the derivative of f̂ is −S⁻¹ ∂h/∂c to the coefficients and S⁻¹ to the reading,
    with S = ∂h/∂f; that of ‖f̂‖ is the part along f̂. Readings beyond the fold of the model have a
    residual that is not a number, so that a search turns back from them.

    Parameters
    ----------
    sensor : Sensor
        Accelerometers alone, three or more.
    y : (..., r, m) array
        Readings in SI.
    c : (..., p) array
        Coefficients in SI.
    g : (..., r) or (..., 1) array
        Norm of specific force in each row, or in all of them, m/s².
    w : (..., r, 3) array, optional
        Angular rate, rad/s, where lever arms are modelled.
    """
    felt = inverse(sensor, y, c, w=w, refuse=False).f
    seen = np.asarray(np.isfinite(felt).all(axis=-1))
    if not seen.all():
        felt = np.where(seen[..., None], felt, 1.0)
    motion = Motion(felt) if w is None else Motion(felt, w)
    _, design, slope = sensor.linearise(motion, c)
    back = np.asarray(np.linalg.pinv(slope[..., :3]), dtype=np.float64)
    by_coefficient = -back @ design
    length = np.linalg.norm(felt, axis=-1)
    up = felt / length[..., None]
    jacobian = np.empty((*length.shape, c.shape[-1] + 1))
    jacobian[..., :-1] = (up[..., None, :] @ by_coefficient)[..., 0, :]
    jacobian[..., -1] = -1.0
    by_rate = -(up[..., None, :] @ back @ slope[..., 3:])[..., 0, :]
    residual = np.where(seen, g - length, np.nan)
    return Norm(residual, jacobian, felt, up, by_coefficient, back, by_rate)
