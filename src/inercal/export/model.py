"""Express a calibration as matrices and biases for triads, in the axes of an export target.

    y = M f + b + Σ b_k ΔT^k              accelerometers, m/s²
    y = G ω + A f + b + Σ b_k ΔT^k        gyros, rad/s
    y = D m + b + Σ b_k ΔT^k              magnetometers, T

y is a reading in SI, converted with the nominal readout: y = (output − offset)/scale. If a signed
permutation S converts the body's axes to the target's axes, vectors and channels are rotated
together: M′ = S M Sᵀ and b′ = S b; G, A and D transform like M.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.keys import CoefficientName
from inercal.calibration import Calibration
from inercal.export.term_kinds import LINEAR, TermKind, kinds_of
from inercal.physics.motion import Motion
from inercal.physics.quantities import KINDS, QUANTITIES, Measures
from inercal.physics.sensors import Axis, Readout, Sensor, axes_along
from inercal.physics.sensors.axis import case_letters

UNMEASURED = "unmeasured "
"""Start of the names of axes that complete a triad, such as "unmeasured fx"."""


@dataclass(frozen=True, eq=False)
class Triad:
    """Three sensor axes of one kind, expressed in the target's axes.

    Parameters
    ----------
    rows : tuple of 3 int
        Index of the sensor axis for each channel of the target.
    signs : (3,) array
        Sign of each channel relative to the axis in `rows`.
    matrix : (3, 3) array
        Matrix from the motion to readings.
    bias : (3,) array
        Bias at the reference temperature, m/s², rad/s or T.
    bias_powers : (k, 3) array
        Coefficients of ΔT, ΔT², …, SI.
    scale, offset : (3,) arrays
        Nominal readout, in output units.
    unit : str
        Output unit.
    stated : frozenset of TermKind
        The kinds of terms that the calibration states for these axes.
    """

    rows: tuple[int, ...]
    signs: Array
    matrix: Array
    bias: Array
    bias_powers: Array
    scale: Array
    offset: Array
    unit: str
    stated: frozenset[TermKind]

    @cached_property
    def correction(self) -> Array:
        """The inverse of the matrix, (3, 3)."""
        return np.asarray(np.linalg.inv(self.matrix), dtype=float)

    def bias_at(self, dT: Array) -> Array:
        """Return the bias, (n, 3), at the differences dT from the reference temperature, (n,)."""
        total = np.broadcast_to(self.bias, (dT.size, 3)).copy()
        for power, coefficients in enumerate(self.bias_powers, start=1):
            total += dT[:, None] ** power * coefficients
        return total


@dataclass(frozen=True, eq=False)
class ExportModel:
    """A calibration in the axes of a target; see the module docstring.

    Parameters
    ----------
    calibration : Calibration
    turn : (3, 3) array
        S, the rotation from body axes to the target's axes.
    triads : tuple of (Measures, Triad)
        The available triads: accelerometers, gyros, magnetometers.
    g_sensitivity : (3, 3) array
        A, (rad/s)/(m/s²).
    inputs : list of int
        The channels that the sensor measures, in the order of the calibration, or in the order of
        the target's axes if these are rotated.
    """

    calibration: Calibration
    turn: Array
    triads: tuple[tuple[Measures, Triad], ...]
    g_sensitivity: Array
    inputs: list[int]

    @property
    def sensor(self) -> Sensor:
        """The sensor of the calibration."""
        return self.calibration.sensor

    def triad(self, kind: Measures) -> Triad | None:
        """Return the triad of one kind of axes, if the sensor has it."""
        return dict(self.triads).get(kind)

    @cached_property
    def matrix(self) -> Array:
        """The matrix [M 0 0; A G 0; 0 0 D], (n, n), with only the triads that exist."""
        matrix = np.zeros((3 * len(self.triads), 3 * len(self.triads)))
        for k, (_, triad) in enumerate(self.triads):
            matrix[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = triad.matrix
        if {"f", "w"} <= dict(self.triads).keys():
            matrix[3:6, :3] = self.g_sensitivity
        return matrix

    @cached_property
    def correction(self) -> Array:
        """The inverse of `matrix`, (n, n), whose lower left block is −G⁻¹ A M⁻¹."""
        return np.asarray(np.linalg.inv(self.matrix), dtype=float)

    @cached_property
    def gain(self) -> Array:
        """The correction per output unit for the m channels in `inputs`, (n, m)."""
        return (self.correction / self.joined("scale"))[:, self.inputs]

    @cached_property
    def zero(self) -> Array:
        """The output of the channels in `inputs` without motion, (m,)."""
        return self.outputs(self.joined("bias"))[self.inputs]

    def joined(self, what: Literal["bias", "scale", "offset", "signs"]) -> Array:
        """Return a quantity for all channels, (n,)."""
        return np.concatenate([getattr(triad, what) for _, triad in self.triads])

    @cached_property
    def channels(self) -> list[str]:
        """The name of the sensor axis of each channel."""
        return [self.sensor.channels[row] for _, triad in self.triads for row in triad.rows]

    def readings(self, output: Array) -> Array:
        """Convert the sensor's output to readings of the target's channels in SI, (n, k)."""
        y = self.sensor.to_si(output)
        return np.concatenate([y[:, list(t.rows)] * t.signs for _, t in self.triads], axis=-1)

    def outputs(self, readings: Array) -> Array:
        """Convert readings in SI to the output of the target's channels, (n, k)."""
        return self.joined("offset") + self.joined("scale") * readings

    def motion(self, motion: Motion) -> Array:
        """Return f, ω and m in the target's axes, (n, k), but only what the sensor measures."""
        parts = [getattr(motion, kind) @ self.turn.T for kind, _ in self.triads]
        return np.concatenate(parts, axis=-1)

    def require(self, kind: Measures, target: str) -> Triad:
        """Return a triad that the target needs.

        Raises
        ------
        InputError
            The sensor has no such triad.
        """
        if (found := self.triad(kind)) is None:
            raise InputError(
                f"{target} is for {QUANTITIES[kind].sensors}, but sensor {self.sensor.name} has "
                "none; choose another target",
                names=self.sensor.channels,
            )
        return found


