"""Describe the coefficients of a triad for compiled filters, with their effects on readings.

A reading is affine in the coefficients, and its terms are of second degree in the sensed motion::

    y = N u + Σ_m c_m e_a(m) (T_m · φ(f, ω)),   φ = (1, f, ω, fx², fy², fz², fx fy, fx fz, fy fz)

where u is f or ω, and e_a is the axis that coefficient m belongs to. If the sensor depends on
temperature, φ also contains ΔT times all of these, and ΔT².
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Bools, Indices
from inercal.basics.errors import InputError
from inercal.physics.motion import Motion
from inercal.physics.sensors import G0, Sensor

BASIS = 13
BIAS, FORCE, RATE, SQUARE = 0, 1, 4, 7  # indices at which 1, f, ω and products of f begin in φ
TEMPERATURE = BASIS  # index of ΔT times all of these, before ΔT²


class Terms(NamedTuple):
    """The terms for three axes and p coefficients."""

    nominal: Array  # N, (3, 3)
    axis: Indices  # a(m), (p,)
    weights: Array  # T, (p, BASIS), or (p, 2 BASIS + 1) if the sensor depends on temperature
    first: int  # index of u in φ

    @property
    def bias(self) -> Bools:
        """Which coefficients are biases, (p,)."""
        return np.abs(self.weights) @ (np.arange(self.size) != BIAS) == 0

    @property
    def size(self) -> int:
        """Number of terms in φ."""
        return self.weights.shape[1]

    @property
    def has_temperature(self) -> bool:
        """Whether terms with ΔT are included."""
        return self.size > BASIS


def basis(motion: Motion) -> Array:
    """Return φ for a motion, without ΔT, (n, BASIS)."""
    f, w = np.broadcast_arrays(motion.f, motion.w)
    x, y, z = f.T
    one = np.ones_like(x)
    return np.stack([one, x, y, z, *w.T, x * x, y * y, z * z, x * y, x * z, y * z], axis=-1)


def terms(sensor: Sensor) -> Terms:
    """Return the terms for a triad of accelerometers or of gyros.

    Raises
    ------
    InputError
        There are not three axes of one kind, or the form or some coefficients are unsuitable.
    """
    kinds = {axis.measures for axis in sensor.axes}
    if len(sensor.axes) != 3 or len(kinds) != 1:
        axes = tuple(axis.name for axis in sensor.axes)
        raise InputError(
            f"sensor {sensor.name} has axes {', '.join(axes)}, but the method needs three "
            "accelerometers or three gyros",
            names=axes,
        )
    if sensor.form != "reference":
        raise InputError(
            f'sensor {sensor.name} has form = "{sensor.form}", but the method needs form = '
            '"reference"',
            key="form",
        )
    rng = np.random.default_rng(0)
    motion = Motion(G0 * rng.standard_normal((40, 3)), rng.standard_normal((40, 3)))
    probes = basis(motion)
    if sensor.uses("dT"):
        warmth = 10 * rng.standard_normal(len(probes))
        motion = replace(motion, dT=warmth)
        probes = np.column_stack([probes, warmth[:, None] * probes, warmth**2])
    scale = np.abs(probes).max(axis=0)
    p = len(sensor.coefficients)
    result = sensor.linearise(motion, np.zeros(p))
    back = np.asarray(np.linalg.pinv(probes / scale), dtype=float) / scale[:, None]
    whole = back @ result.reading  # (size of φ, 3)
    first = FORCE if kinds == {"f"} else RATE
    design = np.einsum("bn,nap->pab", back, result.design)
    axis = np.abs(design).max(axis=-1).argmax(axis=-1)
    weights = design[np.arange(p), axis]
    weights[np.abs(weights) < 1e-9] = 0.0
    away = result.design - np.einsum("nb,pb,ap->nap", probes, weights, np.eye(3)[:, axis])
    beyond = np.abs(away).max(axis=(0, 1)) > 1e-9 * np.abs(result.design).max(axis=(0, 1))
    if beyond.any():
        names = tuple(n for n, bad in zip(sensor.coefficients, beyond, strict=True) if bad)
        raise InputError(
            f"{sensor.name}: the method cannot estimate the coefficients {', '.join(names)}; remove"
            " them",
            names=names,
        )
    return Terms(whole[first : first + 3].T.copy(), axis, weights, first)
