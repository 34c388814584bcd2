"""Write a correction as code: matrix, nonlinear and temperature terms, and number of passes.

With y = M x + b + n(x, ΔT), in the sensor's own output units s y + o, the motion x is the limit of

    x ← C (output − o − s n(x, ΔT)),   C = M⁻¹/s,   starting with n = 0

The code repeats this step a constant number of times, which is sufficient over the calibrated
range, so a device need not test convergence. The code for n is generated from the declarations of
the basis functions.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.keys import CoefficientName
from inercal.basics.units import ZERO_CELSIUS
from inercal.export.model import ExportModel
from inercal.export.ranges import sample_motions
from inercal.export.target_definition import Request
from inercal.export.term_kinds import DERIVATIVES, LINEAR, kinds_of
from inercal.physics.motion import Motion
from inercal.physics.quantities import KINDS
from inercal.physics.sensors import Sensor

_SETTLED = 1e-10  # largest change between two passes, relative to the range
_MAX_PASSES = 30
_PARALLEL = 1e-12
_COMPONENTS = {kind + axis: k for kind in KINDS for k, axis in enumerate("ipo")}


@dataclass(frozen=True)
class Dialect:
    """The notation of a language for numbers, products and motion components.

    Parameters
    ----------
    number : callable
        Function float -> text.
    component : str
        Expression for a motion component, with {} for its index.
    sign : str
        Expression for the sign of a variable, with {0} for its name.
    times : str
    first : int
        The first array index in the language, 0 or 1.
    """

    number: Callable[[float], str]
    component: str
    sign: str
    times: str = " * "
    first: int = 0


@dataclass(frozen=True, eq=False)
class CodeModel:
    """A correction as code.

    Parameters
    ----------
    model : ExportModel
    limits : (float, float) or None
        Range to which temperatures are clipped, °C; None if no range is stated.
    passes : int
        Number of passes; 0 for a linear model.
    """

    model: ExportModel
    limits: tuple[float, float] | None
    passes: int

    @property
    def takes_temperature(self) -> bool:
        """Whether the correction depends on temperature."""
        return _held(self.model).uses("dT")

    @property
    def reference(self) -> float:
        """The reference temperature, °C."""
        return self.model.sensor.reference_temperature - ZERO_CELSIUS

    def correct(self, readings: Array, dT: Array, digits: type[Any] = np.float64) -> Array:
        """Return the motion that the code computes from readings in SI, (n, k).

        Parameters
        ----------
        readings : (n, k) array
        dT : (n,) array
        digits : type
            Number type of variables and constants, numpy.float32 or numpy.float64.
        """
        output = self.model.outputs(readings)[:, self.model.inputs].astype(digits)
        matrix, offset = self.model.gain.astype(digits), self.model.zero.astype(digits)
        if self.limits is not None:
            dT = np.clip(dT + self.reference, *self.limits) - self.reference
        scale = self.model.joined("scale")
        x: Any = (output - offset) @ matrix.T
        for _ in range(self.passes):
            extra: Any = scale * nonlinear(self.model, x.astype(float), dT)
            x = (output - offset - extra[:, self.model.inputs].astype(digits)) @ matrix.T
        return x.astype(float)


def code_model(request: Request) -> CodeModel:
    """Return a calibration's correction as code.

    Raises
    ------
    InputError
        The passes do not converge over the calibrated range.
    """
    model, known = request.model, request.ranges.temperature
    limits = None if known is None else (known[0] - ZERO_CELSIUS, known[1] - ZERO_CELSIUS)
    if not _held(model).uses("dT"):
        limits = None
    one = CodeModel(model, limits, 0)
    if not _nonlinear_names(model):
        return one
    motion = sample_motions(model.calibration, request.ranges)
    x = model.motion(motion)
    dT = np.broadcast_to(motion.dT, x.shape[:1])
    y = x @ model.matrix.T + model.joined("bias") + nonlinear(model, x, dT)
    # A field in T is a much smaller number than a force or a rate.
    field = np.repeat([kind == "m" for kind, _ in model.triads], 3)
    size = np.array([np.abs(x[:, field == own]).max(initial=0.0) for own in field])
    estimate = (y - model.joined("bias")) @ model.correction.T
    for passes in range(1, _MAX_PASSES + 1):
        extra = nonlinear(model, estimate, dT)
        estimate = (y - model.joined("bias") - extra) @ model.correction.T
        if (np.abs(estimate - x) <= _SETTLED * size).all():
            return replace(one, passes=passes)
    raise InputError(
        f"the nonlinear terms of {model.sensor.name} are too large for code with {_MAX_PASSES} "
        "passes over the range; give a smaller range, or use --refit with a target without "
        "these terms"
    )


def nonlinear(model: ExportModel, x: Array, dT: Array) -> Array:
    """Return n(x, ΔT) for the target's channels at a motion (n, k), in SI, (n, k)."""
    parts = {kind: x[:, 3 * k : 3 * k + 3] @ model.turn for k, (kind, _) in enumerate(model.triads)}
    zero = np.zeros((1, 3))
    motion = Motion(parts.get("f", zero), parts.get("w", zero), zero, dT, m=parts.get("m", zero))
    sensor, names = model.sensor, _nonlinear_names(model)
    values = np.array(model.calibration.values)
    kinds = [kind for _, kind, _ in kinds_of(sensor)]
    linear = np.where([kind in LINEAR for kind in kinds], values, 0.0)
    complete = np.where([name in names for name in sensor.coefficients], values, linear)
    change = sensor.forward(motion, complete) - sensor.forward(motion, linear)
    change = np.broadcast_to(change, (*x.shape[:1], change.shape[-1]))
    return np.concatenate([change[:, list(t.rows)] * t.signs for _, t in model.triads], axis=-1)


