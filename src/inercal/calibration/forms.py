"""Convert a calibration to the equation of IEEE Std 1293, other forms and other body frames.

The misalignments and scale factors of a triad form a matrix M with reading = M f + bias. A rotation
Q of the body frame, f' = Q f, does not change the readings and transforms the matrices exactly::

    M' = M Qᵀ        of accelerometers and of gyros
    G' = G Qᵀ        sensitivity of gyros to f

For the "triangular" frame, Q comes from M = L Q, where L is lower triangular. For the "symmetric"
frame, Q comes from the polar decomposition M = S Q.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.keys import CoefficientName
from inercal.calibration.shared_errors import SharedErrors, transform_shared
from inercal.estimation.uncertainty import value_and_jacobian
from inercal.physics import frames
from inercal.physics.sensors import G0, Sensor

Frame = Literal["mount", "triangular", "symmetric"]
_AFFINE = {"k0", "k1", "bias", "scale", "delta_o", "delta_p", "g_i", "g_p", "g_o"}


@dataclass(frozen=True, eq=False)
class ConvertedCoefficients:
    """Coefficients that were converted to another form.

    Parameters
    ----------
    names, units : tuple of str
    values : (q,) array
        Values of the coefficients in `units`.
    covariance : (q, q) array
    shared : tuple of SharedError or None
        See `Calibration`; here for the converted coefficients.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    covariance: Array
    shared: SharedErrors = None

    @property
    def std(self) -> Array:
        """Standard uncertainties (k = 1), (q,)."""
        return np.sqrt(np.diag(self.covariance))


def ieee1293(
    sensor: Sensor, values: Array, covariance: Array, shared: SharedErrors = None
) -> ConvertedCoefficients:
    """Return the coefficients of E = K₁ (K₀ + a + K₂ a² + δ_O a_P − δ_P a_O + …).

    E is the output minus the offset of the readout, and a is in g. K₁ has the name "x.K1" and is in
    output units per g. The name of any other coefficient is "x." plus its name in the table. The
    other coefficients refer to the input: they are divided by 1 + k1. Misalignments are in rad, and
    the rest is in powers of g. In a tilted model with nonlinear terms, K₁ and δ refer to the
    rotated axis, because an exact reference form does not exist.

    Raises
    ------
    InputError
        If the sensor has no accelerometer axis.
    """
    names: list[str] = []
    units: list[str] = []
    for axis in sensor.axes:
        if axis.measures != "f":
            continue
        names.append(f"{axis.name}.K1")
        units.append(f"{axis.readout.unit}/g")
        for full in sensor.coefficients:
            name, short = CoefficientName(full).parts
            if name == axis.name and short != "k1":
                names.append(full)
                units.append("rad" if short.startswith("delta") else _unit_in_g(sensor, full))
    if not names:
        raise InputError(
            f"sensor {sensor.name} has no accelerometer, but IEEE Std 1293 applies to "
            "accelerometers only; give a calibration with accelerometers",
            names=sensor.channels,
        )
    scales = {axis.name: axis.readout.scale * G0 for axis in sensor.axes}

    def convert(c: Array) -> Array:
        by_name: dict[str, float] = dict(zip(sensor.coefficients, c, strict=True))
        result: list[float] = []
        for full in names:
            axis, short = CoefficientName(full).parts
            gain = 1 + by_name.get(f"{axis}.k1", 0.0)
            if short == "K1":
                result.append(scales[axis] * gain)
            elif short.startswith("delta"):
                result.append(by_name[full] / (gain if sensor.form == "reference" else 1.0))
            else:
                result.append(by_name[full] / gain / sensor.coefficient(full).unit_scale)
        return np.array(result)

    converted, by = value_and_jacobian(convert, values, covariance)
    return ConvertedCoefficients(
        tuple(names), tuple(units), converted, by @ covariance @ by.T, transform_shared(shared, by)
    )


def _unit_in_g(sensor: Sensor, full: str) -> str:
    """Return the unit, in which g replaces µg, g/(rad/s)² replaces mm, and 1 replaces ppm."""
    unit = sensor.coefficient(full).unit
    return unit.replace("µg", "g").replace("mm", "g/(rad/s)²").replace("ppm", "1")


