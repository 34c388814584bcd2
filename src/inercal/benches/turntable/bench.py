"""Describe a turntable with one to three axes as a bench, with its imperfections as data.

The level frame is east, north, up. At zero angles the body's z axis points up, and its y axis to
the azimuth α, clockwise from north. Each axis from a₁ (outermost) to a_k is a body axis at zero
angles. The attitude, body to level, at the angles θ of the axes is::

    C = T R_a₁(θ₁) N₁ R_a₂(θ₂) N₂ R_a₃(θ₃),   T = R_x(λ_x) R_y(λ_y) R_z(−α)

λ are the leans of the base. N_i is a rotation about the third axis by σ_i, which is the deviation
of the angle between a_i and a_i+1 from a right angle. The readback of an axis is::

    readback(t) = θ(t′) + Σ_h s_h sin(hθ(t′)) + c_h cos(hθ(t′)) + white noise,   t′ = t (1 − χ) − τ

where t is the IMU's time, τ the latency and χ the relative rate of the readback's clock.

The body frame is fixed to the innermost axis. The mounting of the IMU in it belongs to the sensor.

A `StillTable` has no readback, and is at rest between its turns. Its angles, its level and the
squareness of its axes are unknown. Only gravity and, from the
latitude, the earth's rate are known.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import isfinite, radians
from typing import Any

from inercal.basics.errors import InputError
from inercal.basics.parameters import NOT_QUALIFIED, Parameter, QualifiedParameters, local_gravity
from inercal.basics.units import Measured
from inercal.benches.contract import require_possible_values
from inercal.benches.key_declarations import constant, declared_parameters, deviation, small_angle
from inercal.benches.motion_control import AxisMotionLimits
from inercal.physics.earth import earth_rate_up_north
from inercal.physics.plan import TableStep
from inercal.physics.sensors import Sensor

_NAMES = {1: ("outer",), 2: ("outer", "inner"), 3: ("outer", "middle", "inner")}
_EXACT = Measured(0.0, 0.0)
_CONSTANTS = {"g", "azimuth", "latency"}  # parameters whose values are stated constants
_DEFAULT_LIMITS = (AxisMotionLimits(radians(30), radians(30)),)


@dataclass(frozen=True)
class Turntable:
    """A turntable with one to three axes.

    Parameters
    ----------
    gravity : Measured
        Local gravity at the intersection of the axes, m/s².
    latitude : float
        Latitude, rad, positive in the north.
    azimuth : Measured
        Azimuth of the body's y axis at zero angles, clockwise from north, rad.
    axes : str
        One to three different letters out of x, y and z. They name the body axes at zero angles
        about which the table's axes turn, outermost first.
    lean : float
        Standard deviation of each of the base's two leans, about east and about north, rad.
    square : float
        Standard deviation of the right-angle error between neighbouring axes, rad.
    harmonics : tuple of float
        Standard deviation of the sine and cosine amplitudes of harmonics 1, 2, … in each axis'
        readback, rad.
    white : float
        Standard deviation of the noise of each readback reading, rad.
    latency : Measured
        Delay of the readback, s. Each reading shows the angle that the axis had this long before.
    clock : float
        Standard deviation of the relative rate error between the readback's and the IMU's clock.
    lever : tuple of three Measured
        Lever arm from the intersection of the axes to the IMU's centre, in the body frame, m.
    limits : tuple of AxisMotionLimits
        Motion limits of each axis in order, or one for all axes.
    qualified : QualifiedParameters
        Results of qualifications, whose values correct attitudes and readback.
    place : Measured or None
        Latitude with its uncertainty, rad, for methods that take it into account. None means that
        `latitude` is exact.
    readback : bool
        Whether the angles of the axes are read. If not, recordings contain no angles.

    Raises
    ------
    InputError
        The axes are not different letters out of xyz, gravity is not positive, the latitude is
        impossible, the number of limits is wrong, a value is not finite, or a standard deviation is
        negative.
    """

    gravity: Measured
    latitude: float
    azimuth: Measured = _EXACT
    axes: str = "zxy"
    lean: float = small_angle(
        "5 ″", {"lean_x": "lean of the base about east", "lean_y": "lean of the base about north"}
    )
    square: float = small_angle("2 ″", {})
    harmonics: tuple[float, ...] = ()
    white: float = small_angle("0.5 ″", {}, key="noise")
    latency: Measured = constant("s", "0 ms ± 5 ms", "delay of the readback")
    clock: float = deviation("1", "0 ppm", "rate of the readback's clock")
    lever: tuple[Measured, Measured, Measured] = (_EXACT, _EXACT, _EXACT)
    limits: tuple[AxisMotionLimits, ...] = _DEFAULT_LIMITS
    qualified: QualifiedParameters = NOT_QUALIFIED
    place: Measured | None = None
    readback: bool = True

    def __post_init__(self) -> None:
        k = len(self.axes)
        if k not in _NAMES or len(set(self.axes)) < k or not set(self.axes) <= set("xyz"):
            raise InputError(
                f"turntable: axes are {self.axes!r}; give one to three different letters out of "
                "xyz, the outermost axis first",
                key="axes",
            )
        earth_rate_up_north(self.latitude)  # refuses an impossible latitude
        if len(self.limits) not in (1, k):
            text = f"turntable: {len(self.limits)} limits are given; give one for all axes or {k}"
            raise InputError(text, key="limits")
        if len(self.lever) != len("xyz"):
            text = f"turntable: lever has {len(self.lever)} components; it must have three"
            raise InputError(text, key="lever")
        for parameter in self.parameters:
            if not isfinite(parameter.value):
                raise InputError(
                    f"turntable: {parameter.name} is {parameter.value}; it must be finite",
                    key=parameter.name,
                )
        deviations = {parameter.name: parameter.sd for parameter in self.parameters}
        require_possible_values(
            "turntable", {"gravity": self.gravity.value}, deviations | {"white": self.white}
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the axes and of their readback, such as "outer", "middle" and "inner"."""
        return _NAMES[len(self.axes)]

    @property
    def axis_motion_limits(self) -> tuple[AxisMotionLimits, ...]:
        """Motion limits of each axis, outermost first."""
        return self.limits if len(self.limits) > 1 else self.limits * len(self.axes)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The imperfections of the bench, as data; all have the scope "run"."""
        return self._parameters

    @cached_property
    def _parameters(self) -> tuple[Parameter, ...]:
        stated = (
            local_gravity(self.gravity),
            *declared_parameters(self, "lean"),
            Parameter.from_measured("azimuth", "rad", self.azimuth, "azimuth of the base"),
            *(
                Parameter(
                    f"square_{i}", "rad", self.square, "run", 0.0, f"right angle between {of}"
                )
                for i, of in enumerate(map(" and ".join, pairwise(self.names)), start=1)
            ),
            *(
                Parameter(
                    f"{wave}{h}[{name}]", "rad", sd, "run", 0.0, f"{words} of harmonic {h}, {name}"
                )
                for name in self.names
                for h, sd in enumerate(self.harmonics, start=1)
                for wave, words in (("sin", "sine"), ("cos", "cosine"))
            ),
            *declared_parameters(self, "latency", "clock"),
            *(
                Parameter(f"lever_{a}", "m", arm.sd, "run", arm.value, f"lever arm along {a}")
                for a, arm in zip("xyz", self.lever, strict=True)
            ),
        )
        return self.qualified.apply(stated, corrected=True)

    def correction(self, name: str) -> float:
        """Return the qualified value of an error whose expected value is zero, rad."""
        return 0.0 if name in _CONSTANTS else self.qualified.correction(name)

    @cached_property
    def _by_name(self) -> dict[str, Parameter]:
        return {parameter.name: parameter for parameter in self.parameters}

    def nuisances(self, steps: Sequence[TableStep], sensor: Sensor) -> dict[str, Parameter]:
        """Return the parameters by name; all of them act on every step."""
        return self.acting_parameters()

    def acting_parameters(self) -> dict[str, Parameter]:
        """Return all parameters by name, because all of them act on every step."""
        return self._by_name.copy()


MAX_GAP_SECONDS = 0.5  # s without a sample; after a longer gap the attitude restarts from readback
COARSE_REST_SECONDS = 20.0  # s at rest that give the first values of the biases
# A rest commanded for 20 s is shorter in the data: the table settles, and its readback is delayed.
MIN_REST_SECONDS = 0.95 * COARSE_REST_SECONDS
_SETTLING_SECONDS = 0.25  # s, without the latency of the readback


def settling_time(bench: Turntable) -> float:
    """Return the settling time of the table, s, with the possible latency of its readback."""
    return _SETTLING_SECONDS + abs(bench.latency.value) + 2 * bench.latency.sd


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
