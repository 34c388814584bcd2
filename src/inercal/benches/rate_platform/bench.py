"""Describe a rate platform: a table with a vertical axis, and a platform with known angles.

In a dwell at the rate Ω, in setting s with the case direction e up and a₁, a₂ perpendicular to it,
the sensor senses::

    ω = (Ω (1 + ρ + γ sgn Ω + r) + α/T + η + ζ ΔΩ + ω_ie sin φ) U
        + sinc(Θ/2) R_U(−Θ/2) (h₁b₁ + h₂b₂) + β
    f = g U − Ω² (p₁a₁ + p₂a₂),     U = unit(e + t₁a₁ + t₂a₂),  b_i = a_i − t_i e,  Θ = Ω T

ρ is the relative error that all rates in the run share, including the clocks of table and sensor. γ
is the asymmetry of the rate (+ and −), r the relative error of the rate in each dwell, and α the
error of the angle read back in each dwell of T seconds. A turn through a known angle θ has Ω = θ/T,
and the error α of its angle replaces ρ, γ and r. ζ is the part of the last change ΔΩ of the rate
that remains on average, because the table or its drive settles slowly. η = −½ s χ (1 − (Ω/Ω_max)²)
is the table's hysteresis (not at rest), with s = ±1 for a rate that was reached from a lower or a
higher one in the same setting. In each setting, t are the two angles of the table's axis in the
case, and p is the position of the sensor relative to the axis. φ is the latitude. h is the
horizontal earth rate at the start of a dwell. Its azimuth is unknown, so each component has the
standard deviation ω_ie cos φ/√2. The table starts all dwells in a setting at the same azimuth. Over
whole turns h averages to zero; if T is unknown, the turns are assumed to be whole. β is the change
of the gyros' biases from setting to setting.

In a pose with the upward direction u, and c₁, c₂ perpendicular to it, the sensor senses::

    f = g M R u,   ω = M (ω_ie sin φ R u + h₁c₁ + h₂c₂),   R = exp(t₁c₁ + t₂c₂),  M = exp(m)

m are three mounting angles, common to the run, and t are two tilts of each pose.

If an error acts but is not stated, the run is refused, because most errors that are wrongly assumed
to be zero would not show in the residuals.

Sources: IEEE Std 952 and 1431 (rate tests), 1293 (multipoint tests), 1554 (test equipment).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import degrees, inf, sqrt
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.keys import ErrorName
from inercal.basics.parameters import (
    NOT_QUALIFIED,
    Parameter,
    QualifiedParameters,
    Scope,
    local_gravity,
)
from inercal.basics.units import Measured
from inercal.benches.contract import MeanMotion, NoReadingOffsets, require_possible_values
from inercal.benches.rate_platform.mean_motion import level_rate_factor, sensed_motion
from inercal.benches.rate_platform.sections import KnownTurn, PlatformStep, Pose, RateDwell
from inercal.physics.earth import earth_rate_up_north
from inercal.physics.section_settings import key_error
from inercal.physics.sensors import Sensor

_EXACT = 1e-15  # rad/s: the horizontal earth rate at a pole
_WHOLE = 1e-9  # the sinc factor is below this for whole turns


class StatedError(NamedTuple):
    """An error that [bench] states, with its unit, scope, example, meaning and components."""

    like: str
    scope: Scope
    example: str
    meaning: str
    components: str = ""

    @property
    def unit(self) -> str:
        """The SI unit of its parameters."""
        return {"°": "rad", "°/s": "rad/s"}.get(self.like, self.like)


STATED: Mapping[str, StatedError] = {
    "rate_scale": StatedError("1", "run", "500 ppm", "rates of the table and clocks, relative"),
    "rate_asymmetry": StatedError("1", "run", "100 ppm", "asymmetry of the rate, relative"),
    "rate_stability": StatedError("1", "position", "100 ppm", "rate of a dwell, relative"),
    "angle_reading": StatedError("°", "position", "5 ″", "angle read back in a dwell"),
    "rate_hysteresis": StatedError("°/s", "run", "1 °/h", "hysteresis of the table's rate"),
    "settling": StatedError("1", "run", "1 ppm", "remaining part of a change of rate"),
    "turn_angle": StatedError("°", "position", "0.01 °", "angle of a turn"),
    "setting": StatedError("°", "mounting", "0.05 °", "table's axis in the case", "12"),
    "arm": StatedError("m", "mounting", "5 mm", "distance of the sensor from the axis", "12"),
    "turn_on": StatedError("°/s", "mounting", "60 °/h", "gyros' bias in a setting", "xyz"),
    "attitude": StatedError("°", "position", "0.05 °", "tilt of a pose", "12"),
    "mounting": StatedError("°", "run", "0.1 °", "mounting of the case", "xyz"),
}


@dataclass(frozen=True)
class RatePlatform(NoReadingOffsets):
    """A rate platform. An error that is None is not stated.

    Parameters
    ----------
    gravity : Measured
        Local gravity, m/s².
    latitude : Measured or None
        Latitude, rad, positive in the north. A sensor with gyros needs the latitude.
    rate_scale, rate_asymmetry, rate_stability : float or None
        Standard deviations of ρ, γ and r.
    angle_reading : float or None
        Standard deviation of α, rad. None means 0, because the rate is not measured by an angle.
    setting : float or None
        Standard deviation of each of t₁ and t₂ in a setting, rad.
    arm : float or None
        Standard deviation of each of p₁ and p₂, m.
    turn_on : float or None
        Standard deviation of each component of β, rad/s. None means 0, because the gyros stay
        switched on.
    attitude : float or None
        Standard deviation of each tilt of a pose, rad.
    mounting : float or None
        Standard deviation of each mounting angle, rad.
    turn_angle : float or None
        Standard deviation of the angle of each turn, rad.
    rate_hysteresis, settling : float or None
        Standard deviations of χ, rad/s, and of ζ. None means 0.
    qualified : QualifiedParameters
        Results of qualifications, which replace stated values.

    Raises
    ------
    InputError
        Gravity is not positive, the latitude is impossible, or a standard deviation is negative or
        not finite.
    """

    gravity: Measured
    latitude: Measured | None = None
    rate_scale: float | None = None
    rate_asymmetry: float | None = None
    rate_stability: float | None = None
    angle_reading: float | None = None
    setting: float | None = None
    arm: float | None = None
    turn_on: float | None = None
    attitude: float | None = None
    mounting: float | None = None
    turn_angle: float | None = None
    rate_hysteresis: float | None = None
    settling: float | None = None
    qualified: QualifiedParameters = NOT_QUALIFIED

    def __post_init__(self) -> None:
        if self.latitude is not None:
            earth_rate_up_north(self.latitude.value)  # refuses an impossible latitude
        deviations = {"gravity": self.gravity.sd} | {
            name: value for name in STATED if (value := self.deviation(name)) is not None
        }
        require_possible_values("rate platform", {"gravity": self.gravity.value}, deviations)

    def deviation(self, name: str) -> float | None:
        """Return the standard deviation stated by a key, or None if the key is not stated."""
        return getattr(self, name)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The stated imperfections of the bench, as data."""
        stated = [one for name in STATED for one in self._components(name)]
        return (local_gravity(self.gravity), *stated, *self._earth())

    def _components(self, name: str) -> list[Parameter]:
        sd, one = self.deviation(name), STATED[name]
        if sd is None:
            return []
        names = [f"{name}_{k}" for k in one.components] or [name]
        stated = [Parameter(full, one.unit, sd, one.scope, 0.0, one.meaning) for full in names]
        return list(self.qualified.apply(stated))

    def _earth(self) -> list[Parameter]:
        if self.latitude is None:
            return []
        _, level = earth_rate_up_north(self.latitude.value)
        sd = level / sqrt(2) if level > _EXACT else 0.0
        text = "horizontal earth rate"
        scopes: dict[str, Scope] = {"earth": "mounting", "pose_earth": "position"}
        place = [_latitude_parameter(self.latitude)] if self.latitude.sd > 0 else []
        return place + [
            Parameter(f"{name}_{k}", "rad/s", sd, scope, 0.0, f"{text}, component {k}")
            for name, scope in scopes.items()
            for k in (1, 2)
        ]

    def nuisances(self, steps: Sequence[PlatformStep], sensor: Sensor) -> dict[str, Parameter]:
        """Return the parameters that act on these sections, by full name such as "setting_1[x]".

        Raises
        ------
        InputError
            An error acts but is not stated; the message names its key.
        """
        gyros = bool(sensor.select_axes("w").axes)
        forces = bool(sensor.select_axes("f").axes)
        if gyros and self.latitude is None:
            raise _missing("latitude", "48.1 °", "gyros sense the earth's rate")
        by_force = gyros and sensor.select_axes("w").uses("fi", "fp", "fo")
        _require_measured_rates(sensor, steps)
        self._require_stated(steps, gyros, by_force)
        acting = {"g": local_gravity(self.gravity)} if forces or by_force else {}
        if gyros and self.latitude is not None and self.latitude.sd > 0:
            acting["latitude"] = _latitude_parameter(self.latitude)
        acting |= dict(self._acting_places(steps, gyros, by_force))
        return acting

    def suspects(self, steps: Sequence[PlatformStep], sensor: Sensor) -> dict[str, Parameter]:
        """Return all parameters whose stated values may be wrong, by full name.

        In addition to the `nuisances`, these are parameters that are treated as exact: the
        latitude, and the change of the gyros' biases from setting to setting.
        """
        found = self.nuisances(steps, sensor)
        if self.latitude is None or not sensor.select_axes("w").axes:
            return found
        found["latitude"] = _latitude_parameter(self.latitude)
        exact = self if self.turn_on is not None else replace(self, turn_on=0.0)
        return found | exact.nuisances(steps, sensor)

    def _require_stated(self, steps: Sequence[PlatformStep], gyros: bool, by_force: bool) -> None:
        needed: dict[str, str] = {}
        rates, turns = _turning(steps) if gyros else ([], [])
        text = "the residuals do not show it, so it must be stated"
        if rates:
            needed |= dict.fromkeys(("rate_scale", "rate_asymmetry", "rate_stability"), text)
        if turns:
            needed["turn_angle"] = text
        if (rates or turns) and by_force:
            needed["arm"] = "the gyros' sensitivity to acceleration reacts to the centripetal one"
        if any(isinstance(step, RateDwell) for step in steps):
            needed["setting"] = "misalignments cannot be known better than the axis in the case"
        if any(isinstance(step, Pose) for step in steps):
            needed["attitude"] = "scale factors and misalignments cannot be known better"
            needed["mounting"] = "misalignments cannot be known better than the mounting"
        for name, reason in needed.items():
            if self.deviation(name) is None:
                raise _missing(name, STATED[name].example, reason)
        unknown = tuple(step.label for step in rates if not step.seconds)
        if self.angle_reading and unknown:
            key = "[data] seconds"
            raise key_error(
                key,
                "is missing: [bench] angle_reading is the error of the angle per dwell, but "
                f"{unknown[0]} has no duration; name the column of durations",
                names=unknown,
            )

    def _acting_places(
        self, steps: Sequence[PlatformStep], gyros: bool, by_force: bool
    ) -> Iterator[tuple[ErrorName, Parameter]]:
        """Yield the parameters that act, without gravity, in the order of their declaration."""
        dwells = [step for step in steps if isinstance(step, RateDwell)]
        rates, turns = _turning(steps) if gyros else ([], [])
        poses = [step.label for step in steps if isinstance(step, Pose)]
        settings = list(dict.fromkeys(step.place for step in dwells))
        partly = [step for step in dwells if abs(level_rate_factor(step)[0]) > _WHOLE]
        places: dict[str, Sequence[str]] = {
            "rate_scale": [""] if rates else [],
            "rate_asymmetry": [""] if rates else [],
            "rate_stability": [step.label for step in rates],
            "angle_reading": [step.label for step in rates],
            "rate_hysteresis": [""] if rates else [],
            "settling": [""] if rates else [],
            "turn_angle": [step.label for step in turns],
            "setting": settings,
            "arm": list(dict.fromkeys(s.place for s in (*rates, *turns))) if by_force else [],
            "turn_on": settings if gyros and len(settings) > 1 else [],
            "attitude": poses,
            "mounting": [""] if poses else [],
            "earth": list(dict.fromkeys(step.place for step in partly)) if gyros else [],
            "pose_earth": poses if gyros else [],
        }
        declared: dict[str, list[Parameter]] = {name: self._components(name) for name in STATED}
        for one in self._earth():
            declared.setdefault(one.name.rpartition("_")[0], []).append(one)
        for name, at in places.items():
            for place in at:
                for one in declared.get(name, []):
                    yield ErrorName.at(one.name, place) if place else ErrorName(one.name), one

    def mean_motion(self, steps: Sequence[PlatformStep], q: Mapping[str, Array]) -> MeanMotion:
        """Return the mean motion during each section; see `inercal.benches.contract.MeanBench`."""
        return sensed_motion(self, steps, q)

    def without_earth_rate(self) -> "RatePlatform":
        """Return the same bench on an earth that does not rotate."""
        return replace(self, latitude=None)


