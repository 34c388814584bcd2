"""Describe a sensor by named axes, the coefficients of their errors, and the exact model.

`coefficient_tables` defines the terms and `axis_model` the response of an axis; a sensor combines
its axes. All functions broadcast over leading dimensions for trials: motion `(..., n, 3)`,
coefficients `(..., p)`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Literal, NamedTuple

import numpy as np

from inercal.basics.arrays import Array, row_products
from inercal.basics.errors import InputError
from inercal.basics.keys import CoefficientName
from inercal.physics.motion import Motion
from inercal.physics.quantities import KINDS, QUANTITIES, Measures
from inercal.physics.sensors.axis import Axis, SensedMotion, motion_width, sensed_motion
from inercal.physics.sensors.axis_model import MOTION_COMPONENTS, AxisResponse, Form, SimilarAxes
from inercal.physics.sensors.coefficient_selection import select_coefficients
from inercal.physics.sensors.coefficient_tables import TABLES, TERMS, ErrorTerm


class Linearisation(NamedTuple):
    """Readings and their derivatives; see `Sensor.linearise`."""

    reading: Array  # (..., n, m)
    design: Array  # (..., n, m, p)
    slope: Array  # (..., n or 1, m, width)


@lru_cache  # because the sensors of a line have the same axes
def _rank(axes: tuple[Axis, ...], measures: Measures) -> int:
    return int(np.linalg.matrix_rank(Sensor("", axes).input_axes(measures)))


@lru_cache
def _chosen_terms(axes: tuple[Axis, ...], coefficients: tuple[str, ...]) -> dict[str, ErrorTerm]:
    """Return the table entries of coefficients by full name; refuse unknown names."""
    tables = {axis.name: TERMS[axis.measures] for axis in axes}
    chosen: dict[str, ErrorTerm] = {}
    for full in coefficients:
        axis, short = CoefficientName(full).parts
        known = tables.get(axis, {})
        if short not in known:
            raise InputError(
                f"no coefficient {full!r}; the axes are {', '.join(tables)}"
                + (f", and {axis} has {', '.join(known)}" if known else ""),
                names=(full,),
            )
        chosen[full] = known[short]
    return chosen


@dataclass(frozen=True)
class Sensor:
    """Named axes and the selected coefficients; `coefficients` defines the order of all vectors.

    Parameters
    ----------
    name : str
        The laboratory's name for the sensor.
    axes : tuple of Axis
        Accelerometers, gyros and magnetometers, in the order of the channels in the recording.
    coefficients : tuple of str
        Full names, "ax.k0"; see `with_coefficients`.
    form : "reference" or "tilted"
        The form of the model, which decides along which axis nonlinear terms act (see
        `inercal.physics.sensors.axis_model`).
    reference_temperature : float
        Temperature at which the model's ΔT is zero, K.
    frame : "mount" or "symmetric"
        Frame of the misalignments: the mounting frame, or the frame in which their matrix is
        symmetric, for observations that do not determine a rotation.

    Raises
    ------
    InputError
        Two axes have the same name, or a coefficient is unknown.
    """

    name: str
    axes: tuple[Axis, ...]
    coefficients: tuple[str, ...] = ()
    form: Form = "reference"
    reference_temperature: float = 293.15
    frame: Literal["mount", "symmetric"] = "mount"
    _terms: Mapping[str, ErrorTerm] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        names = [axis.name for axis in self.axes]
        if len(set(names)) != len(names):
            raise InputError(
                f"sensor {self.name}: two of the axes {', '.join(names)} have the same name; give "
                "each axis its own name",
                names=tuple(names),
            )
        object.__setattr__(self, "_terms", _chosen_terms(self.axes, self.coefficients))

    def with_coefficients(self, *chosen: str) -> "Sensor":
        """Return a copy of the sensor with coefficients selected by name, group or axis.

        `"bias"`, `"scale"`, `"misalignment"`, `"nonorthogonality"`, … select a group for all axes.
        `"k2"` selects a coefficient for all axes that have it, and `"x.k2"` or `"x.bias"` selects
        for a single axis.
        """
        return replace(self, coefficients=select_coefficients(self.axes, chosen))

    def select_axes(self, *measures: Measures) -> "Sensor":
        """Return a sensor with only the axes of the given kinds, and their coefficients."""
        if measures not in self._parts:
            axes = tuple(a for a in self.axes if a.measures in measures)
            kept = {a.name for a in axes}
            names = tuple(c for c in self.coefficients if CoefficientName(c).axis in kept)
            self._parts[measures] = replace(self, axes=axes, coefficients=names)
        return self._parts[measures]

    @cached_property
    def _parts(self) -> "dict[tuple[Measures, ...], Sensor]":
        return {}

    def beside(self, other: "Sensor") -> "Sensor":
        """Return a sensor that also has the axes and coefficients of `other`, after its own."""
        return replace(
            self, axes=self.axes + other.axes, coefficients=self.coefficients + other.coefficients
        )

    def input_axes(self, measures: Measures) -> Array:
        """Return the directions of the axes of a kind in the sensor's frame, (m, 3)."""
        return np.array([a.i for a in self.axes if a.measures == measures]).reshape(-1, 3)

    def rank(self, measures: Measures) -> int:
        """Return the number of independent directions along which a quantity is measured."""
        return _rank(self.axes, measures)

    @cached_property
    def width(self) -> int:
        """The number of components of the motion: 6 for (f, ω), 9 for (f, ω, m)."""
        return motion_width(self.axes)

    @cached_property
    def sensed(self) -> SensedMotion:
        """The components of the motion that the axes measure."""
        return sensed_motion(self.axes)

    @property
    def negative_scales(self) -> str:
        """The sections with a negative scale, as a further suspect at the end of a message."""
        kinds = dict.fromkeys(axis.measures for axis in self.axes if axis.readout.scale < 0)
        return "".join(f", or the negative scale in [sensor.{QUANTITIES[k].sensor}]" for k in kinds)

    def rounded(self, rate_hz: float) -> "Sensor":
        """Return a copy of the sensor whose white noise includes the rounding of the samples."""
        axes = (replace(axis, noise=axis.noise.rounded(rate_hz)) for axis in self.axes)
        return replace(self, axes=tuple(axes))

    @cached_property
    def measures(self) -> dict[str, Measures]:
        """The quantity that each axis measures, by the name of the axis."""
        return {axis.name: axis.measures for axis in self.axes}

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the axes, which are the channel names."""
        return tuple(axis.name for axis in self.axes)

    def coefficient(self, full: str) -> ErrorTerm:
        """Return the table entry of a full name such as "x.k0"."""
        return self._terms[full]

    @cached_property
    def unit_scale(self) -> Array:
        """Size of each coefficient that causes 1 g or 1 rad/s at 1 g and 1 rad/s, (p,) SI.

        For temperature coefficients, the effect is the one at 100 K from the reference temperature
        and at 10 K/min.
        """
        return np.array([self.coefficient(name).unit_scale for name in self.coefficients])

    @cached_property
    def affine(self) -> bool:
        """Whether the readings are affine in f, ω and m and depend on nothing else."""
        table = [term.basis for term in self._terms.values()]
        linear = all(basis.degree(*MOTION_COMPONENTS) <= 1 for basis in table)
        others = self.uses("si", "swi", "dT", "dTdt", "ai", "ap", "ao")
        return linear and not others and (self.form == "reference" or self.coefficients == ())

    def uses(self, *components: str) -> bool:
        """Return whether any of the coefficients depends on one of the given motion components."""
        return any(term.basis.uses(*components) for term in self._terms.values())

    def to_si(self, output: Array) -> Array:
        """Convert output units to nominal readings in SI, (..., n, m)."""
        reading = output - self._readout[0]
        reading /= self._readout[1]  # in place, because recordings are long
        return reading

    def to_output(self, reading: Array) -> Array:
        """Convert readings in SI, (..., n, m), to output units."""
        return self._readout[0] + self._readout[1] * reading

    @cached_property
    def _readout(self) -> Array:
        """The offsets and the scales of the axes' readouts, (2, m)."""
        return np.array([(a.readout.offset, a.readout.scale) for a in self.axes]).reshape(-1, 2).T

    @cached_property
    def _groups(self) -> tuple[SimilarAxes, ...]:
        """The axes, grouped by kind and by set of terms."""
        by_axis: dict[str, list[ErrorTerm]] = {axis.name: [] for axis in self.axes}
        for full, term in self._terms.items():
            by_axis[CoefficientName(full).axis].append(term)
        alike: dict[tuple[Measures, tuple[ErrorTerm, ...]], list[int]] = {}
        for k, axis in enumerate(self.axes):
            terms = sorted(by_axis[axis.name], key=TABLES[axis.measures].index)
            alike.setdefault((axis.measures, tuple(terms)), []).append(k)
        groups: list[SimilarAxes] = []
        for (measures, terms), members in alike.items():
            axes = [self.axes[k] for k in members]
            columns = {
                one.name: np.array([self.coefficients.index(f"{a.name}.{one.name}") for a in axes])
                for one in terms
            }
            frames = np.stack([axis.frame for axis in axes])
            groups.append(SimilarAxes(measures, np.array(members), frames, terms, columns))
        return tuple(groups)

    def forward(self, motion: Motion, c: Array) -> Array:
        """Return noise-free readings in SI, (..., n, m), for coefficients `c`, (..., p) in SI."""
        return self._reading([group.response(motion, c, self.form, ()) for group in self._groups])

    def _reading(self, responses: Sequence[AxisResponse]) -> Array:
        if len(responses) == 1:
            return responses[0].reading
        lead = np.broadcast_shapes(*(r.reading.shape[:-1] for r in responses))
        reading = np.empty((*lead, len(self.axes)))
        for group, response in zip(self._groups, responses, strict=True):
            reading[..., group.members] = response.reading
        return reading

    def reading_and_slope(self, motion: Motion, c: Array) -> tuple[Array, Array]:
        """Return the readings, (..., n, m), and their `slope`, in one pass.

        The method is faster than `linearise` if the design is not needed.
        """
        if self.affine:
            one = self._linearise_affine(motion, c)
            return one.reading, one.slope
        responses = [
            group.response(motion, c, self.form, MOTION_COMPONENTS) for group in self._groups
        ]
        reading = self._reading(responses)
        return reading, self._slope(responses, reading.shape)

    def _slope(self, responses: Sequence[AxisResponse], shape: tuple[int, ...]) -> Array:
        slope = np.zeros((*shape, self.width))
        for group, response in zip(self._groups, responses, strict=True):
            group.add_slope(response, slope)
        return slope

    def design(self, motion: Motion, c: Array) -> Array:
        """Return the exact derivatives d(reading)/d(coefficient) at `c`, (..., n, m, p)."""
        return self.linearise(motion, c).design

    def slope(self, motion: Motion, c: Array) -> Array:
        """Return d(reading)/d(f, ω, m) at the motion, (..., n, m, width), in the sensor's frame.

        The sample dimension has length 1 if the slope is the same for all samples.
        """
        return self.reading_and_slope(motion, c)[1]

    def linearise(self, motion: Motion, c: Array) -> Linearisation:
        """Return the readings, (..., n, m), with `design` and `slope`, in one pass."""
        if self.affine:
            return self._linearise_affine(motion, c)
        responses = [
            group.response(motion, c, self.form, MOTION_COMPONENTS, design=True)
            for group in self._groups
        ]
        reading = self._reading(responses)
        design = np.zeros((*reading.shape, len(self.coefficients)))
        for group, response in zip(self._groups, responses, strict=True):
            for short, column in response.coefficient_derivatives.items():
                design[..., group.members, group.columns[short]] = column
        return Linearisation(reading, design, self._slope(responses, reading.shape))

    def _linearise_affine(self, motion: Motion, c: Array) -> Linearisation:
        """Linearise an affine sensor with two matrix products: y = (A₀ + Σ c B) (f, ω, m, 1)."""
        nominal, change = self._affine_maps
        width = self.width
        parts = (motion.f, motion.w, motion.m)[: width // 3]
        shape = np.broadcast_shapes(*(part.shape for part in parts))
        sensed = np.ones((*shape[:-1], width + 1))
        for k, part in enumerate(parts):
            sensed[..., 3 * k : 3 * k + 3] = part
        m, p = len(self.axes), len(self.coefficients)
        maps = nominal + row_products(c, change.reshape(p, m * (width + 1))).reshape(
            *c.shape[:-1], m, width + 1
        )
        reading = sensed @ np.swapaxes(maps, -1, -2)
        design = sensed @ np.moveaxis(change, -1, 0).swapaxes(-1, -2).reshape(width + 1, m * p)
        return Linearisation(
            reading, design.reshape(*design.shape[:-1], m, p), maps[..., None, :, :width]
        )

    @cached_property
    def _affine_maps(self) -> tuple[Array, Array]:
        """The matrices A₀, (m, width + 1), and B, (p, m, width + 1), of an affine sensor."""
        p, width = len(self.coefficients), self.width
        sensed = np.eye(width + 1, len("xyz") * len(KINDS))
        motion = Motion(sensed[:, :3], sensed[:, 3:6], m=sensed[:, 6:])
        reading = self.forward(motion, np.concatenate([np.eye(p), np.zeros((1, p))]))
        at = np.array(np.broadcast_to(reading, (p + 1, width + 1, len(self.axes))))
        at[:, :width] -= at[:, width:]
        maps = np.swapaxes(at, -1, -2)
        return maps[p], maps[:p] - maps[p]
