"""Normal equations of readings in known motion, for many trials at once.

`inercal.methods.residuals.vector_residuals` has the model; here a compiled pass whitens its rows
trial by trial.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.benches import MeanMotion
from inercal.estimation.priors_and_gauges import cholesky
from inercal.estimation.problem import NormalEquations
from inercal.physics.sensors import Sensor


@dataclass(frozen=True, eq=False)
class VectorEquations:
    """Normal equations of trials by the residuals of `inercal.methods.residuals.vector_residuals`.

    Parameters
    ----------
    sensor : Sensor
        With p coefficients.
    y : (1 or trials, r, m) array
        Readings of all trials, SI.
    stated_motion : callable
        From x (1 or s, p + q) and the places of these trials (s,) to their motion.
    names : tuple of q str
        The parameters that follow the coefficients.
    readings : mapping of str to (r m,) array
        What a unit of a parameter adds to the readings, in place of any motion.
    noise : (..., n) or (..., n, n) array
        Deviations, or if correlated the covariance, of the observed readings of all trials.
    correlated : bool
    observed : (n,) array of int
        Places of the readings that are observed, row after row.
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
        """Return the equations of some of the observed readings alone."""
        noise = self.noise[..., at[:, None], at] if self.correlated else self.noise[..., at]
        return replace(self, noise=noise, observed=self.observed[at])

    @cached_property
    def _whitened_noise(self) -> tuple[Array, Array]:
        """Weights and factors, as of `inercal.methods.residuals._vector_kernel.WhitenedNoise`."""
        noise, correlated, n = self.noise, self.correlated, self.noise.shape[-1]
        variance = np.diagonal(noise, axis1=-2, axis2=-1) if correlated else noise
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
        """What units of the parameters add to the observed readings, (n, q)."""
        result = np.zeros((len(self.observed), len(self.names)))
        for name, column in self.readings.items():
            result[:, self.names.index(name)] = column[self.observed]
        return result

    def __call__(self, x: Array, which: Indices) -> NormalEquations:
        """Return the equations of trials at x, as `inercal.estimation.Problem` wants them."""
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
        found = NormalEquations(
            residual,
            np.empty((count, n)),
            np.empty((count, n)),
            np.empty((count, (p + q) * (p + q + 1) // 2)),
            np.empty((count, p + q)),
        )
        # Accelerometers alone see no rate.
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
    """Return an array with an axis of trials, which compiled code may write to."""
    return np.require(array.reshape((-1, *array.shape[1 - axes :])), requirements=["C", "W"])
