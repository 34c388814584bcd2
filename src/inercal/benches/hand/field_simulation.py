"""Simulation of the Earth's magnetic field in the frame of a sensor that is turned by hand.

At an upward direction u the field is B (cos δ e − sin δ u), where δ is the dip and e the horizontal
direction of magnetic north. If the sensor turns by an angle, the field turns by the opposite angle
in its frame.
"""

from math import pi, radians

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.units import Measured
from inercal.benches.hand.bench import Hand, face_label, tangent_vectors, visit_number
from inercal.benches.hand.rotations import rotate_vectors, shortest_rotation
from inercal.physics.plan import HandStep

_STRENGTH, _DIP = Measured(50e-6, 0.0), Measured(radians(65), 0.0)  # in the middle of Europe
_AZIMUTHS = (0.0, pi, pi / 2, -pi / 2)  # of repeated visits to a face


class FieldSimulation:
    """The field in the sensor's frame, from step to step, (trials, n, 3) T.

    Parameters
    ----------
    bench : Hand
    rng : Generator
    trials : int
    carried : bool
        Whether the azimuth follows the motion. Otherwise each face has a random azimuth, to which
        repeated visits add 180°, 90° and −90°.
    """

    def __init__(self, bench: Hand, rng: "np.random.Generator", trials: int, *, carried: bool):
        self._rng, self._trials, self._carried = rng, trials, carried
        strength, dip = bench.field or _STRENGTH, bench.dip or _DIP
        self._strength = rng.normal(strength.value, strength.sd, (trials, 1))
        sign = -1.0 if bench.dip is None and bench.dip_sign < 0 else 1.0
        self._dip = sign * rng.normal(dip.value, dip.sd, (trials, 1))
        self._north: dict[str, Array] = {}
        self._field: Array | None = None

    def at_step(self, step: HandStep, up: Array, angles: Array) -> Array:
        """Return the field during a step in which the sensor turns about `up` by `angles`."""
        if self._field is None or not self._carried:
            face = face_label(step.label)
            if face not in self._north:
                self._north[face] = self._rng.uniform(-pi, pi, self._trials)
            visit = (visit_number(step.label) - 1) % len(_AZIMUTHS)
            azimuth = (self._north[face] + _AZIMUTHS[visit])[:, None]
            d = tangent_vectors(up)
            level = np.cos(azimuth) * d[..., 0, :] + np.sin(azimuth) * d[..., 1, :]
            self._field = self._strength * (np.cos(self._dip) * level - np.sin(self._dip) * up)
        found = rotate_vectors(up, -angles, self._field)
        self._field = found[:, -1]
        return found

    def during_move(self, start: Array, end: Array, travelled: Array) -> Array:
        """Return the field during a move, of which each sample has travelled some part, (n,)."""
        assert self._field is not None
        axis, angle = shortest_rotation(start, end)
        found = rotate_vectors(axis, angle[:, None] * np.append(travelled, 1.0), self._field)
        self._field = found[:, -1]
        return found[:, :-1]
