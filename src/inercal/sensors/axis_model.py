"""The reading of one axis and its exact derivatives, in either form of the model.

In the reference form (IEEE Std 1293) every term acts along the nominal axes, so the reading is
linear in the coefficients::

    y = f_I + Σ c φ(seen)

In the tilted form the misalignments rotate the input axis itself and the nonlinear terms act along
the rotated unit axis h (with the specific force at the end of the lever arm)::

    a = h·(f + dω/dt × r + ω × (ω × r)),   h = (1, tan δ_O, −tan δ_P) / norm   along (I, P, O)
    y = a + Σ c φ(seen, with f_I replaced by a)
"""

from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np

from inercal.arrays import Array
from inercal.frames import skew
from inercal.motion import Motion
from inercal.sensors.axis import Axis
from inercal.sensors.coefficient_tables import ErrorTerm

Form = Literal["reference", "tilted"]
MOTION_COMPONENTS = ("fi", "fp", "fo", "wi", "wp", "wo")
_ARMS = ("arm_i", "arm_p", "arm_o")
_ALONG = {"f": "fi", "w": "wi"}  # what an axis reads when it has no errors


class AxisResponse(NamedTuple):
    """Reading of one axis and its derivatives, all (..., n)."""

    reading: Array
    coefficient_derivatives: dict[str, Array]
    motion_derivatives: dict[str, Array]  # by component: fi … wo


def axis_response(
    axis: Axis,
    lines: Sequence[ErrorTerm],
    values: Mapping[str, Array],
    motion: Motion,
    form: Form,
    *,
    derive: bool,
) -> AxisResponse:
    """Return the reading of an axis and, if wanted, its derivatives.

    Parameters
    ----------
    axis : Axis
    lines : sequence of ErrorTerm
        The terms of the model.
    values : mapping of str to (..., 1) array
        Their coefficients in SI by short name.
    motion : Motion
        (..., n, 3).
    form : "reference" or "tilted"
    derive : bool
        Whether derivatives are wanted.
    """
    seen = axis.motion_components(motion)
    along = _ALONG[axis.measures]
    geometry = _tilted_axis_response(values, seen, along) if form == "tilted" else None
    if geometry is not None:
        seen = seen | {along: geometry.reading, "s" + along[1:]: np.sign(geometry.reading)}
    terms = [
        line
        for line in lines
        if geometry is None or line.name not in geometry.coefficient_derivatives
    ]
    shape = np.broadcast_shapes(*(v.shape for v in (*seen.values(), *values.values())))
    reading = np.broadcast_to(seen[along], shape).copy()
    for line in terms:
        reading += values[line.name] * line.basis.value(seen)
    if not derive:
        return AxisResponse(reading, {}, {})
    coefficient_derivatives = {
        line.name: line.basis.value(seen) + np.zeros(shape) for line in terms
    }
    motion_derivatives = {name: np.full(shape, float(name == along)) for name in MOTION_COMPONENTS}
    for line in terms:
        for name in MOTION_COMPONENTS:
            for product in line.basis.derivative(name):
                motion_derivatives[name] += values[line.name] * product.value(seen)
    if geometry is None:
        return AxisResponse(reading, coefficient_derivatives, motion_derivatives)
    # Chain rule through the rotated axis: the terms of `along` are functions of a(δ, r, f, ω).
    outer = motion_derivatives.pop(along)
    motion_derivatives[along] = np.zeros(shape)
    for name, inner in geometry.motion_derivatives.items():
        motion_derivatives[name] += outer * inner
    for name, inner in geometry.coefficient_derivatives.items():
        coefficient_derivatives[name] = outer * inner
    return AxisResponse(reading, coefficient_derivatives, motion_derivatives)


def _tilted_axis_response(
    values: Mapping[str, Array], seen: Mapping[str, Array], along: str
) -> AxisResponse:
    """Return the force or rate along the rotated, displaced axis, a, and its derivatives."""
    tan_o = np.tan(values.get("delta_o", np.zeros(1)))
    tan_p = np.tan(values.get("delta_p", np.zeros(1)))
    norm = np.sqrt(1 + tan_o**2 + tan_p**2)
    h = (1 / norm, tan_o / norm, -tan_p / norm)
    kind = along[0]
    sensed = [seen[kind + axis] for axis in "ipo"]
    modelled = [name for name in _ARMS if name in values]
    arm = [values.get(name, np.zeros(1)) for name in _ARMS] if modelled else []
    coefficient_derivatives: dict[str, Array] = {}
    motion_derivatives = {kind + axis: h[k] for k, axis in enumerate("ipo")}
    if arm:
        w, dw = (np.stack(np.broadcast_arrays(*(seen[s + a] for a in "ipo")), -1) for s in "wa")
        cross = skew(dw) + skew(w) @ skew(w)
        r = np.stack(np.broadcast_arrays(*arm), axis=-1)
        h_row = np.stack(np.broadcast_arrays(*h), axis=-1)
        sensed = [
            f + part for f, part in zip(sensed, np.moveaxis(_apply(cross, r), -1, 0), strict=True)
        ]
        along_r = _apply(np.swapaxes(cross, -1, -2), h_row)
        coefficient_derivatives = {
            name: along_r[..., k] for k, name in enumerate(_ARMS) if name in modelled
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


def _apply(matrix: Array, vector: Array) -> Array:
    return (matrix @ vector[..., None])[..., 0]