def _latitude_parameter(latitude: Measured) -> Parameter:
    return Parameter("latitude", "rad", latitude.sd, "run", latitude.value, "latitude")


def _turning(steps: Sequence[PlatformStep]) -> tuple[list[RateDwell], list[RateDwell]]:
    """Return the dwells at a rate, and the turns through a known angle."""
    dwells = [step for step in steps if isinstance(step, RateDwell) and step.rate != 0]
    turns: list[RateDwell] = [step for step in dwells if isinstance(step, KnownTurn)]
    return [step for step in dwells if step not in turns], turns


def _require_measured_rates(sensor: Sensor, steps: Sequence[PlatformStep]) -> None:
    """Refuse a rate beyond the full scale of a gyro."""
    for axis in sensor.select_axes("w").axes:
        reach = (axis.readout.full_scale or inf) / abs(axis.readout.scale)
        for step in _turning(steps)[0]:
            if abs(step.rate * np.dot(axis.i, step.up)) > reach:
                raise key_error(
                    "[sensor.gyro] full_scale",
                    f"is {degrees(reach):.4g} °/s, but {axis.name} must measure {step.label}; "
                    "choose lower rates, or correct full_scale",
                    names=(step.label,),
                )


def _missing(name: str, example: str, reason: str) -> InputError:
    key = f"[bench] {name}"
    return key_error(key, f'is missing: state it, such as "{example}"; {reason}')
