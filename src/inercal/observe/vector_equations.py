"""Normal equations of readings in known motion, for many trials at once.

`inercal.observe.vector_residuals` has the model; here a compiled pass whitens its rows trial by
trial.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from inercal.arrays import Array
from inercal.estimate.priors_and_gauges import cholesky
from inercal.estimate.problem import NormalEquations
from inercal.motion import Motion
from inercal.sensors import Sensor


class Noise(NamedTuple):
    """Noise of n observations, as `inercal.observe._vector_kernel.Whitening` has it."""

    weight: Array
    factor: Array

    @classmethod
    def of(cls, noise: Array, *, correlated: bool) -> "Noise":
        """Return it from deviations, (..., n), or if correlated a covariance, (..., n, n).

        Raises
        ------
        InputError
            A covariance that is not positive definite.
        """
        n = noise.shape[-1]
        if not correlated:
            with np.errstate(divide="ignore"):
                return cls(1 / noise.reshape(-1, n), np.zeros((0, n, n)))
        from inercal.observe._vector_kernel import factorise

        factor = np.array(noise.reshape(-1, n, n))
        if not factorise(factor):
            factor = np.array(cholesky(noise, "noise").reshape(-1, n, n))
        return cls(np.ones((1, n)), factor)


class BenchDerivatives(NamedTuple):
    """How the parameters that follow the coefficients act, by name.

    Parameters
    ----------
    names : sequence of q str
    df, dw : mapping of str to (..., r, 3) array
        Derivatives of f and ω.
    readings : mapping of str to (r m,) array
        What a unit of a parameter adds to the readings, in place of any motion.
    """

    names: Sequence[str]
    df: Mapping[str, Array]
    dw: Mapping[str, Array]
    readings: Mapping[str, Array]


def vector_normal_equations(
    sensor: Sensor,
    y: Array,
    x: Array,
    motion: Motion,
    others: BenchDerivatives,
    noise: Noise,
    which: NDArray[np.intp],
) -> NormalEquations:
    """Return the normal equations of trials by the residuals of `vector_residuals`.

    Parameters
    ----------
    sensor : Sensor
    y : (1 or trials, r, m) array
        Readings of all trials, SI.
    x : (1 or s, p + q) array
        Coefficients and the bench's parameters of these trials, SI.
    motion : Motion
        Of these trials, or shared by them, (..., r, 3).
    others : BenchDerivatives
    noise : Noise
        Of all trials.
    which : (s,) array of int
        Places of these trials.
    """
    from inercal.observe._vector_kernel import Derivatives, Scratch, Whitening, vector_kernel

    p, q, names = len(sensor.coefficients), len(others.names), others.names
    reading, design, slope = sensor.linearise(motion, x[:, :p])
    count, (r, m) = len(which), y.shape[-2:]
    residual = np.empty((count, r, m))
    np.subtract(y if len(y) == 1 else y[which], reading, out=residual)
    residual = residual.reshape(count, r * m)
    columns = np.zeros((r * m, q))
    if others.readings:
        columns[:, [names.index(name) for name in others.readings]] = np.array(
            [*others.readings.values()]
        ).T
        residual -= x[:, p:] @ columns.T
    found = NormalEquations(
        residual,
        np.empty((count, r * m)),
        np.empty((count, r * m)),
        np.empty((count, (p + q) * (p + q + 1) // 2)),
        np.empty((count, p + q)),
    )
    # Accelerometers alone see no rate.
    by_rate = _stacked(others, others.dw, r) if slope[..., 3:].any() else np.zeros((0, 1, r, 3))
    vector_kernel(
        Derivatives(
            _contiguous(design, 4),
            _contiguous(slope, 4),
            _stacked(others, others.df, r),
            by_rate,
            columns,
        ),
        Whitening(*noise),
        which.astype(np.int64, copy=False),
        Scratch.empty(r * m, p + q),
        found,
    )
    return found


def _contiguous(array: Array, axes: int) -> Array:
    """Return an array with an axis of trials, which compiled code may write to."""
    return np.require(array.reshape((-1, *array.shape[1 - axes :])), requirements=["C", "W"])


def _stacked(others: BenchDerivatives, by: Mapping[str, Array], r: int) -> Array:
    """Return the derivatives of f or ω, (q, 1 or s, r, 3)."""
    lead = np.broadcast_shapes(*(one.shape[:-2] for one in by.values())) or (1,)
    result = np.zeros((len(others.names), *lead, r, 3))
    for k, name in enumerate(others.names):
        if name in by and name not in others.readings:
            result[k] = by[name]
    return result
