"""Compute the reading of one axis and its exact derivatives, in either form of the model.

In the reference form (IEEE Std 1293) every term acts along the nominal axes, so the reading is
linear in the coefficients::

    y = f_I + Σ c φ(seen)

In the tilted form the misalignments rotate the input axis itself and the nonlinear terms act along
the rotated unit axis h (with the specific force at the end of the lever arm)::

    a = h·(f + dω/dt × r + ω × (ω × r)),   h = (1, tan δ_O, −tan δ_P) / norm   along (I, P, O)
    y = a + Σ c φ(seen, with f_I replaced by a)

Magnetometers always have the reference form, because soft iron is not a rotation.

Axes of one kind with the same terms form a group, whose readings are computed together. The last
dimension of its arrays runs over the sensor axes: `(..., n, k)` for k axes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.physics.frames import skew, stack_components, transform
from inercal.physics.motion import Motion
from inercal.physics.quantities import KINDS, Measures
from inercal.physics.sensors.coefficient_tables import ErrorTerm

Form = Literal["reference", "tilted"]
MOTION_COMPONENTS = tuple(kind + axis for kind in KINDS for axis in "ipo")
ARMS = ("arm_i", "arm_p", "arm_o")
ALONG = {kind: kind + "i" for kind in KINDS}  # the reading of an axis without errors


class AxisResponse(NamedTuple):
    """Readings and derivatives of k axes, all (..., n, k); zero derivatives are omitted."""

    reading: Array
    coefficient_derivatives: dict[str, Array]
    motion_derivatives: dict[str, Array]  # by component: fi … mo


def axis_response(
    measures: Measures,
    lines: Sequence[ErrorTerm],
    values: Mapping[str, Array],
    seen: Mapping[str, Array],
    form: Form,
    by: Sequence[str],
    *,
    design: bool,
) -> AxisResponse:
    """Return the readings of k axes of one kind and, if requested, their derivatives.

    Parameters
    ----------
    measures : "f", "w" or "m"
    lines : sequence of ErrorTerm
        The terms of the model.
    values : mapping of str to (..., 1, k) array
        Coefficients of the terms, SI, by short name.
    seen : mapping of str to (..., n, k) array
        Components of the motion along I, P and O of each axis, by name; components without effect
        may be missing.
    form : "reference" or "tilted"
    by : sequence of str
        Components with respect to which the reading is differentiated.
    design : bool
        Whether derivatives with respect to the coefficients are also computed.
    """
    along = ALONG[measures]
    tilted = form == "tilted" and measures != "m"
    geometry = _tilted_axis_response(values, seen, along) if tilted else None
    if geometry is not None:
        seen = {**seen, along: geometry.reading}
        if measures == "f" and "si" in seen:
            seen["si"] = np.sign(geometry.reading)
    terms = [
        line
        for line in lines
        if geometry is None or line.name not in geometry.coefficient_derivatives
    ]
    shape = np.broadcast_shapes(seen[along].shape, *(v.shape for v in values.values()))
    reading = np.broadcast_to(seen[along], shape).copy()
    bases = [line.basis.value(seen) for line in terms]
    for line, basis in zip(terms, bases, strict=True):
        reading += values[line.name] * basis
    coefficient_derivatives: dict[str, Array] = {}
    if design:
        coefficient_derivatives = {
            line.name: np.asarray(basis, dtype=float)
            for line, basis in zip(terms, bases, strict=True)
        }
    motion_derivatives: dict[str, Array] = {}
    wanted = dict.fromkeys((*by, *((along,) if design and geometry is not None else ())))
    for name in wanted:
        parts = [
            values[line.name] * product.value(seen)
            for line in terms
            for product in line.basis.derivative(name)
        ]
        if parts or name == along:
            total = np.full(shape, float(name == along))
            for part in parts:
                total += part
            motion_derivatives[name] = total
    if geometry is None or not motion_derivatives:
        return AxisResponse(reading, coefficient_derivatives, motion_derivatives)
    # Apply the chain rule to the rotated axis: the terms in `along` depend on a(δ, r, f, ω).
    outer = motion_derivatives.pop(along)
    for name, inner in geometry.motion_derivatives.items():
        if name in by:
            rest = motion_derivatives.get(name)
            motion_derivatives[name] = outer * inner if rest is None else rest + outer * inner
    if design:
        for name, inner in geometry.coefficient_derivatives.items():
            coefficient_derivatives[name] = outer * inner
    return AxisResponse(reading, coefficient_derivatives, motion_derivatives)


def _tilted_axis_response(
    values: Mapping[str, Array], seen: Mapping[str, Array], along: str
) -> AxisResponse:
    """Return the force or rate a along the rotated, displaced axis, with its derivatives."""
    tan_o = np.tan(values.get("delta_o", np.zeros(1)))
    tan_p = np.tan(values.get("delta_p", np.zeros(1)))
    norm = np.sqrt(1 + tan_o**2 + tan_p**2)
    h = (1 / norm, tan_o / norm, -tan_p / norm)
    kind = along[0]
    sensed = [seen[kind + axis] for axis in "ipo"]
    modelled = [name for name in ARMS if name in values]
    arm = [values.get(name, np.zeros(1)) for name in ARMS] if modelled else []
    coefficient_derivatives: dict[str, Array] = {}
    motion_derivatives = {kind + axis: h[k] for k, axis in enumerate("ipo")}
    if arm:
        w, dw = (stack_components(*(seen[s + a] for a in "ipo")) for s in "wa")
        cross = skew(dw) + skew(w) @ skew(w)
        r = stack_components(*arm)
        h_row = stack_components(*h)
        sensed = [
            f + part
            for f, part in zip(sensed, np.moveaxis(transform(cross, r), -1, 0), strict=True)
        ]
        along_r = transform(np.swapaxes(cross, -1, -2), h_row)
        coefficient_derivatives = {
            name: along_r[..., k] for k, name in enumerate(ARMS) if name in modelled
        }
        # h·(ω × (ω × r)) = (h·ω)(ω·r) − (h·r) ω², so d/dω = h (ω·r) + (h·ω) r − 2 (h·r) ω
        dot = {"wr": (w * r).sum(-1), "hw": (h_row * w).sum(-1), "hr": (h_row * r).sum(-1)}
        to_w = (
            h_row * dot["wr"][..., None] + dot["hw"][..., None] * r - 2 * dot["hr"][..., None] * w
        )
        motion_derivatives |= {"w" + axis: to_w[..., k] for k, axis in enumerate("ipo")}
    a = sum(component * x for component, x in zip(h, sensed, strict=True)) + np.zeros(1)
    if "delta_o" in values:
        coefficient_derivatives["delta_o"] = (1 + tan_o**2) / norm * (sensed[1] - a * tan_o / norm)
    if "delta_p" in values:
        coefficient_derivatives["delta_p"] = (1 + tan_p**2) / norm * (-sensed[2] - a * tan_p / norm)
    return AxisResponse(a, coefficient_derivatives, motion_derivatives)


_VECTORS = ("f", "w", "a", "m")


@dataclass(frozen=True, eq=False)
class SimilarAxes:
    """A group of k axes of one kind with the same terms.

    Parameters
    ----------
    measures : "f", "w" or "m"
    members : (k,) array of int
        Their indices among the axes of the sensor.
    frames : (k, 3, 3) array
        Directions I, P and O of each axis, as rows, in the sensor's frame.
    terms : tuple of ErrorTerm
    columns : mapping of str to (k,) array of int
        Indices of each term's coefficients among those of the sensor, by short name.
    """

    measures: Measures
    members: NDArray[np.intp]
    frames: Array
    terms: tuple[ErrorTerm, ...]
    columns: Mapping[str, NDArray[np.intp]]

    def response(
        self, motion: Motion, c: Array, form: Form, by: Sequence[str], *, design: bool = False
    ) -> AxisResponse:
        """Return the readings, (..., n, k), and the requested derivatives.

        Parameters
        ----------
        motion : Motion
            Motion with vectors (..., n, 3).
        c : (..., p) array
            Coefficients of the sensor, SI.
        form : "reference" or "tilted"
        by : sequence of str
            Components of the motion with respect to which the reading is differentiated.
        design : bool
            Whether derivatives with respect to the coefficients are also computed.
        """
        values = {name: c[..., None, at] for name, at in self.columns.items()}
        seen = self._motion_components(motion, form)
        return axis_response(self.measures, self.terms, values, seen, form, by, design=design)

    def _motion_components(self, motion: Motion, form: Form) -> dict[str, Array]:
        """Return the components of a motion that act on the axes, by name, (..., n, k)."""
        lead = np.broadcast_shapes(
            *(v.shape[:-1] for v in (motion.f, motion.w, motion.dw, motion.m)),
            np.shape(motion.dT),
            np.shape(motion.dTdt),
        )
        seen: dict[str, Array] = {}
        rotated = self.frames.reshape(-1, 3).T
        vectors_of = (motion.f, motion.w, motion.dw, motion.m)
        for letter, vectors in zip(_VECTORS, vectors_of, strict=True):
            if letter == self.measures or self._uses(letter, form):
                along = (vectors @ rotated).reshape(*vectors.shape[:-1], -1, 3)
                seen |= {letter + axis: along[..., k] for k, axis in enumerate("ipo")}
        along = ALONG[self.measures]
        # The reading has the shape of the whole motion, even if only part of the motion acts.
        if seen[along].shape[:-1] != lead:
            seen[along] = np.broadcast_to(seen[along], (*lead, len(self.members)))
        for sign, component in (("si", "fi"), ("swi", "wi")):
            if any(term.basis.uses(sign) for term in self.terms):
                seen[sign] = np.sign(seen[component])
        seen["dT"] = np.asarray(motion.dT, dtype=float)[..., None]
        seen["dTdt"] = np.asarray(motion.dTdt, dtype=float)[..., None]
        return seen

    def _uses(self, letter: str, form: Form) -> bool:
        names = [letter + axis for axis in "ipo"]
        names += {"f": ["si"], "w": ["swi"]}.get(letter, [])
        arms = form == "tilted" and any(term.name in ARMS for term in self.terms)
        return arms or any(term.basis.uses(*names) for term in self.terms)

    def add_slope(self, response: AxisResponse, slope: Array) -> None:
        """Write the slopes by f, ω and m into the array of all axes, (..., n, axes, width)."""
        for first, letter in enumerate(KINDS):
            # The directions I, P and O of each sensor axis, weighted by the derivatives.
            total = None
            for place, axis in enumerate("ipo"):
                column = response.motion_derivatives.get(letter + axis)
                if column is not None:
                    part = column[..., None] * self.frames[:, place]
                    total = part if total is None else total + part
            if total is not None:
                slope[..., self.members, 3 * first : 3 * first + 3] = total