def export_model(
    calibration: Calibration, axes: str = "x y z", refit: tuple[Motion, Array] | None = None
) -> ExportModel:
    """Convert a calibration to the matrices and axes of a target.

    Parameters
    ----------
    calibration : Calibration
    axes : str
        The target's x, y and z in terms of the body's axes: "x -y -z" converts front-left-up to
        front-right-down.
    refit : (Motion, (n, m) array), optional
        Motions and the readings of the axes of `completed_triads`, SI; the linear terms are fitted
        to them by least squares.

    Raises
    ------
    InputError
        `axes` is not right-handed, or the axes of a kind do not point along different case axes.
    """
    own = calibration.sensor.channels
    calibration = completed_triads(calibration)
    if calibration.sensor.form == "tilted" and set(_kinds(calibration.sensor)) <= LINEAR:
        calibration = calibration.in_form("reference")
    sensor = calibration.sensor
    turn = parse_axes(axes)
    slope, bias = _linear_part(calibration) if refit is None else _fitted(calibration, *refit)
    powers = _bias_powers(calibration)
    triads: dict[Measures, Triad] = {}
    sensitivity = np.zeros((3, 3))
    for start, kind in zip((0, 3, 6), KINDS, strict=True):
        rows = [k for k, axis in enumerate(sensor.axes) if axis.measures == kind]
        if not rows:
            continue
        picked, readouts = _turned_rows(sensor, kind, rows, turn)
        signs = turn.sum(axis=1)
        triads[kind] = Triad(
            picked,
            signs,
            turn @ slope[rows, start : start + 3] @ turn.T,
            turn @ bias[rows],
            powers[:, rows] @ turn.T,
            np.array([one.scale for one in readouts]),
            np.array([one.offset for one in readouts]) * signs,
            readouts[0].unit,
            frozenset(term for measures, term, _ in kinds_of(sensor) if measures == kind),
        )
        if kind == "w" and "f" in triads:
            sensitivity = turn @ slope[rows, :3] @ turn.T
    if not triads:
        raise InputError(f"sensor {sensor.name} has no axes", names=sensor.channels)
    model = ExportModel(calibration, turn, tuple(triads.items()), sensitivity, [])
    inputs = [k for k, name in enumerate(model.channels) if name in own]
    is_turned = not np.array_equal(turn, np.eye(3))
    inputs.sort(key=lambda k: k if is_turned else own.index(model.channels[k]))
    return replace(model, inputs=inputs)


def completed_triads(calibration: Calibration) -> Calibration:
    """Return a calibration in which axes without errors complete triads of one or two axes.

    Raises
    ------
    InputError
        The axes of a kind do not point along different case axes.
    """
    sensor = calibration.sensor
    axes: list[Axis] = []
    for kind in KINDS:
        own = sensor.select_axes(kind).axes
        if not own or len(own) == len("xyz") == sensor.rank(kind):
            axes += own
            continue
        letters = case_letters(np.abs(sensor.input_axes(kind)))
        if not letters:
            raise InputError(
                f"an export needs {QUANTITIES[kind].sensors} along different case axes, x, y or z, "
                f"but {', '.join(axis.name for axis in own)} have other directions; correct "
                "recordings with inercal apply instead",
                names=tuple(axis.name for axis in own),
            )
        ideal = axes_along("xyz", kind, UNMEASURED + kind, own[0].readout, own[0].noise)
        along = dict(zip(letters, own, strict=True))
        axes += [along.get(letter, one) for letter, one in zip("xyz", ideal, strict=True)]
    if len(axes) == len(sensor.axes):
        return calibration
    return replace(calibration, sensor=replace(sensor, axes=tuple(axes)))


