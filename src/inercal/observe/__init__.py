"""Residuals shared by methods: readings minus the readings of the model.

Vector observation: the mean reading of each row minus the model's reading of its motion,
y − h(f, ω; c), with exact derivatives to the coefficients and, by the chain rule, to the parameters
of the motion. Norm observation: the attitude is unknown, and only the norm of the sensed motion is
compared. A compiled kernel computes many trials of an orthogonal triad whose errors act along each
axis only.
"""

from typing import NamedTuple

import numpy as np

from inercal.arrays import Array
from inercal.estimate.gauss_newton_steps import QR_MAX_TRIALS
from inercal.keys import CoefficientName
from inercal.motion import Motion
from inercal.sensors import Sensor, inverse, three_axes

_AXIAL_TERMS = ("k0", "k1", "k2", "k3", "koq")  # terms along the axis, in the kernel's order


def vector_residuals(
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
        Motion of each row, (..., r, 3).
    df, dw : (..., r, 3, q) arrays
        Derivatives of specific force and rate to the nuisances; `dw` None is zero.
    """
    reading, design, slope = sensor.linearise(motion, c)
    residual = y - reading
    p, q = design.shape[-1], df.shape[-1]
    # Trials may differ in the slope alone, where the motion is exact in all of them.
    rows = np.broadcast_shapes(design.shape[:-2], *((df.shape[:-2], slope.shape[:-2]) if q else ()))
    jacobian = np.empty((*rows, len(sensor.axes), p + q))
    jacobian[..., :p] = design
    if q:
        jacobian[..., p:] = slope[..., :3] @ df
    if q and dw is not None:
        jacobian[..., p:] += slope[..., 3:] @ dw
    flat = (*residual.shape[:-2], -1)
    return residual.reshape(flat), jacobian.reshape(*jacobian.shape[:-3], -1, p + q)


class NormResiduals(NamedTuple):
    """Result of `norm_residuals`; shapes for r rows, m axes and p coefficients."""

    residual: Array  # (..., r), m/s²
    jacobian: Array  # (..., r, p + 1), of ‖f̂‖ − g to the coefficients and g
    specific_force: Array  # (..., r, 3), f̂
    up: Array  # (..., r, 3), f̂ / ‖f̂‖
    design: Array  # (..., r, m, p), ∂h/∂c at f̂
    by_reading: Array  # (..., r or 1, 3, m), ∂f̂/∂y
    norm_by_reading: Array  # (..., r, m), ∂‖f̂‖/∂y
    by_rate: Array  # (..., r, 3), ∂‖f̂‖/∂ω; zero where no ω was given

    @property
    def by_coefficient(self) -> Array:
        """∂f̂/∂c, (..., r, 3, p)."""
        return -self.by_reading @ self.design


def norm_residuals(
    sensor: Sensor,
    y: Array,
    c: Array,
    g: Array,
    w: Array | None = None,
    dT: Array | float = 0.0,
) -> NormResiduals:
    """Return the residuals 0 − (‖f̂‖ − g) of readings in unknown attitudes, with f̂ = h⁻¹(y; c).

    By h(f̂; c) = y the derivative of f̂ is −S⁻¹ ∂h/∂c to the coefficients and S⁻¹ to the reading,
    with S = ∂h/∂f; that of ‖f̂‖ is the part along f̂. Readings beyond the fold of the model have the
    residual NaN, so that an optimiser rejects the step.

    Parameters
    ----------
    sensor : Sensor
        Accelerometers alone, three or more.
    y : (..., r, m) array
        Readings in SI.
    c : (..., p) array
        Coefficients in SI.
    g : (..., r) or (..., 1) array
        Norm of specific force in each row, or in all rows, m/s².
    w : (..., r, 3) array, optional
        Angular rate, rad/s, where lever arms are modelled.
    dT : (..., r) array or float
        Temperature minus the sensor's reference temperature, K.
    """
    sensed = inverse(sensor, y, c, w=w, dT=dT, refuse=False).f
    seen = np.asarray(np.isfinite(sensed).all(axis=-1))
    if not seen.all():
        sensed = np.where(seen[..., None], sensed, 1.0)
    motion = Motion(sensed, dT=dT) if w is None else Motion(sensed, w, dT=dT)
    _, design, slope = sensor.linearise(motion, c)
    by_force = slope[..., :3]
    back = (
        three_axes.invert(by_force)
        if len(sensor.axes) == 3
        else np.asarray(np.linalg.pinv(by_force), dtype=np.float64)
    )
    length = np.linalg.norm(sensed, axis=-1)
    up = sensed / length[..., None]
    along = up[..., None, :] @ back
    jacobian = np.empty((*length.shape, c.shape[-1] + 1))
    jacobian[..., :-1] = -(along @ design)[..., 0, :]
    jacobian[..., -1] = -1.0
    by_rate: Array = np.broadcast_to(0.0, sensed.shape)
    if w is not None:
        by_rate = -(along @ slope[..., 3:])[..., 0, :]
    residual = np.where(seen, g - length, np.nan)
    return NormResiduals(residual, jacobian, sensed, up, design, back, along[..., 0, :], by_rate)


class NoisyNormResiduals(NamedTuple):
    """Result of `noisy_norm_residuals`; shapes for r rows and p coefficients."""

    residual: Array  # (..., r), m/s²
    jacobian: Array  # (..., r, p), of ‖f̂‖ to the coefficients
    variance: Array  # (..., r), of ‖f̂‖ by the readings' noise, (m/s²)²
    by_rate: Array  # (..., r, 3), of ‖f̂‖ to ω; zero without lever arms


def noisy_norm_residuals(
    sensor: Sensor,
    y: Array,
    covariance: Array,
    c: Array,
    made: Array,
    w: Array | None = None,
    dT: Array | float = 0.0,
) -> NoisyNormResiduals:
    """Return the residuals of `norm_residuals` and their variance from the noise along f̂.

    Parameters
    ----------
    sensor, y, c
        As of `norm_residuals`.
    covariance : (..., r, m, m) array
        Covariance of the readings in each row.
    made : (..., r) array
        Norm of specific force in each row, m/s².
    w : (..., r, 3) array, optional
    dT : (..., r) array or float
        As of `norm_residuals`.
    """
    r, p = y.shape[-2], c.shape[-1]
    lead = np.broadcast_shapes(y.shape[:-2], covariance.shape[:-3], c.shape[:-1], made.shape[:-1])
    if len(lead) == 1 and lead[0] > QR_MAX_TRIALS and _is_separable_triad(sensor):
        from inercal.observe import _kernels

        names = [CoefficientName(name).parts for name in sensor.coefficients]
        # NumPy allocates large pages, which the solver reads faster than memory of compiled code.
        jacobian = np.empty((*lead, r, p))
        residual, variance = _kernels.noisy_norm_kernel(
            np.ascontiguousarray(y).reshape(-1, r, 3),
            np.ascontiguousarray(covariance).reshape(-1, r, 3, 3),
            np.ascontiguousarray(np.atleast_2d(c)),
            np.array([sensor.channels.index(axis) for axis, _ in names], dtype=np.int64),
            np.array([_AXIAL_TERMS.index(term) for _, term in names], dtype=np.int64),
            np.ascontiguousarray(np.atleast_2d(made)),
            jacobian,
        )
        return NoisyNormResiduals(residual, jacobian, variance, np.broadcast_to(0.0, (*lead, r, 3)))
    seen = norm_residuals(sensor, y, c, made, w, dT)
    along = seen.norm_by_reading
    variance = np.einsum("...i,...ij,...j->...", along, covariance, along)
    return NoisyNormResiduals(seen.residual, seen.jacobian[..., :-1], variance, seen.by_rate)


def _is_separable_triad(sensor: Sensor) -> bool:
    """Return whether the axes are an orthogonal triad with terms along each axis only."""
    i = np.array([axis.i for axis in sensor.axes])
    orthogonal = len(i) == 3 and bool(np.all(np.abs(i @ i.T - np.eye(3)) < 2.0**-50))
    return orthogonal and all(
        CoefficientName(name).term in _AXIAL_TERMS for name in sensor.coefficients
    )
