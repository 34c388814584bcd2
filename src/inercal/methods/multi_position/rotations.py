"""Compare the direction of gravity propagated by the gyros with that from the accelerometers.

û is the direction of f̂ at a rest, and R the rotation during the transition to the next rest, from
the corrected rate. The residual is the difference across û at the end of the transition::

    ρ = B (û_after − E R û_before),   B (2 × 3): two unit vectors across the nominal û_after

The gyros also sense the earth's rate; E = exp(ω_e T) removes that rotation. A turn about the
vertical changes no residual. The samples' times are those of the recording's clock. A true interval
is T (1 + τ), and the factor 1 + τ applies to all rotations except the earth's, which is small. The
derivatives are exact to first order: R û moves by û × ψ with ψ = Σ C δω Δt (`_kernels`), where δω
comes from the inverse of the sensor's model. û moves by the part of δf̂ across it, divided by ‖f̂‖.

Source: Tedaldi, Pretto, Menegatti, "A robust and easy to implement method for IMU calibration
without external equipments", ICRA 2014, 3042–3049, equations 14 to 16. The errors of û, which
neighbouring transitions share, and the errors of the rate during transitions are our own addition.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Bools, Indices
from inercal.basics.errors import NotInvertible
from inercal.methods import temperature
from inercal.physics.frames import exp_so3, skew
from inercal.physics.motion import Motion
from inercal.physics.sensors import Sensor
from inercal.recordings import Transitions

_CHUNK_SAMPLES = 100_000  # samples
_ITERATIONS = 2  # each reduces the remaining error to a few thousandths


class InverseModel(NamedTuple):
    """f and ω of a sample computed from its output, and their sensitivity to the coefficients."""

    matrix: Array  # (6, m), SI per output unit
    offset: Array  # (6,), SI
    coefficient_derivatives: Array  # (3, 7, p), derivatives of ω per unit of (f, ω, 1)


class TransitionRotations(NamedTuple):
    """The rotations during k transitions from the corrected rate, and their derivatives."""

    rotation: Array  # (k, 3, 3), R
    coefficient_derivatives: Array  # (k, 3, p), derivatives of ψ
    to_bias: Array  # (k, 3, 3), sensitivity of ψ to a constant rate error, s
    to_timebase: Array  # (k, 3), sensitivity of ψ to the relative error τ of the clock, rad
    noise: Array  # (k, 3, 3), covariance of ψ due to the rate's white noise in between, rad²


class RotationResiduals(NamedTuple):
    """The residuals of k transitions; see the module's description."""

    rest: Indices  # (k,), where each transition begins
    way: TransitionRotations
    residual: Array  # (k, 2), ρ in rad
    to_end_turn: Array  # (k, 2, 3), ∂(−ρ)/∂ψ, of the prediction minus the observation
    to_before: Array  # (k, 2, 3), sensitivity of ρ to f̂ at the rest before
    to_after: Array  # (k, 2, 3), sensitivity of ρ to f̂ at the rest after
    to_earth: Array  # (k, 2, 3), sensitivity of −ρ to the earth's rotation, rad
    to_timebase: Array  # (k, 2), sensitivity of −ρ to the relative error of the clock, rad


def inverse_model(sensor: Sensor, c: Array, dT: float = 0.0) -> InverseModel:
    """Return the inverse of the sensor's model, linear in the motion.

    The nonlinear terms of the accelerometers are omitted, because f is only used here to remove the
    gyros' sensitivity to it.

    Parameters
    ----------
    sensor : Sensor
        Accelerometers and gyros, or gyros only.
    c : (p,) array
        Coefficients in SI.
    dT : float
        Temperature minus the sensor's reference temperature, K.

    Raises
    ------
    NotInvertible
        The output does not determine all of f and ω.
    """
    return InverseModel(*(part[0] for part in inverse_models(sensor, c, np.array([dT]))))


def inverse_models(sensor: Sensor, c: Array, dT: Array) -> InverseModel:
    """Return the inverse models at k temperatures, with a leading axis of length k.

    `dT` (k,) is the temperature minus the reference temperature, K.
    """
    warmth = dT[:, None]
    at_rest, at_rest_design, slope = sensor.linearise(
        Motion(np.zeros((len(dT), 1, 3)), dT=warmth), c
    )
    slope = np.broadcast_to(slope, (*at_rest.shape, 6))[:, 0]
    at_rest, at_rest_design = at_rest[:, 0], at_rest_design[:, 0]
    kinds = {axis.measures for axis in sensor.axes}
    if (np.linalg.matrix_rank(slope) < len("xyz") * len(kinds)).any():
        raise NotInvertible(
            f"sensor {sensor.name}: with these coefficients the output does not determine specific "
            "force and rate; check that no two axes are parallel and no gain is 0"
        )
    inverse: Array = np.asarray(np.linalg.pinv(slope), dtype=np.float64)
    scale = np.array([axis.readout.scale for axis in sensor.axes])
    offset = np.array([axis.readout.offset for axis in sensor.axes])
    unit = np.broadcast_to(np.eye(7, 6), (len(dT), 7, 6))
    design = sensor.design(Motion(unit[..., :3], unit[..., 3:], dT=warmth), c)
    design[:, :6] -= at_rest_design[:, None]
    return InverseModel(
        inverse / scale,
        -(inverse @ (offset / scale + at_rest)[..., None])[..., 0],
        -np.einsum("kbm,kqmp->kbqp", inverse[:, 3:], design * _linear_coefficients(sensor)),
    )


def _linear_coefficients(sensor: Sensor) -> Bools:
    """Return which coefficients contribute to a rate that is linear in the motion, (p,)."""
    sensed = ("fi", "fp", "fo", "wi", "wp", "wo")
    return np.array(
        [sensor.coefficient(name).basis.degree(*sensed) <= 1 for name in sensor.coefficients]
    )


