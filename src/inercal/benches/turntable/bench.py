"""A turntable of one to three axes as a bench: its imperfections, as data.

The frame is level: east, north, up. At zero angles the body's z axis points up and its y axis
to the azimuth α, clockwise from north. Axes a₁ (outermost) to a_k are body axes at zero angles,
and the attitude, body to level, at their angles θ is::

    C = T R_a₁(θ₁) N₁ R_a₂(θ₂) N₂ R_a₃(θ₃),   T = R_x(λ_x) R_y(λ_y) R_z(−α)

λ are the base's leans and N_i is a rotation by σ_i, the deviation of the angle between a_i and
a_i+1 from a right angle, about the axis that is neither of them. The readback of an axis is::

    readback(t) = θ(t′) + Σ_h s_h sin(hθ(t′)) + c_h cos(hθ(t′)) + white noise,   t′ = t (1 − χ) − τ

with t the IMU's time, τ the latency and χ the relative rate of the readback's clock.

The body's frame is that of the innermost axis; the mounting of the IMU in it belongs to the sensor.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import isfinite, radians

from inercal.basics.errors import InputError
from inercal.basics.parameters import NOT_QUALIFIED, Parameter, QualifiedParameters, local_gravity
from inercal.basics.units import Measured
from inercal.benches.contract import require_possible_values
from inercal.benches.key_declarations import constant, declared_parameters, deviation, small_angle
from inercal.benches.turntable.axis_profiles import AxisMotionLimits
from inercal.physics.earth import earth_rate_up_north
from inercal.physics.plan import TableStep
from inercal.physics.sensors import Sensor

_NAMES = {1: ("outer",), 2: ("outer", "inner"), 3: ("outer", "middle", "inner")}
_EXACT = Measured(0.0, 0.0)
_CONSTANTS = {"g", "azimuth", "latency"}  # parameters whose value is a stated constant
_DEFAULT_LIMITS = (AxisMotionLimits(radians(30), radians(30)),)


@dataclass(frozen=True)
class Turntable:
    """The bench of a turntable.

    Parameters
    ----------
    gravity : Measured
        Local gravity where the axes cross, m/s².
    latitude : float
        rad, positive in the north.
    azimuth : Measured
        Where the body's y axis points at zero angles, rad, clockwise from north.
    axes : str
        One to three different letters of x, y, z: the body axes, at zero angles, about which the
        outermost to the innermost axis turn.
    lean : float
        Standard deviation of each of the base's two leans, about east and about north, rad.
    square : float
        Standard deviation of each right angle between neighbouring axes, rad.
    harmonics : tuple of float
        Of harmonics 1, 2, … of each axis' readback: standard deviation of the amplitudes of sine
        and of cosine, rad each.
    white : float
        Standard deviation of the readback's noise, of each reading, rad.
    latency : Measured
        Delay of the readback: it gives the angles of this time ago, s.
    clock : float
        Standard deviation of the rate of the readback's clock against the IMU's, relative.
    lever : tuple of three Measured
        From where the axes cross to the IMU's centre, in the body, m.
    limits : tuple of AxisMotionLimits
        Of each axis in their order, or one for all.
    qualified : QualifiedParameters
        What qualifications found: attitudes and readback are corrected by the values.
    place : Measured or None
        The latitude with its uncertainty, rad, for methods that count it; None is exact.
    readback : bool
        Whether the angles of the axes are read; otherwise recordings have none.

    Raises
    ------
    InputError
        Axes that are not letters of xyz or come twice, a gravity that is not > 0, an impossible
        latitude, limits of another number of axes, a value that is not finite, a deviation that is
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
                f"turntable: axes are {self.axes!r}; name one to three different letters of xyz, "
                "the outermost axis first",
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
        """Names of the axes, as of their readback: "outer", "middle", "inner"."""
        return _NAMES[len(self.axes)]

    @property
    def axis_motion_limits(self) -> tuple[AxisMotionLimits, ...]:
        """The limits of each axis, outermost first."""
        return self.limits if len(self.limits) > 1 else self.limits * len(self.axes)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The imperfections, as data; all have the scope "run"."""
        return self._parameters

    @cached_property
    def _parameters(self) -> tuple[Parameter, ...]:
        stated = (
            local_gravity(self.gravity),
            *declared_parameters(self, "lean"),
            Parameter.from_measured("azimuth", "rad", self.azimuth, "azimuth of the base"),
            *(
                Parameter(f"square_{i}", "rad", self.square, "run", 0.0, f"{one} against {other}")
                for i, (one, other) in enumerate(
                    zip(self.names, self.names[1:], strict=False), start=1
                )
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
        """Return the parameters by name: all act on every step."""
        return self.acting_parameters()

    def acting_parameters(self) -> dict[str, Parameter]:
        """Return the same."""
        return self._by_name.copy()
