"""Describe a precision centrifuge with its stated values, in the terms of IEEE Std 836.

`inercal.benches.centrifuge.arm_motion` computes the motion that a sensor on the arm senses.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import cos, sqrt
from typing import Literal

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.parameters import NOT_QUALIFIED, Parameter, QualifiedParameters, local_gravity
from inercal.basics.units import Measured
from inercal.benches.centrifuge.arm_motion import attitude_names, sensed_motion
from inercal.benches.contract import MeanMotion, NoReadingOffsets
from inercal.benches.key_declarations import constant, declared_parameters, deviation, small_angle
from inercal.physics.earth import EARTH_RATE
from inercal.physics.plan import Spin
from inercal.physics.sensors import Sensor

Platform = Literal["locked", "counter-rotating"]


@dataclass(frozen=True)
class Centrifuge(NoReadingOffsets):
    """A precision centrifuge.

    Parameters
    ----------
    gravity : Measured
        Local gravity, m/s².
    radius : Measured
        Distance from the spindle's axis to the sensor's centre while the arm is at rest, m.
    latitude : Measured or None
        Latitude, rad. None means that it is unknown; the earth's rate along the spindle is then a
        nuisance.
    stretch : Measured
        Relative growth of the radius per unit of centripetal acceleration, 1/(m/s²).
    rate : float
        Relative standard deviation of the rate error that is common to the run.
    tilt : float
        Standard deviation of the tilt of gravity relative to the arm, common to the run, rad.
    lean : float
        Standard deviation of the spindle's lean in each of two directions, rad.
    dwell_rate : float
        Relative standard deviation of the rate from dwell to dwell.
    dwell_tilt : float
        Standard deviation of the tilt from dwell to dwell, rad.
    platform : "locked" or "counter-rotating"
        Whether the sensor turns with the arm or keeps its attitude relative to the ground.
    mounting : float
        Standard deviation of each mounting angle, rad.
    indexing : float or None
        Standard deviation of each indexing angle of each attitude, rad. None means that the
        attitudes are unknown.
    sense : 1 or -1
        Sense of a positive rate seen from above: 1 is counter-clockwise, -1 is clockwise.
    acceleration : float
        Angular acceleration of the arm between its rates, rad/s². It affects only the duration of a
        plan and its simulation.
    qualified : QualifiedParameters
        Results of qualifications, which replace stated values.
    """

    gravity: Measured
    radius: Measured
    latitude: Measured | None = None
    stretch: Measured = constant(
        "1/(m/s²)", "0 ppm/g ± 0", "stretch of the arm", example="0.2 ppm/g ± 0.05 ppm/g"
    )
    rate: float = deviation("1", "1 ppm", "rate of the arm, relative", key="rate_error")
    tilt: float = small_angle("2 ″", "tilt of gravity against the arm")
    lean: float = small_angle("2 ″", {f"lean{k}": "lean of the spindle" for k in (1, 2)})
    dwell_rate: float = deviation("1", "0 ppm", "rate of a dwell", scope="dwell", example="0.2 ppm")
    dwell_tilt: float = small_angle("0 ″", "tilt of a dwell", scope="dwell", example="1 ″")
    platform: Platform = "locked"
    mounting: float = deviation(
        "°", "0.1 °", {f"mount_{a}": f"mounting about {a}" for a in "xyz"}, attitude=True
    )
    indexing: float | None = None
    sense: Literal[1, -1] = 1
    acceleration: float = 3.0
    qualified: QualifiedParameters = NOT_QUALIFIED

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The imperfections of the bench, as data."""
        # If a vector's length is known but not its direction, the rms of each component is
        # length/√3.
        earth = Parameter(
            "earth_up", "rad/s", EARTH_RATE / sqrt(3), "run", 0.0, "earth rate along the spindle"
        )
        level = EARTH_RATE / sqrt(3)
        if (place := self.latitude) is not None:
            earth = Parameter.from_measured("latitude", "rad", place, "latitude")
            level = EARTH_RATE * cos(place.value) / sqrt(2)  # the azimuth is unknown
        # If the sensor is locked to the arm, the level earth rate averages to zero over whole
        # turns.
        level *= self.platform != "locked"
        sd = self.indexing or 0.0
        stated = (
            local_gravity(self.gravity),
            Parameter.from_measured("radius", "m", self.radius, "static radius"),
            *declared_parameters(self, "stretch", "rate", "tilt", "lean"),
            earth,
            Parameter("level1", "rad/s", level, "run", 0.0, "earth rate, level"),
            Parameter("level2", "rad/s", level, "run", 0.0, "earth rate, level"),
            *declared_parameters(self, "mounting"),
            *(
                Parameter(f"index_{a}", "rad", sd, "position", 0.0, f"indexing about {a}", "", True)
                for a in "xyz"
            ),
            *declared_parameters(self, "dwell_rate", "dwell_tilt"),
        )
        return self.qualified.apply(stated)

    def nuisances(self, steps: Sequence[Spin], sensor: Sensor) -> dict[str, Parameter]:
        """Return the parameters that act on these steps, by full name such as "index_x[p07]"."""
        return self.acting_parameters(steps, dwells=True)

    def acting_parameters(
        self, steps: Sequence[Spin], *, vectors: bool = True, dwells: bool = False
    ) -> dict[str, Parameter]:
        """Return the parameters that an estimator treats as nuisances, by full name.

        Parameters
        ----------
        steps : sequence of Spin
        vectors : bool
            Whether the specific force vector is observed. Its norm does not depend on the attitude.
        dwells : bool
            Whether to include the parameters of each dwell, which an estimator treats as noise.
        """
        labels = {
            "run": [""],
            "position": [f"[{name}]" for name in attitude_names(steps).values()],
            "dwell": [f"[{step.label}]" for step in steps] if dwells else [],
        }
        return {
            f"{parameter.name}{label}": parameter
            for parameter in self.parameters
            if vectors or not parameter.attitude
            for label in labels[parameter.scope]
        }

    def mean_motion(self, steps: Sequence[Spin], q: Mapping[str, Array]) -> MeanMotion:
        """Return the mean motion during each dwell; see `inercal.benches.contract.MeanBench`.

        Raises
        ------
        InputError
            The attitude of a step is not known.
        """
        stated = {name: np.array(p.value) for name, p in self.acting_parameters(steps).items()}
        result = sensed_motion(self, steps, stated | dict(q))
        labels = [step.label for step in steps]
        return MeanMotion.with_lazy_derivatives(
            result.motion,
            lambda: (_split_by_dwell(result.df, labels), _split_by_dwell(result.dw, labels)),
        )


def _split_by_dwell(by: Mapping[str, Array], labels: Sequence[str]) -> dict[str, Array]:
    """Return derivatives (..., r, 3), with one name for each dwell's parameter."""
    result = {name: rows for name, rows in by.items() if not name.startswith("dwell")}
    own = np.eye(len(labels))
    for name in set(by) - set(result):
        result |= {f"{name}[{label}]": by[name] * own[k][:, None] for k, label in enumerate(labels)}
    return result
