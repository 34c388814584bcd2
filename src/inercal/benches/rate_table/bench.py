"""Describe a plain rate table, which turns about the vertical with the sensor in a fixture.

At the radius R from the axis the sensor senses the centripetal acceleration toward the centre and
the reaction to gravity. With the directions `out` and `up` of its mounting in the body frame::

    f = exp(φ) (−a out + g up),   a = (R + s) (ω (1 + ρ + σ))²              turning
    f = exp(φ) g (√(1 − λ₁² − λ₂²) up − λ₁ out + λ₂ along)                  at rest

φ are the three error angles of the mounting, s is the error of its radius, ρ the relative error
that all rates in the run share, and σ the relative error of one set speed, which is the same in all
dwells at this speed.

λ is the lean of the table's axis from the vertical, in the frame of the table: λ₁ toward the
centre, λ₂ along = up × (−out). The table stops at a different azimuth each time, so each rest has
its own λ. If both components of a lean are normally distributed, its values at random azimuths are
uncorrelated. While the table turns, λ rotates once per turn. Over whole turns only the second order
remains, f = g (1 − λ²/2) up, which is 1.5 µg at 0.1° and is neglected. The product of λ and the
fraction of a turn that a wrong rate adds to whole turns is neglected too.

A sensor fixed to a table at a steady rate senses no Coriolis acceleration from the table's motion.
The Coriolis acceleration from the earth's rate, 2 Ω ω R, is neglected as in the source; it is 34 µg
at 86 r/min and 0.25 m.

Source: Xiao Changrun, Liu Yang, Liu Ruijie, Transducer and Microsystem Technologies 33(10), 2014,
section 1 (the table), 10.13873/J.1000-9787(2014)10-0021-04.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import pi, radians

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.parameters import NOT_QUALIFIED, Parameter, QualifiedParameters, local_gravity
from inercal.basics.units import Measured
from inercal.benches.arm import outward_and_up_directions
from inercal.benches.contract import MeanMotion, NoReadingOffsets, require_possible_values
from inercal.benches.key_declarations import (
    declarations,
    declared_parameters,
    deviation,
    small_angle,
)
from inercal.benches.motion_control import AxisMotionLimits
from inercal.physics.frames import exp_so3, left_jacobian, skew, stack_components, transform
from inercal.physics.motion import Motion
from inercal.physics.plan import Spin
from inercal.physics.sensors import Sensor

_AXES = "xyz"
_ALIKE = 5e-3  # relative difference up to which rates belong to one set speed
_DEFAULT_LIMITS = AxisMotionLimits(90 * pi / 30, radians(100))
_LEAN = {1: "toward the centre", 2: "along"}


@dataclass(frozen=True)
class RateTable(NoReadingOffsets):
    """A rate table with a fixture.

    Parameters
    ----------
    gravity : Measured
        Local gravity, m/s².
    radius : Measured
        Distance from the table's axis to the sensor's centre, m.
    seat : float
        Standard deviation of the difference between each mounting's radius and `radius`, m.
    pose : float
        Standard deviation of each of the three angles of each mounting, rad.
    rate : float
        Relative standard deviation of the rate error that is common to the run.
    speed : float
        Relative standard deviation of each set speed, which is the same in all dwells at that
        speed.
    lean : float
        Standard deviation of each of the two components of the lean in each rest, rad.
    limits : AxisMotionLimits
        Limits of the table's axis for a host that drives it.
    qualified : QualifiedParameters
        Results of qualifications, which replace stated values.

    Raises
    ------
    InputError
        Gravity or the radius is not positive, or a standard deviation is negative or not finite.
    """

    gravity: Measured
    radius: Measured
    seat: float = deviation("m", "0.5 mm", "radius of a mounting", scope="mounting")
    pose: float = deviation(
        "°", "0.2 °", {f"pose_{a}": f"mounting about {a}" for a in _AXES}, scope="mounting"
    )
    rate: float = deviation(
        "1", "0 %", "rate of the table, relative", key="rate_error", example="0.01 %"
    )
    speed: float = deviation("1", "0.05 %", "a set speed, relative", scope="speed")
    lean: float = small_angle(
        "0.05 °",
        {f"lean_{k}": f"lean at rest, {toward}" for k, toward in _LEAN.items()},
        scope="position",
    )
    limits: AxisMotionLimits = _DEFAULT_LIMITS
    qualified: QualifiedParameters = NOT_QUALIFIED

    def __post_init__(self) -> None:
        measured = {"gravity": self.gravity, "radius": self.radius}
        deviations = {name: quantity.sd for name, quantity in measured.items()}
        deviations |= {name: getattr(self, name) for name in declarations(RateTable)}
        values = {name: quantity.value for name, quantity in measured.items()}
        require_possible_values("rate table", values, deviations)

    @property
    def names(self) -> tuple[str, ...]:
        """Name of the table's axis."""
        return ("table",)

    @property
    def axis_motion_limits(self) -> tuple[AxisMotionLimits, ...]:
        """Motion limits of the table's axis."""
        return (self.limits,)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The imperfections of the bench, as data."""
        stated = (
            local_gravity(self.gravity),
            Parameter.from_measured("radius", "m", self.radius, "radius"),
            *declared_parameters(self, "rate", "seat", "pose", "speed", "lean"),
        )
        return self.qualified.apply(stated)

    def nuisances(self, steps: Sequence[Spin], sensor: Sensor) -> dict[str, Parameter]:
        """Return the parameters that act on these steps, by full name such as "pose_x[XY30]"."""
        return self.acting_parameters(steps)

    def acting_parameters(self, steps: Sequence[Spin]) -> dict[str, Parameter]:
        """Return the parameters that act on these steps; they do not depend on the sensor."""
        return {full: parameter for full, parameter, _ in _acting_rows(self, steps)}

    def mean_motion(self, steps: Sequence[Spin], q: Mapping[str, Array]) -> MeanMotion:
        """Return the mean motion during each dwell; see `inercal.benches.contract.MeanBench`."""
        return sensed_motion(self, steps, q)


def _acting_rows(
    bench: RateTable, steps: Sequence[Spin]
) -> Iterator[tuple[str, Parameter, NDArray[np.bool_]]]:
    """Yield each parameter that acts: its full name, its declaration, and a mask of rows, (r,)."""
    turning = np.array([step.rate != 0 for step in steps])
    shared = {
        "mounting": mounting_names(steps),
        "speed": speed_names(steps),
        "position": [step.label for step in steps],
    }
    for parameter in bench.parameters:
        always = parameter.name == "g" or parameter.name.startswith("pose")
        rows = np.ones(len(steps), dtype=bool) if always else turning
        if parameter.name.startswith("lean"):
            rows = ~turning
        if parameter.scope == "run":
            if rows.any():
                yield parameter.name, parameter, rows
            continue
        labels = shared[parameter.scope]
        for label in dict.fromkeys(labels):
            own = rows & np.array([one == label for one in labels])
            if own.any():
                yield f"{parameter.name}[{label}]", parameter, own


def speed_names(steps: Sequence[Spin]) -> list[str]:
    """Return the name of each step's set speed, such as "86 rpm".

    Rates within 1/200 of each other belong to one set speed, because each dwell reads it back
    separately.
    """
    first: dict[float, str] = {}
    for step in steps:
        if not any(_is_same_rate(step.rate, rate) for rate in first):
            first[step.rate] = f"{step.rate * 30 / pi:.4g} rpm"
    return [
        next(name for rate, name in first.items() if _is_same_rate(s.rate, rate)) for s in steps
    ]


def _is_same_rate(one: float, other: float) -> bool:
    return one == other or abs(one - other) < _ALIKE * abs(other)


def mounting_names(steps: Sequence[Spin]) -> list[str]:
    """Return the name of each step's mounting: the attitude's name, or the first label with it."""
    first: dict[object, str] = {}
    for step in steps:
        own = step.attitude.name if step.attitude else ""
        first.setdefault(step.attitude, own or step.label)
    return [first[step.attitude] for step in steps]


def sensed_motion(bench: RateTable, steps: Sequence[Spin], q: Mapping[str, Array]) -> MeanMotion:
    """Return the specific force during each dwell, with its derivatives.

    Parameters
    ----------
    bench : RateTable
    steps : sequence of r Spin
    q : mapping of str to (...) array
        The bench's parameters, SI, by full name. A missing parameter keeps its stated value.

    Raises
    ------
    InputError
        The attitude of a step is not known.
    """
    out, up = outward_and_up_directions(steps)
    declared = bench.acting_parameters(steps)
    mounted = mounting_names(steps)

    def value(name: str) -> Array:
        return np.asarray(q.get(name, declared[name].value if name in declared else 0.0))

    def of_each(name: str, labels: Sequence[str]) -> Array:
        return stack_components(*(value(f"{name}[{label}]") for label in labels))

    w = np.array([step.rate for step in steps])
    g = value("g")[..., None]
    radius = (value("radius") if w.any() else np.zeros(()))[..., None] + of_each("seat", mounted)
    turned = w * (1 + value("rate")[..., None] + of_each("speed", speed_names(steps)))
    a = radius * turned**2
    rests = [step.label for step in steps]
    lean = np.stack([of_each(f"lean_{k}", rests) for k in _LEAN], axis=-1) * (w == 0)[:, None]
    root = np.sqrt(1 - (lean**2).sum(-1))
    along = np.cross(up, -out)
    pose = stack_components(*(of_each(f"pose_{axis}", mounted) for axis in _AXES))
    turn = exp_so3(pose)
    inward, along, upward = (transform(turn, v) for v in (-out, along, up))
    reaction = root[..., None] * upward + lean[..., :1] * inward + lean[..., 1:] * along
    f = a[..., None] * inward + g[..., None] * reaction
    by_rate = (2 * radius * turned * w)[..., None] * inward
    by_pose = -skew(f) @ left_jacobian(pose)
    slopes = {"g": reaction, "rate": by_rate, "speed": by_rate}
    slopes |= dict.fromkeys(("radius", "seat"), turned[..., None] ** 2 * inward)
    slopes |= {
        f"lean_{k}": g[..., None] * (across - (lean[..., k - 1] / root)[..., None] * upward)
        for k, across in zip(_LEAN, (inward, along), strict=True)
    }
    slopes |= {f"pose_{axis}": by_pose[..., k] for k, axis in enumerate(_AXES)}
    by = {
        full: np.where(rows[:, None], slopes[parameter.name], 0.0)
        for full, parameter, rows in _acting_rows(bench, steps)
    }
    return MeanMotion(Motion(f), by)


def force_sensitivities(bench: RateTable, steps: Sequence[Spin]) -> Array:
    """Return the change of f for one standard deviation of each parameter, (k, r, 3) m/s²."""
    result = sensed_motion(bench, steps, {})
    rows = [
        q.sd * result.df[name] for name, q in bench.acting_parameters(steps).items() if q.sd > 0
    ]
    return np.stack(rows) if rows else np.zeros((0, len(steps), 3))
