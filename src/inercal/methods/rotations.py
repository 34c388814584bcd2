"""Gravity's direction carried by the gyros from one rest to the next, against what is found there.

With û the direction of f̂ at a rest and R the rotation that the corrected rate makes of the passage
to the next, the residual is what is left across û at its end::

    ρ = B (û_after − R û_before),   B (2 × 3): two unit vectors across û_after

A turn about the vertical is not seen. The derivatives are exact to first order: R û moves by
û × ψ with ψ = Σ C δω Δt (`inercal.methods._kernels`), δω by the inverse of the sensor's model, and
û by the part of δf̂ across it over its length.

Source: Tedaldi, Pretto, Menegatti, "A robust and easy to implement method for IMU calibration
without external equipments", ICRA 2014, 3042–3049, equations 14 to 16; the errors of û, which
neighbouring passages share, and of the rate on the way are ours.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from inercal.errors import NotInvertible
from inercal.frames import skew
from inercal.methods._kernels import carry
from inercal.motion import Motion
from inercal.recording import Passages
from inercal.sensors import Sensor

Array = NDArray[np.float64]


class Affine(NamedTuple):
    """f and ω of a sample from its output, and how that depends on the coefficients."""

    back: Array  # (6, m), SI per output unit
    zero: Array  # (6,), SI
    to_coefficient: Array  # (3, 7, p), of ω per unit of (f, ω, 1)


class Rotations(NamedTuple):
    """The residuals of k passages; see the module."""

    residual: Array  # (k, 2), rad
    rotation: Array  # (k, 3, 3), R
    ahead: Array  # (k, 2, 3), ∂(−ρ)/∂ψ
    to_coefficient: Array  # (k, 2, p), ∂(−ρ): how the prediction runs ahead of the observation
    to_before: Array  # (k, 2, 3), of ρ to f̂ of the rest before
    to_after: Array  # (k, 2, 3), of ρ to f̂ of the rest after
    noise: Array  # (k, 2, 2), by the rate's white noise, rad²
    to_bias: Array  # (k, 2, 3), of ρ to a constant rate error, s


def affine(sensor: Sensor, c: Array) -> Affine:
    """Return the inverse of the sensor's model, linear in the motion.

    Terms that bend the accelerometers' response are left out: here f serves only to take the
    gyros' sensitivity to it away.

    Parameters
    ----------
    sensor : Sensor
        Accelerometers and gyros.
    c : (p,) array
        Coefficients in SI.

    Raises
    ------
    NotInvertible
        The coefficients make the sensor blind along some direction.
    """
    still = Motion(np.zeros((1, 3)))
    at_rest, at_rest_design, slope = (a[0] for a in sensor.linearise(still, c))
    if np.linalg.matrix_rank(slope) < 6:
        raise NotInvertible(f"sensor {sensor.name}: the coefficients make it blind somewhere")
    inverse: Array = np.asarray(np.linalg.pinv(slope), dtype=np.float64)
    scale = np.array([axis.readout.scale for axis in sensor.axes])
    offset = np.array([axis.readout.offset for axis in sensor.axes])
    unit = np.concatenate([np.eye(6), np.zeros((1, 6))])
    design = sensor.design(Motion(unit[:, :3], unit[:, 3:]), c)
    design[:6] -= at_rest_design
    straight = [
        sensor.coefficient(name).basis.degree("fi", "fp", "fo", "wi", "wp", "wo") <= 1
        for name in sensor.coefficients
    ]
    return Affine(
        inverse / scale,
        -inverse @ (offset / scale + at_rest),
        -np.einsum("bm,qmp->bqp", inverse[3:], design * straight),
    )


def rotations(
    passages: Passages, sensor: Sensor, c: Array, felt: Array, across: Array, white: Array
) -> Rotations:
    """Return the residuals and their derivatives.

    Parameters
    ----------
    passages : Passages
    sensor : Sensor
        Accelerometers and gyros.
    c : (p,) array
        Coefficients in SI.
    felt : (r, 3) array
        f̂ of each rest, m/s².
    across : (r, 2, 3) array
        B of each rest.
    white : (3, 3) array
        Covariance of one sample of the rate, (rad/s)².
    """
    length = np.linalg.norm(felt, axis=-1)
    up = felt / length[:, None]
    model = affine(sensor, c)
    way = passages
    turn, sensitivity, noise = carry(
        way.time, way.output, way.start, way.left, way.reached, way.stop,
        model.back, model.zero, white,
    )  # fmt: skip
    before, after = way.rest, way.rest + 1
    arrived = (turn @ up[before][:, :, None])[..., 0]
    b = across[after]
    # û × ψ = −[ψ×] û = [û×] ψ; ρ loses what the prediction gains.
    ahead = b @ skew(arrived)
    psi = np.einsum("kabq,bqp->kap", sensitivity, model.to_coefficient)
    return Rotations(
        rotation=turn,
        ahead=ahead,
        residual=(b @ (up[after] - arrived)[..., None])[..., 0],
        to_coefficient=ahead @ psi,
        to_before=-b @ turn @ _to_direction(up[before], length[before]),
        to_after=b @ _to_direction(up[after], length[after]),
        noise=ahead @ noise @ np.swapaxes(ahead, -1, -2),
        to_bias=-ahead @ sensitivity[..., 6],
    )


def _to_direction(up: Array, length: Array) -> Array:
    """Return ∂û/∂f̂, (k, 3, 3)."""
    return (np.eye(3) - up[:, :, None] * up[:, None, :]) / length[:, None, None]
