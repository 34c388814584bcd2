"""Provide the residual functions that the methods share: readings minus predicted readings.

Vector observation: the mean reading of each row minus the model's reading for its motion,
y − h(f, ω; c). The derivatives are exact. Derivatives with respect to the parameters of the motion
follow from the chain rule. Norm observation: the attitude is unknown, and only the norm of the
sensed motion is compared. A compiled kernel computes many trials of three accelerometers from their
declared terms.

For many trials at once, `VectorEquations` and `norm_normal_equations` compute the normal equations
of both observations. Compiled code whitens the rows trial by trial.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.benches import MeanMotion
from inercal.estimation.problem import NormalEquations, cholesky
from inercal.methods.residuals.term_table import TermTable, term_table
from inercal.physics.motion import Motion
from inercal.physics.sensors import Sensor, inverse
from inercal.physics.sensors.inverse import invert as invert_3x3


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
        Sensitivity of specific force and rate to the nuisances; None for `dw` means zero.
    """
    reading, design, slope = sensor.linearise(motion, c)
    residual = y - reading
    p, q = design.shape[-1], df.shape[-1]
    # Only the slope may differ between trials if the motion is exact in all of them.
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
    jacobian: Array  # (..., r, p + 1), of ‖f̂‖ − g, for the coefficients and g
    specific_force: Array  # (..., r, 3), f̂
    up: Array  # (..., r, 3), f̂ / ‖f̂‖
    design: Array  # (..., r, m, p), ∂h/∂c at f̂
    by_reading: Array  # (..., r or 1, 3, m), ∂f̂/∂y
    norm_by_reading: Array  # (..., r, m), ∂‖f̂‖/∂y
    by_rate: Array  # (..., r, 3), ∂‖f̂‖/∂ω; zero if no ω was given

    @property
    def by_coefficient(self) -> Array:
        """∂f̂/∂c, (..., r, 3, p)."""
        return -self.by_reading @ self.design


def norm_residuals(
    sensor: Sensor, y: Array, c: Array, g: Array, w: Array | None = None, dT: Array | float = 0.0
) -> NormResiduals:
    """Return the residuals 0 − (‖f̂‖ − g) of readings in unknown attitudes, with f̂ = h⁻¹(y; c).

    From h(f̂; c) = y, the derivative of f̂ is −S⁻¹ ∂h/∂c for the coefficients and S⁻¹ for the
    reading, with S = ∂h/∂f. The derivative of ‖f̂‖ is the component along f̂. Readings beyond the
    fold of the model have the residual NaN, so that an optimiser rejects the step.

    Parameters
    ----------
    sensor : Sensor
        Three or more accelerometers, without gyros.
    y : (..., r, m) array
        Readings in SI.
    c : (..., p) array
        Coefficients in SI.
    g : (..., r) or (..., 1) array
        Norm of the specific force in each row, or in all rows, m/s².
    w : (..., r, 3) array, optional
        Angular rate, rad/s, if lever arms are modelled.
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
    invert = invert_3x3 if len(sensor.axes) == 3 else np.linalg.pinv
    back = np.asarray(invert(by_force), dtype=np.float64)
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
    jacobian: Array  # (..., r, p), of ‖f̂‖, for the coefficients
    variance: Array  # (..., r), variance of ‖f̂‖ due to the readings' noise, (m/s²)²
    by_rate: Array  # (..., r, 3), ∂‖f̂‖/∂ω; zero without lever arms


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
        The same as for `norm_residuals`.
    covariance : (..., r, m, m) array
        Covariance of the readings in each row.
    made : (..., r) array
        Norm of the specific force in each row, m/s².
    w : (..., r, 3) array, optional
    dT : (..., r) array or float
        The same as for `norm_residuals`.
    """
    lead = np.broadcast_shapes(y.shape[:-2], covariance.shape[:-3], c.shape[:-1], made.shape[:-1])
    table = term_table(sensor) if len(lead) == 1 else None
    if table is not None:
        # NumPy allocates large pages, which the solver reads faster than memory that compiled code
        # allocates.
        jacobian = np.empty((*lead, y.shape[-2], c.shape[-1]))
        bench = StatedNorms(made, np.zeros((0, *made.shape)), np.zeros_like(made))
        x = np.broadcast_to(c, (*lead, c.shape[-1]))
        which = np.arange(lead[0], dtype=np.int64)
        found = norm_normal_equations(table, y, covariance, dT, bench, x, which, jacobian)
        none: Array = np.broadcast_to(0.0, (*lead, y.shape[-2], 3))
        return NoisyNormResiduals(found.residual, jacobian, found.weight**-2.0, none)
    seen = norm_residuals(sensor, y, c, made, w, dT)
    along = seen.norm_by_reading
    variance = np.einsum("...i,...ij,...j->...", along, covariance, along)
    return NoisyNormResiduals(seen.residual, seen.jacobian[..., :-1], variance, seen.by_rate)