def statements(model: ExportModel, dialect: Dialect) -> tuple[dict[str, str], list[str]]:
    """Return auxiliary variables by name, and an expression for s n of each input ("" for 0).

    `dT` is the temperature difference from the reference, K.
    """
    sensor = model.sensor
    names = _nonlinear_names(model)
    values = dict(zip(sensor.coefficients, model.calibration.values.tolist(), strict=True))
    made: dict[str, str] = {}
    lines: list[str] = []
    scales = model.joined("scale")
    # Start index of each kind of motion; motion that is not measured is 0.
    starts = {kind: dialect.first + 3 * k for k, (kind, _) in enumerate(model.triads)}
    pairs = [one for _, t in model.triads for one in zip(t.rows, t.signs.tolist(), strict=True)]
    for channel in model.inputs:
        row, sign = pairs[channel]
        axis = sensor.axes[row]
        mine = [n for n in names if CoefficientName(n).axis == axis.name]
        directions = _directions(model, row)
        parts: list[str] = []
        for name in mine:
            for product in sensor.coefficient(name).basis.products:
                size = sign * scales[channel] * values[name] * product.factor
                factors = [
                    _variable(one, directions, axis.measures, dialect, starts, made)
                    for one in product.components
                ]
                parts.append(dialect.times.join([dialect.number(float(size)), *factors]))
        lines.append(" + ".join(parts))
    return made, lines


def _variable(
    component: str,
    directions: Array,
    measures: str,
    dialect: Dialect,
    starts: Mapping[str, int],
    made: dict[str, str],
) -> str:
    """Return the variable for a motion component along an axis; add a new one to `made`."""
    if component == "dT":
        return "dT"
    if component in ("si", "swi"):
        axis = "fi" if component == "si" else "wi"
        along = _variable(axis, directions, measures, dialect, starts, made)
        made.setdefault(f"sign_{along}", dialect.sign.format(along))
        return f"sign_{along}"
    kind, k = component[0], _COMPONENTS[component]
    # Misalignments tilt the input axis only for motion of the kind that the sensor measures.
    vector = directions[k if kind == measures or k else 3]
    parts = np.flatnonzero(np.abs(vector) > _PARALLEL).tolist()
    for j in parts:
        at = dialect.component.format(starts[kind] + j) if kind in starts else dialect.number(0.0)
        made.setdefault(f"{kind}{j}", at)
    if len(parts) == 1 and vector[parts[0]] > 0:
        return f"{kind}{parts[0]}"
    if len(parts) == 1:
        made.setdefault(f"minus_{kind}{parts[0]}", f"-{kind}{parts[0]}")
        return f"minus_{kind}{parts[0]}"
    text = " + ".join(f"{dialect.number(float(vector[j]))}{dialect.times}{kind}{j}" for j in parts)
    name = next((name for name, known in made.items() if known == text), f"along_{len(made)}")
    made.setdefault(name, text)
    return name


def _directions(model: ExportModel, row: int) -> Array:
    """Return the axes I (tilted in the tilted form), P, O and nominal I, (4, 3), in target axes."""
    sensor = model.sensor
    axis = sensor.axes[row]
    frame = axis.frame
    along = frame[0]
    if sensor.form == "tilted" and axis.measures != "m":
        values = dict(zip(sensor.coefficients, model.calibration.values.tolist(), strict=True))
        tangents = [np.tan(values.get(f"{axis.name}.delta_{k}", 0.0)) for k in "op"]
        along = np.array([1.0, tangents[0], -tangents[1]]) @ frame
        along = along / np.linalg.norm(along)
    return np.array([along, frame[1], frame[2], frame[0]]) @ model.turn.T


def _held(model: ExportModel) -> Sensor:
    """Return the sensor with only the terms that code supports."""
    sensor = model.sensor
    named = zip(sensor.coefficients, kinds_of(sensor), strict=True)
    kept = tuple(name for name, (_, kind, _) in named if kind not in DERIVATIVES)
    return replace(sensor, coefficients=kept)


def _nonlinear_names(model: ExportModel) -> Sequence[str]:
    kinds = kinds_of(model.sensor)
    values = model.calibration.values
    return [
        name
        for name, value, (_, kind, _) in zip(model.sensor.coefficients, values, kinds, strict=True)
        if kind not in LINEAR and kind not in DERIVATIVES and value != 0
    ]
