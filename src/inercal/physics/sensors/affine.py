"""Convert between a triad's coefficients and its inverse model, f = M a + p.

A triad with bias, scale factor and both misalignments of each axis reads a = H f + b, where H and b
are affine in the twelve coefficients (reference form). Therefore M = H⁻¹ and p = −H⁻¹ b. This
mapping is one to one, and its derivatives are

    dM = −M dH M,   dp = −M (dH p + db);   dH = −H dM H,   db = −H (dM b + dp)

All values are in g. θ lists M row after row, then p: Sx Exy Exz, Eyx Sy Eyz, Ezx Ezy Sz,
Axp Ayp Azp in the notation of the source.

Source: Xiao Changrun, Liu Yang, Liu Ruijie, Transducer and Microsystem Technologies 33(10), 2014,
equation 1.
"""

from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.physics.motion import Motion
from inercal.physics.sensors import G0, Sensor

AFFINE_NAMES = ("Sx", "Exy", "Exz", "Eyx", "Sy", "Eyz", "Ezx", "Ezy", "Sz", "Axp", "Ayp", "Azp")
IDENTITY_PARAMETERS: Array = np.concatenate([np.eye(3).ravel(), np.zeros(3)])
_TERMS = ("k0", "k1", "delta_o", "delta_p")


class AffineModel(NamedTuple):
    """The model f = M a + p, with M (..., 3, 3) and p (..., 3) in g."""

    matrix: Array
    offset: Array

    @classmethod
    def of(cls, theta: Array) -> "AffineModel":
        """Return the model with parameters θ (..., 12)."""
        return cls(theta[..., :9].reshape(*theta.shape[:-1], 3, 3), theta[..., 9:])

    @property
    def theta(self) -> Array:
        """The parameters θ, (..., 12)."""
        m = self.matrix
        return np.concatenate([m.reshape(*m.shape[:-2], 9), self.offset], axis=-1)

    def correct(self, a: Array) -> Array:
        """Return the corrected readings M a + p for readings (..., r, 3) in g."""
        return a @ np.swapaxes(self.matrix, -1, -2) + self.offset[..., None, :]

    @property
    def inverse(self) -> "AffineModel":
        """The inverse model: H and b from M and p, or M and p from H and b."""
        back = np.asarray(np.linalg.inv(self.matrix), dtype=float)
        return AffineModel(back, -(back @ self.offset[..., None])[..., 0])

    @property
    def slope(self) -> Array:
        """Derivative of the inverse model's θ with respect to this model's θ, (..., 12, 12)."""
        back, offset = self.inverse
        lead = self.matrix.shape[:-2]
        # If dM has a single nonzero entry (j, k), −H dM H is −(column j of H)(row k of H).
        by_matrix = -np.einsum("...ij,...kl->...iljk", back, back).reshape(*lead, 9, 9)
        to_offset = -np.einsum("...ij,...k->...ijk", back, offset).reshape(*lead, 3, 9)
        above = np.concatenate([by_matrix, np.zeros((*lead, 9, 3))], axis=-1)
        return np.concatenate([above, np.concatenate([to_offset, -back], axis=-1)], axis=-2)


def require_affine_triad(sensor: Sensor) -> None:
    """Raise an error if the sensor's error model is not f = M a + p.

    Raises
    ------
    InputError
        The sensor is not three accelerometers in the reference form, each with k0, k1 and both
        misalignments.
    """
    wanted = {f"{axis.name}.{term}" for axis in sensor.axes for term in _TERMS}
    kinds = [axis.measures for axis in sensor.axes]
    if kinds != ["f"] * 3 or set(sensor.coefficients) != wanted or sensor.form != "reference":
        raise InputError(
            "this estimator needs exactly k0, k1, delta_o and delta_p for three accelerometers in "
            f"the reference form; sensor {sensor.name} has "
            f"{', '.join(sensor.coefficients) or 'none'} in the {sensor.form} form: correct "
            "[method] and [sensor] form, or use estimator joint",
            names=sensor.coefficients,
        )


def _affine_maps(sensor: Sensor) -> tuple[Array, Array]:
    """Return the nominal θ of (H, b), (12,), and its change per coefficient, (12, 12); in g."""
    sensed = np.concatenate([np.eye(3), np.zeros((1, 3))]) * G0
    p = len(sensor.coefficients)
    read = [sensor.forward(Motion(sensed), c) / G0 for c in (np.zeros(p), *np.eye(p))]
    thetas = [np.concatenate([(y[:3] - y[3]).T.ravel(), y[3]]) for y in read]
    return thetas[0], np.array(thetas[1:]).T - thetas[0][:, None]


def to_affine(sensor: Sensor, c: Array) -> tuple[AffineModel, Array]:
    """Return M and p for coefficients (..., 12) in SI, and ∂θ/∂c, (..., 12, 12).

    Raises
    ------
    InputError
        The sensor has a different error model.
    """
    require_affine_triad(sensor)
    nominal, by = _affine_maps(sensor)
    reading = AffineModel.of(nominal + c @ by.T)
    return reading.inverse, reading.slope @ by


def to_coefficients(sensor: Sensor, model: AffineModel) -> tuple[Array, Array]:
    """Return the coefficients (..., 12) in SI for M and p, and ∂c/∂θ, (..., 12, 12).

    Raises
    ------
    InputError
        The sensor has a different error model.
    """
    require_affine_triad(sensor)
    nominal, by = _affine_maps(sensor)
    back = np.asarray(np.linalg.inv(by), dtype=float)
    return (model.inverse.theta - nominal) @ back.T, back @ model.slope