class StatedNorms(NamedTuple):
    """Norms of the specific force in r rows as the bench states them, for s trials or for all."""

    norm: Array  # (..., r), m/s²
    derivatives: Array  # (q, ..., r), with respect to the bench's parameters
    variance: Array  # (..., r), variance due to the errors of each row, (m/s²)²


def norm_normal_equations(
    table: TermTable,
    y: Array,
    covariance: Array,
    dT: Array | float,
    stated: StatedNorms,
    x: Array,
    which: Indices,
    jacobian: Array | None = None,
) -> NormalEquations:
    """Return the normal equations of trials for the residuals of `noisy_norm_residuals`.

    Parameters
    ----------
    table : TermTable
        Term table of the sensor.
    y, covariance, dT
        Values for each trial, or one value for all trials, as for `noisy_norm_residuals`.
    stated : StatedNorms
        Norms for each of these trials, or one set for all.
    x : (s, p + q) array
        Coefficients and bench parameters for these trials, SI.
    which : (s,) array of int
        Indices of these trials.
    jacobian : (s, r, p + q) array, optional
        If given, it receives the unweighted Jacobian instead of the normal equations.
    """
    from inercal.methods.residuals import _kernels
    from inercal.methods.residuals._force_inversion import Model, Rows

    (count, k), r = x.shape, y.shape[-2]
    warmth = np.broadcast_to(dT, (*np.shape(dT)[:-1], r))
    derivatives = stated.derivatives.reshape(len(stated.derivatives), stated.norm.size // r, r)
    found = NormalEquations.empty(count, r, k)
    # Small arrays are copied, because numba would compile again for a read-only array.
    _kernels.norm_kernel(
        table,
        (
            np.ascontiguousarray(y.reshape(-1, r, 3)),
            np.ascontiguousarray(covariance.reshape(-1, r, 3, 3)),
            np.array(np.atleast_2d(warmth), order="C"),
        ),
        (
            np.array(np.atleast_2d(stated.norm), order="C"),
            derivatives.copy(),
            np.array(np.atleast_2d(stated.variance), order="C"),
        ),
        np.array(x, order="C"),
        which,
        Model.empty(),
        Rows.empty(r, k),
        found,
        np.empty((0, 0, 0)) if jacobian is None else jacobian,
    )
    return found


@dataclass(frozen=True, eq=False)
class VectorEquations:
    """Normal equations of trials for the residuals of `inercal.methods.residuals.vector_residuals`.

    Parameters
    ----------
    sensor : Sensor
        Sensor with p coefficients.
    y : (1 or trials, r, m) array
        Readings of all trials, SI.
    stated_motion : callable
        Maps x (1 or s, p + q) and the indices of these trials (s,) to their motion.
    names : tuple of q str
        The parameters that come after the coefficients.
    readings : mapping of str to (r m,) array
        Direct effect of a unit of a parameter on the readings, rather than on the motion.
    noise : (..., n) or (..., n, n) array
        Standard deviations of the observed readings in all trials, or their covariance if
        `correlated`.
    correlated : bool
    observed : (n,) array of int
        Indices of the observed readings, row after row.
    """

    sensor: Sensor
    y: Array
    stated_motion: Callable[[Array, Indices], MeanMotion]
    names: tuple[str, ...]
    readings: Mapping[str, Array]
    noise: Array
    correlated: bool
    observed: Indices

    def subset(self, at: Indices) -> "VectorEquations":
        """Return the equations for only some of the observed readings."""
        noise = self.noise[..., at[:, None], at] if self.correlated else self.noise[..., at]
        return replace(self, noise=noise, observed=self.observed[at])

    @cached_property
    def _whitened_noise(self) -> tuple[Array, Array]:
        """Weights and factors for `inercal.methods.residuals._vector_kernel.WhitenedNoise`."""
        noise, correlated, n = self.noise, self.correlated, self.noise.shape[-1]
        variance = np.linalg.diagonal(noise) if correlated else noise
        if correlated and np.count_nonzero(variance) == np.count_nonzero(noise):
            noise, correlated = np.sqrt(variance), False
        if not correlated:
            with np.errstate(divide="ignore"):
                weight = np.ascontiguousarray(1 / noise.reshape(-1, n))
            return weight, np.zeros((0, n, n))
        from inercal.methods.residuals._vector_kernel import to_cholesky_factors

        factor = np.array(noise.reshape(-1, n, n))
        if not to_cholesky_factors(factor):
            factor = np.array(cholesky(noise, "noise").reshape(-1, n, n))
        return np.ones((1, n)), factor

    @cached_property
    def _columns(self) -> Array:
        """Effect of unit parameters on the observed readings, (n, q)."""
        result = np.zeros((len(self.observed), len(self.names)))
        for name, column in self.readings.items():
            result[:, self.names.index(name)] = column[self.observed]
        return result

    def __call__(self, x: Array, which: Indices) -> NormalEquations:
        """Return the equations of trials at x, as `inercal.estimation.Problem` expects them."""
        from inercal.methods.residuals._vector_kernel import (
            Derivatives,
            TrialBuffer,
            WhitenedNoise,
            vector_kernel,
        )

        if x.strides[0] == 0:
            x = x[:1]  # the start that all trials share
        stated = self.stated_motion(x, which)
        p, q, n = len(self.sensor.coefficients), len(self.names), len(self.observed)
        reading, design, slope = self.sensor.linearise(stated.motion, x[:, :p])
        count, r = len(which), self.y.shape[-2]
        residual = np.empty((count, *self.y.shape[-2:]))
        np.subtract(self.y if len(self.y) == 1 else self.y[which], reading, out=residual)
        residual = residual.reshape(count, -1)
        if n < residual.shape[-1]:
            residual = residual[:, self.observed]
        if self.readings:
            residual -= x[:, p:] @ self._columns.T
        found = NormalEquations.empty(count, n, p + q)._replace(residual=residual)
        # If there are only accelerometers, no rate is sensed.
        by_rate = self._stacked(stated.dw, r) if slope[..., 3:].any() else np.zeros((0, 1, r, 3))
        vector_kernel(
            Derivatives(
                _contiguous(design, 4),
                _contiguous(slope, 4),
                self._stacked(stated.df, r),
                by_rate,
                self._columns,
                self.observed,
            ),
            WhitenedNoise(*self._whitened_noise),
            which.astype(np.int64, copy=False),
            TrialBuffer.empty(n, p + q),
            found,
        )
        return found

    def _stacked(self, by: Mapping[str, Array], r: int) -> Array:
        """Return the derivatives of f or ω, (q, 1 or s, r, 3)."""
        lead = np.broadcast_shapes(*(one.shape[:-2] for one in by.values())) or (1,)
        result = np.zeros((len(self.names), *lead, r, 3))
        for k, name in enumerate(self.names):
            if name in by and name not in self.readings:
                result[k] = by[name]
        return result


def _contiguous(array: Array, axes: int) -> Array:
    """Return an array with a trial axis that compiled code may write to."""
    return np.require(array.reshape((-1, *array.shape[1 - axes :])), requirements=["C", "W"])
