"""Describe a turntable without readback, which is at rest between its turns.

Its angles, its level and the squareness of its axes are unknown. Only gravity and, from the
latitude, the earth's rate are known.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from inercal.basics.parameters import Parameter, local_gravity
from inercal.basics.units import Measured
from inercal.benches.turntable.bench import Turntable
from inercal.physics.sensors import Sensor


@dataclass(frozen=True)
class StillTable:
    """A turntable whose angles are not used.

    Parameters
    ----------
    gravity : Measured
        Local gravity, m/s².
    latitude : Measured
        Latitude, rad, positive in the north.
    """

    gravity: Measured
    latitude: Measured

    @classmethod
    def from_turntable(cls, bench: "Turntable | StillTable") -> "StillTable":
        """Return the same turntable without its angles, with only gravity and latitude."""
        if isinstance(bench, StillTable):
            return bench
        place = bench.place
        return cls(bench.gravity, Measured(bench.latitude, 0.0) if place is None else place)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The imperfections of the bench, as data."""
        return (
            local_gravity(self.gravity),
            Parameter.from_measured("latitude", "rad", self.latitude, "latitude"),
        )

    def nuisances(self, steps: Sequence[Any], sensor: Sensor) -> dict[str, Parameter]:
        """Return gravity and latitude by name, because they act on every step."""
        return {parameter.name: parameter for parameter in self.parameters}
