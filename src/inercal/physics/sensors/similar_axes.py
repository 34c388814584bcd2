"""Groups of axes of one kind with the same terms, whose readings are computed together.

The last dimension of every array runs over the sensor axes: `(..., n, k)` for k axes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.physics.motion import Motion
from inercal.physics.quantities import KINDS, Measures
from inercal.physics.sensors.axis_model import ALONG, ARMS, AxisResponse, Form, axis_response
from inercal.physics.sensors.coefficient_tables import ErrorTerm

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