def _turned_rows(
    sensor: Sensor, kind: str, rows: Sequence[int], turn: Array
) -> tuple[tuple[int, ...], tuple[Readout, ...]]:
    """Return the sensor axis and the readout for each channel of the target."""
    picked = tuple(rows[int(k)] for k in np.abs(turn).argmax(axis=1))
    readouts = tuple(sensor.axes[k].readout for k in picked)
    if len({one.unit for one in readouts}) > 1:
        raise InputError(
            f"the {QUANTITIES[kind].sensors} of {sensor.name} have readings in "
            f"{', '.join(one.unit for one in readouts)}; an export needs the same unit for all",
            names=sensor.channels,
        )
    return picked, readouts


def parse_axes(text: str) -> Array:
    """Return the signed permutation S, (3, 3), for axes such as "x -y -z".

    Raises
    ------
    InputError
        The text does not name three different axes, or the axes are left-handed.
    """
    words = text.replace(",", " ").split()
    plain = [word.lstrip("+-") for word in words]
    turn = np.zeros((3, 3))
    if sorted(plain) == ["x", "y", "z"]:
        for row, (word, name) in enumerate(zip(words, plain, strict=True)):
            turn[row, "xyz".index(name)] = -1.0 if word.startswith("-") else 1.0
    if np.linalg.det(turn) < 0.5:
        raise InputError(
            f"axes {text!r} are not possible; give x, y and z once each, right-handed, such as "
            "'x -y -z'",
            key="axes",
        )
    return turn


def _kinds(sensor: Sensor) -> Sequence[str]:
    return [kind for _, kind, _ in kinds_of(sensor)]


def _linear_part(calibration: Calibration) -> tuple[Array, Array]:
    """Return slope (m, width) and bias (m,) of the linear terms, at the reference temperature."""
    sensor = calibration.sensor
    kept = [kind in LINEAR for kind in _kinds(sensor)]
    c = np.where(kept, calibration.values, 0.0)
    # A linear model has no sign or temperature terms, so differences between the outputs of unit
    # motions are exact.
    sensor = replace(sensor, coefficients=tuple(np.array(sensor.coefficients)[kept].tolist()))
    sensed = np.eye(sensor.width + 1, 3 * len(KINDS), -1)
    y = sensor.forward(Motion(sensed[:, :3], sensed[:, 3:6], m=sensed[:, 6:]), c[kept])
    return (y[1:] - y[0]).T, y[0]


def _fitted(calibration: Calibration, motion: Motion, readings: Array) -> tuple[Array, Array]:
    """Return slope (m, width) and bias (m,) from a least-squares fit that is linear in f, ω, m.

    Components that do not vary, such as those that no axis measures, keep their linear terms.
    """
    n, width = readings.shape[0], calibration.sensor.width
    parts = (motion.f, motion.w, motion.m)[: width // 3]
    sensed = [np.broadcast_to(v, (n, 3)) for v in parts]
    columns = np.concatenate([*sensed, np.ones((n, 1))], axis=1)
    used = [*np.flatnonzero(np.ptp(columns, axis=0) > 0).tolist(), width]
    slope, bias = _linear_part(calibration)
    solution = np.vstack([slope.T, bias])
    known = _bias_powers(calibration)
    dT = np.broadcast_to(motion.dT, (n,))
    rest = readings - sum((dT[:, None] ** k * line for k, line in enumerate(known, 1)), np.zeros(1))
    solution[used] = np.linalg.lstsq(columns[:, used], rest, rcond=None)[0]
    return solution[:width].T, solution[width]


def _bias_powers(calibration: Calibration) -> Array:
    """Return the bias coefficients of ΔT, ΔT², … for each axis, (k, m)."""
    sensor = calibration.sensor
    kinds = kinds_of(sensor)
    highest = max((order for _, kind, order in kinds if kind == "bias_temperature"), default=0)
    powers = np.zeros((highest, len(sensor.axes)))
    for full, value, (_, kind, order) in zip(
        sensor.coefficients, calibration.values, kinds, strict=True
    ):
        if kind == "bias_temperature":
            row = sensor.channels.index(CoefficientName(full).axis)
            factor = sum(p.factor for p in sensor.coefficient(full).basis.products)
            powers[order - 1, row] += factor * value
    return powers