def convert_form(sensor: Sensor, values: Array, covariance: Array) -> tuple[Sensor, Array, Array]:
    """Convert to the other form of the model: return sensor, values (q,) and derivatives (q, p).

    The values are in SI units. The derivatives are with respect to the p given values, computed
    over the range of `covariance`.

    The scale and misalignments of the reference form, 1 + k1′, δ_O′ and δ_P′, are the components of
    one vector. This vector is (1 + k1) times the unit input axis of the tilted form, h = (1, tan
    δ_O, −tan δ_P)/norm::

        |1 + k1| = √((1 + k1′)² + δ_O′² + δ_P′²),   tan δ = δ′ / (1 + k1′)

    The sign of the gain 1 + k1 does not change.

    Raises
    ------
    InputError
        If there are nonlinear terms, because they act along a different axis in the other form.
    """
    beyond = [n for n in sensor.coefficients if CoefficientName(n).term not in _AFFINE]
    if beyond:
        raise InputError(
            f"{', '.join(beyond)} cannot be converted to the other form, in which nonlinear terms "
            "act along another axis; calibrate in that form instead",
            names=tuple(beyond),
        )
    modelled = {CoefficientName(name).axis for name in sensor.coefficients}
    vectors = [f"{axis}.{group}" for axis in modelled for group in ("scale", "misalignment")]
    full = sensor.with_coefficients(*sensor.coefficients, *vectors)

    def convert(c: Array) -> Array:
        by_name: dict[str, float] = dict.fromkeys(full.coefficients, 0.0)
        by_name |= dict(zip(sensor.coefficients, c, strict=True))
        for axis in sensor.axes:
            scale = f"{axis.name}.{'k1' if axis.measures == 'f' else 'scale'}"
            turns = [f"{axis.name}.delta_o", f"{axis.name}.delta_p"]
            if scale not in by_name:
                continue
            gain, *given = (by_name[name] for name in (scale, *turns))
            if sensor.form == "reference":
                if gain == -1:
                    raise InputError(
                        f"{scale} = -1 means zero gain, for which no tilt is defined; check the "
                        "value",
                        names=(scale,),
                    )
                # If an axis is reversed, the gain is negative, and the tilt stays within ±90°.
                length = float(np.linalg.norm([1 + gain, *given]))
                by_name[scale] = float(np.copysign(length, 1 + gain)) - 1
                changed = np.arctan(np.array(given) / (1 + gain))
            else:
                tangents = np.tan(given)
                along = (1 + gain) / float(np.linalg.norm([1, *tangents]))
                by_name[scale] = along - 1
                changed = along * tangents
            by_name |= dict(zip(turns, changed.tolist(), strict=True))
        return np.array([by_name[name] for name in full.coefficients])

    converted, by = value_and_jacobian(convert, values, covariance)
    other = "tilted" if sensor.form == "reference" else "reference"
    return replace(full, form=other), converted, by


def convert_frame(
    sensor: Sensor, values: Array, covariance: Array, frame: Frame
) -> tuple[Sensor, Array, Array, Array]:
    """Convert to a new frame: return sensor, values (q,), derivatives (q, p), rotation Q (3, 3).

    Values and derivatives are the same as in `convert_form`. Q converts vectors from the present
    frame to the new frame.

    Raises
    ------
    InputError
        If the sensor is not an accelerometer triad (with or without a gyro triad), or if the model
        has terms that are not affine.
    """
    beyond = [n for n in sensor.coefficients if CoefficientName(n).term not in _AFFINE]
    if beyond:
        raise InputError(
            f"{', '.join(beyond)} cannot be converted to another frame, which is possible only for "
            "affine terms; keep the frame of the calibration",
            names=tuple(beyond),
        )
    kinds = [axis.measures for axis in sensor.axes]
    if kinds not in (["f"] * 3, ["f"] * 3 + ["w"] * 3):
        raise InputError(
            f"sensor {sensor.name} has axes {', '.join(sensor.channels)}; the frame can be changed "
            "only for three accelerometers, with or without three gyros: keep the frame",
            names=sensor.channels,
        )
    groups = ("bias", "scale", "misalignment", *(["g"] if len(kinds) == 6 else []))
    full = sensor.with_coefficients(*groups)
    frames_of = np.stack([axis.frame for axis in sensor.axes])

    def matrices(c: Array) -> tuple[Array, Array, dict[str, float]]:
        by_name: dict[str, float] = dict.fromkeys(full.coefficients, 0.0)
        by_name |= dict(zip(sensor.coefficients, c, strict=True))
        own = np.zeros((len(kinds), 3))
        force = np.zeros((len(kinds), 3))
        for k, axis in enumerate(sensor.axes):
            scale = "k1" if axis.measures == "f" else "scale"
            row = [1 + by_name[f"{axis.name}.{scale}"]]
            row += [by_name[f"{axis.name}.delta_o"], -by_name[f"{axis.name}.delta_p"]]
            own[k] = np.array(row) @ frames_of[k]
            if axis.measures == "w":
                force[k] = [by_name[f"{axis.name}.g_{s}"] for s in "ipo"] @ frames_of[k]
        return own, force, by_name

    def rotation(c: Array) -> Array:
        split = frames.decompose_triangular if frame == "triangular" else frames.decompose_symmetric
        return split(matrices(c)[0][:3])[1]

    def convert(c: Array) -> Array:
        own, force, by_name = matrices(c)
        turn = rotation(c)
        own, force = own @ turn.T, force @ turn.T
        for k, axis in enumerate(sensor.axes):
            along, sensed = frames_of[k] @ own[k], frames_of[k] @ force[k]
            scale = "k1" if axis.measures == "f" else "scale"
            by_name[f"{axis.name}.{scale}"] = along[0] - 1
            by_name[f"{axis.name}.delta_o"], by_name[f"{axis.name}.delta_p"] = along[1], -along[2]
            if axis.measures == "w":
                by_name |= {f"{axis.name}.g_{s}": sensed[j] for j, s in enumerate("ipo")}
        return np.array([by_name[name] for name in full.coefficients])

    converted, by = value_and_jacobian(convert, values, covariance)
    return full, converted, by, rotation(values)