def output_at_reference(output: Array, sensor: Sensor, c: Array, dT: Array) -> Array:
    """Return the output that the sensor would give at its reference temperature, (n, m).

    Parameters
    ----------
    output : (n, m) array
        Output in output units.
    sensor : Sensor
    c : (p,) array
        Coefficients in SI.
    dT : (n,) array
        Temperature of each sample minus the reference temperature, K.
    """
    model, result = inverse_model(sensor, c), np.empty(output.shape)
    scale = np.array([axis.readout.scale for axis in sensor.axes])
    # In the reference form each term adds to the reading independently.
    names = tuple(temperature.temperature_coefficients(sensor))
    names = sensor.coefficients if sensor.form == "tilted" else names
    hot = replace(sensor, coefficients=names)
    warm = c[[sensor.coefficients.index(name) for name in names]]
    for start in range(0, len(output), _CHUNK_SAMPLES):
        at = slice(start, start + _CHUNK_SAMPLES)
        result[at] = output[at]
        for _ in range(_ITERATIONS):
            sensed = result[at] @ model.matrix.T + model.offset
            here, there = (
                hot.forward(Motion(sensed[:, :3], sensed[:, 3:], dT=warmth), warm)
                for warmth in (dT[at], 0.0)
            )
            result[at] = output[at] - (here - there) * scale
    return result


def transition_rotations(
    transitions: Transitions,
    sensor: Sensor,
    c: Array,
    white: Array,
    timebase: float = 0.0,
    dT: Array | None = None,
) -> TransitionRotations:
    """Return the rotations during transitions, from the corrected rate.

    Parameters
    ----------
    transitions : Transitions
    sensor : Sensor
        Accelerometers and gyros.
    c : (p,) array
        Coefficients in SI.
    white : (3, 3) array
        Covariance of one sample of the rate, (rad/s)².
    timebase : float
        Relative error of the recording's clock: true intervals are 1 + timebase times as long.
    dT : (n,) array, optional
        Temperature of each sample minus the sensor's reference temperature, K.
    """
    model = inverse_model(sensor, c)
    integrate = _integral(transitions, sensor, c, model, white, timebase, dT)
    turn, sensitivity, noise = integrate(np.zeros(0))
    coefficient_derivatives = np.einsum("kabq,bqp->kap", sensitivity, model.coefficient_derivatives)
    if dT is not None:
        _, warmed, _ = integrate(dT)
        by_kelvin = (
            inverse_model(sensor, c, 1.0).coefficient_derivatives - model.coefficient_derivatives
        )
        coefficient_derivatives += np.einsum("kabq,bqp->kap", warmed, by_kelvin)
    to_timebase = np.einsum("kabb->ka", sensitivity[..., 3:6]) / (1 + timebase)
    return TransitionRotations(
        turn, coefficient_derivatives, sensitivity[..., 6], to_timebase, noise
    )


def rotations_only(
    transitions: Transitions, sensor: Sensor, c: Array, timebase: float, dT: Array | None
) -> Array:
    """Return R of each transition, (k, 3, 3), which takes a third of `transition_rotations`."""
    model, white = inverse_model(sensor, c), np.zeros((3, 3))
    return _integral(transitions, sensor, c, model, white, timebase, dT)(None)[0]


def _integral(
    way: Transitions,
    sensor: Sensor,
    c: Array,
    model: InverseModel,
    white: Array,
    timebase: float,
    dT: Array | None,
) -> Callable[[Array | None], tuple[Array, Array, Array]]:
    """Return `integrate_transitions` as a function of the samples' weights."""
    from inercal.methods.multi_position._kernels import integrate_transitions  # loads Numba

    time = way.time * (1 + timebase)
    output = way.output if dT is None else output_at_reference(way.output, sensor, c, dT)
    ends = way.start, way.left, way.reached, way.stop
    noise = np.ascontiguousarray(white)
    return partial(integrate_transitions, time, output, ends, model.matrix, model.offset, noise)


def rotation_residuals(
    rest: Indices, way: TransitionRotations, sensed: Array, across: Array, earth: Array
) -> RotationResiduals:
    """Return the residuals and their derivatives.

    Parameters
    ----------
    rest : (k,) array of int
        Index of the rest at which each transition begins.
    way : TransitionRotations
    sensed : (r, 3) array
        f̂ at each rest, m/s².
    across : (r, 2, 3) array
        B for each rest.
    earth : (k, 3) array
        Rotation of the earth in each transition, ω_e T in the body's frame after it, rad.
    """
    length = np.linalg.norm(sensed, axis=-1)
    up = sensed / length[:, None]
    before, after = rest, rest + 1
    e, b = exp_so3(earth), across[after]
    turn = e @ way.rotation
    arrived = (turn @ up[before][:, :, None])[..., 0]
    # û × ψ = −[ψ×] û = [û×] ψ; ρ decreases by as much as the prediction increases.
    ahead = b @ skew(arrived)
    return RotationResiduals(
        rest=rest,
        way=way,
        residual=(b @ (up[after] - arrived)[..., None])[..., 0],
        to_end_turn=ahead @ e,
        to_before=-b @ turn @ _direction_jacobian(up[before], length[before]),
        to_after=b @ _direction_jacobian(up[after], length[after]),
        to_earth=-ahead,
        to_timebase=(ahead @ e @ way.to_timebase[..., None])[..., 0],
    )


def _direction_jacobian(up: Array, length: Array) -> Array:
    """Return ∂û/∂f̂, (k, 3, 3)."""
    return (np.eye(3) - up[:, :, None] * up[:, None, :]) / length[:, None, None]
