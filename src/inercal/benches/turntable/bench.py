"""A turntable of one to three axes as a bench: what is imperfect of it, as data.

The frame is level: east, north, up. At zero angles the body's z axis stands up and its y axis
points at the azimuth α, clockwise from north. Axes a₁ (outermost) to a_k are body axes at zero
angles, and the attitude, body to level, at their angles θ is::

    C = T R_a₁(θ₁) N₁ R_a₂(θ₂) N₂ R_a₃(θ₃),   T = R_x(λ_x) R_y(λ_y) R_z(−α)

λ are the base's leans and N_i is a rotation by σ_i about the axis that is neither a_i nor a_i+1: by
that much the two miss a right angle. What the table says of an axis is::

    readback(t) = θ(t′) + Σ_h s_h sin(hθ(t′)) + c_h cos(hθ(t′)) + white noise,   t′ = t (1 − χ) − τ

with t the IMU's time, τ the latency and χ the relative rate of the readback's clock.

The body's frame is that of the innermost axis: how the IMU is mounted in it is the sensor's own.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import isfinite, radians

from inercal.benches.key_declarations import constant, declared_parameters, deviation, small_angle
from inercal.benches.turntable.axis_profiles import AxisMotionLimits
from inercal.earth import earth_rate_up_north
from inercal.errors import InputError
from inercal.parameters import Parameter, local_gravity
from inercal.plan import TableStep
from inercal.sensors import Sensor
from inercal.units import Measured

_NAMES = {1: ("outer",), 2: ("outer", "inner"), 3: ("outer", "middle", "inner")}
_EXACT = Measured(0.0, 0.0)
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
        One to three different letters of x, y, z: body axes that the outermost to the innermost
        axis turn about, at zero angles.
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
        The readback says where the table was that long ago, s.
    clock : float
        Standard deviation of the rate of the readback's clock against the IMU's, relative.
    lever : tuple of three Measured
        From where the axes cross to the IMU's centre, in the body, m.
    limits : tuple of AxisMotionLimits
        Of each axis in their order, or one for all.

    Raises
    ------
    InputError
        Axes that are none or come twice, a gravity that is not > 0, no latitude, limits of another
        number of axes, a value that is not finite, a deviation that is negative.
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

    def __post_init__(self) -> None:
        k = len(self.axes)
        if k not in _NAMES or len(set(self.axes)) < k or not set(self.axes) <= set("xyz"):
            raise InputError(
                f"turntable: axes are {self.axes!r}; name one to three different ones of x, y, z, "
                "the outermost first"
            )
        if not (isfinite(self.gravity.value) and self.gravity.value > 0):
            raise InputError(f"turntable: gravity is {self.gravity.value} m/s²; give it > 0")
        earth_rate_up_north(self.latitude)  # refuses what is not a latitude
        if len(self.limits) not in (1, k):
            raise InputError(f"turntable: {len(self.limits)} limits; give one for all or {k}")
        if len(self.lever) != len("xyz"):
            raise InputError(f"turntable: lever has {len(self.lever)} parts; give three")
        deviations = {"readback's noise": self.white}
        for parameter in self.parameters:
            deviations[parameter.name] = parameter.sd
            if not isfinite(parameter.value):
                raise InputError(f"turntable: {parameter.name} is {parameter.value}")
        for what, sd in deviations.items():
            if not (isfinite(sd) and sd >= 0):
                raise InputError(f"turntable: deviation of {what} is {sd}; give it 0 or more")

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
        """The imperfections, as data; all are of the whole run."""
        return self._parameters

    @cached_property
    def _parameters(self) -> tuple[Parameter, ...]:
        return (
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

    @cached_property
    def _by_name(self) -> dict[str, Parameter]:
        return {parameter.name: parameter for parameter in self.parameters}

    def nuisances(self, steps: Sequence[TableStep], sensor: Sensor) -> dict[str, Parameter]:
        """Return the parameters by name: all act on every step."""
        return self.acting_parameters()

    def acting_parameters(self) -> dict[str, Parameter]:
        """Return the same."""
        return self._by_name.copy()
