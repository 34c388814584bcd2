"""Describe a bench without equipment: the housing rests on its faces and is turned by hand.

In the body frame, the upward direction is tilted from its nominal direction by two small tangents
t₁, t₂ along d₁, d₂ ⟂ up::

    hold    f = g u,   u = (up + t₁ d₁ + t₂ d₂) / norm
            ω = Ω sin φ u + (e₁ + v₁) d₁ + (e₂ + v₂) d₂ + β    (earth rate; azimuth unknown)
    turn    mean ω = (α + δα) n / (T (1 + τ)) + Ω sin φ f̄ / g + β,   n is tilted in the same way
            (the horizontal earth rate rotates in the body and is neglected: it causes a
            misalignment of at most Ω cos φ T / |α|, 14″ for a full turn in 8 s)
            mean f = f̄, as the accelerometers measured it

A fixture gives a face the same azimuth at each visit, and a hand gives it another one, so repeated
visits share e₁ and e₂ and each has its own v₁ and v₂; a single visit has none.

β is the change of the gyros' biases from step to step, if each step is a separate recording.

Every symbol except the nominal values is a `Parameter`: a simulation draws it, and a calibration
estimates it as a nuisance. Ω is the earth's rate, φ the latitude, and T the turn's duration on the
recording's clock.
"""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from math import pi, radians, sqrt
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from inercal.basics.arrays import Array, row_products
from inercal.basics.parameters import NOT_QUALIFIED, Parameter, QualifiedParameters, local_gravity
from inercal.basics.units import Measured
from inercal.benches.contract import MeanMotion, NoReadingOffsets, stack_derivatives
from inercal.benches.key_declarations import declared_parameters, deviation
from inercal.physics.earth import EARTH_RATE, earth_rate_up_north
from inercal.physics.frames import stack_components
from inercal.physics.motion import Motion
from inercal.physics.plan import HandStep, Hold, Turn
from inercal.physics.section_settings import Limit
from inercal.physics.sensors import Sensor

DEGREE = pi / 180
_TURN_ON = tuple(f"turn_on_{a}" for a in "xyz")
_PLACEMENT = ("placement1", "placement2")
_AZIMUTH = ("earth1", "earth2")
_REVISIT = ("earth_visit1", "earth_visit2")
_VISIT = re.compile(r" \((\d+)\)$")  # end of a label for a repeated visit, "x_p (2)"
_NEAR_EQUATOR = radians(20)  # the magnetic equator is up to 15° away from the equator
_CLEAR = 3.0  # standard uncertainties
_SKEW = Limit(20 * DEGREE, "a face or an axis can err, 20°")


@dataclass(frozen=True)
class Hand(NoReadingOffsets):
    """A sensor moved by hand on a table, as a bench. Standard deviations are in rad or ratios.

    Parameters
    ----------
    gravity : Measured
        Local gravity, m/s².
    latitude : Measured, float or None
        Latitude, rad; a plain number is treated as exact. None means that the latitude is unknown;
        both components of the earth's rate are then nuisances.
    tilt : float
        Standard deviation of the tilt of a face's normal from the vertical, about each of two
        directions, rad.
    placement : float
        Standard deviation of the additional tilt each time the sensor is set down on the face, rad.
        If it is 0, each visit to a position has its own tilt; otherwise all visits share the tilt
        of the face.
    turn_angle : float
        Standard deviation of the angle of a turn, rad.
    turn_tilt : float
        Standard deviation of the tilt of a turn's axis from the body axis, about each of two
        directions, rad.
    timebase : float
        Relative standard deviation of the recording's clock.
    turn_on : float
        Standard deviation of each component of β, rad/s; 0 if the gyros stay switched on.
    field : Measured or None
        Strength of the magnetic field at the bench, T; None if it is unknown.
    dip : Measured or None
        Angle of the field below the horizontal plane, rad; None if it is unknown.
    hemisphere : "north", "south" or None
        "north" if the field points downwards, "south" if it points upwards.
    qualified : QualifiedParameters
        Results of qualifications, which replace stated values.
    """

    gravity: Measured
    latitude: Measured | float | None = None
    tilt: float = deviation(
        "°",
        "0.5 °",
        {f"tilt{k}": "tilt of a face from the vertical" for k in (1, 2)},
        scope="position",
        default=0.5 * DEGREE,
        limit=_SKEW,
    )
    placement: float = deviation(
        "°",
        "0 °",
        dict.fromkeys(_PLACEMENT, "tilt when set down on a face"),
        scope="position",
        example="0.01 °",
        limit=_SKEW,
    )
    turn_angle: float = deviation(
        "°", "1 °", {"angle": "angle of the turn"}, scope="turn", default=1.0 * DEGREE
    )
    turn_tilt: float = deviation(
        "°",
        "0.5 °",
        {f"axis{k}": "axis of the turn in the body" for k in (1, 2)},
        scope="turn",
        default=0.5 * DEGREE,
        limit=_SKEW,
    )
    timebase: float = deviation("1", "100 ppm", "clock of the recording", default=1e-4)
    turn_on: float = deviation(
        "°/s",
        "0 °/h",
        dict.fromkeys(_TURN_ON, "gyros' bias in a recording"),
        scope="position",
        example="60 °/h",
    )
    field: Measured | None = None
    dip: Measured | None = None
    hemisphere: Literal["north", "south"] | None = None
    qualified: QualifiedParameters = NOT_QUALIFIED

    @property
    def dip_sign(self) -> int:
        """1 if the magnetic field points downwards, −1 if it points upwards, 0 if unknown.

        It follows from the hemisphere, from the dip, or from a latitude far from the equator.
        """
        if self.hemisphere is not None:
            return 1 if self.hemisphere == "north" else -1
        known = self.dip, self.place
        for one, nearest in zip(known, (0.0, _NEAR_EQUATOR), strict=True):
            if one is not None and abs(one.value) > max(nearest, _CLEAR * one.sd):
                return 1 if one.value > 0 else -1
        return 0

    @property
    def place(self) -> Measured | None:
        """The latitude with its uncertainty, rad; None if it is unknown."""
        if self.latitude is None or isinstance(self.latitude, Measured):
            return self.latitude
        return Measured(self.latitude, 0.0)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The imperfections of the bench, as data."""
        return self._parameters

    @cached_property
    def _parameters(self) -> tuple[Parameter, ...]:
        # If a vector's length is known but not its direction, the rms of each component is
        # length/√3.
        up, level = 0.0, EARTH_RATE / sqrt(3)
        up_sd, assumed = EARTH_RATE / sqrt(3), ""
        if (place := self.place) is not None:
            up, north = earth_rate_up_north(place.value)
            level = abs(north) / sqrt(2)  # the azimuth is unknown
            up_sd, assumed = abs(north) * place.sd, place.key_if_assumed("latitude")
        stated = (
            local_gravity(self.gravity),
            *declared_parameters(self, "tilt", "placement"),
            Parameter("earth_up", "rad/s", up_sd, "run", up, "earth rate, vertical", assumed),
            Parameter("earth1", "rad/s", level, "position", 0.0, "earth rate, level"),
            Parameter("earth2", "rad/s", level, "position", 0.0, "earth rate, level"),
            *(Parameter(n, "rad/s", level, "position", 0.0, "earth rate, visit") for n in _REVISIT),
            *declared_parameters(self, "turn_angle", "turn_tilt", "timebase", "turn_on"),
        )
        return self.qualified.apply(stated)

    def nuisances(self, steps: Sequence[HandStep], sensor: Sensor) -> dict[str, Parameter]:
        """Return the parameters that act on these steps, by full name such as "tilt1[x_p]".

        Parameters
        ----------
        steps : sequence of HandStep
        sensor : Sensor
            The sensor. If it has no gyros, the earth's rate and the clock have no effect.
        """
        return self.acting_parameters(
            steps, rates=any(axis.measures == "w" for axis in sensor.axes)
        )

    def turn_on_biases(self, steps: Sequence[HandStep], sensor: Sensor) -> dict[str, Parameter]:
        """Return the gyro biases for each section; they are exactly zero if none are stated."""
        switched = replace(self, turn_on=self.turn_on or 1.0).nuisances(steps, sensor)
        return {
            name: one if self.turn_on else replace(one, sd=0.0)
            for name, one in switched.items()
            if one.name in _TURN_ON
        }

    def acting_parameters(self, steps: Sequence[HandStep], *, rates: bool) -> dict[str, Parameter]:
        """Return the parameters that act on these steps, by full name.

        Parameters
        ----------
        steps : sequence of HandStep
        rates : bool
            Whether angular rates are observed.
        """
        found: dict[str, Parameter] = {}
        turns = any(isinstance(step, Turn) for step in steps)
        visits = Counter(face_label(step.label) for step in steps)
        for parameter in self.parameters:
            own = parameter.name in _TURN_ON
            if own and not self.turn_on:
                continue
            if parameter.name in _PLACEMENT and not self.placement:
                continue
            if not rates and (own or parameter.name.startswith(("earth", "timebase"))):
                continue
            if parameter.name == "timebase" and not turns:
                continue
            if parameter.scope == "run":
                found[parameter.name] = parameter
                continue
            found |= {
                f"{parameter.name}[{self._place(parameter.name, step)}]": parameter
                for step in steps
                if (own or isinstance(step, Turn) == (parameter.scope == "turn"))
                and (parameter.name not in _REVISIT or visits[face_label(step.label)] > 1)
            }
        return found

    def _place(self, name: str, step: HandStep) -> str:
        """Return the label of a parameter; visits to a face share its azimuth and perhaps tilt."""
        shared = name in _AZIMUTH or (self.placement and name.startswith("tilt"))
        return face_label(step.label) if shared else step.label

    def tilt_names(self, step: HandStep) -> list[str]:
        """Return the full names of the two tangents that tilt the step's up or axis most."""
        if isinstance(step, Turn):
            return [f"axis{k}[{step.label}]" for k in (1, 2)]
        return [f"tilt{k}[{self._place('tilt', step)}]" for k in (1, 2)]

    def mean_motion(self, steps: Sequence[HandStep], q: Mapping[str, Array]) -> MeanMotion:
        """Return the mean motion during each step; see `inercal.benches.contract.MeanBench`.

        The mean specific force during a turn is "force_x[LABEL]" and so on in q. If it is missing,
        it is gravity along the turn's axis, which points up.
        """
        stated = {
            name: np.array(p.value) for name, p in self.acting_parameters(steps, rates=True).items()
        }
        rows = [_step_motion(step, stated | dict(q)) for step in steps]
        vectors = np.broadcast_arrays(*(row.f for row in rows), *(row.w for row in rows))
        f, w = vectors[: len(rows)], vectors[len(rows) :]
        shape = vectors[0].shape
        return MeanMotion(
            Motion(np.stack(f, axis=-2), np.stack(w, axis=-2)),
            stack_derivatives([row.df for row in rows], shape),
            stack_derivatives([row.dw for row in rows], shape),
        )


def face_label(label: str) -> str:
    """Return the label of a position without the number of the visit: "x_p" for "x_p (2)"."""
    return _VISIT.sub("", label)


def visit_number(label: str) -> int:
    """Return the number of the visit in a label, counted from 1: 2 for "x_p (2)"."""
    found = _VISIT.search(label)
    return 1 if found is None else int(found[1])


def tangent_vectors(up: ArrayLike) -> Array:
    """Return unit vectors d₁, d₂ with d₁ × d₂ = up, (..., 2, 3), for a unit vector up, (..., 3)."""
    vertical = np.asarray(up, dtype=float)
    helper = np.eye(3)[np.argmin(np.abs(vertical), axis=-1)]
    first: Array = np.asarray(np.cross(helper, vertical), dtype=float)
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    return np.stack([first, np.cross(vertical, first)], axis=-2)


_cached_tangents = lru_cache(tangent_vectors)


def tilted_direction(up: tuple[float, float, float], t: Array) -> tuple[Array, Array]:
    """Tilt `up` by tangents t, (..., 2); return u, (..., 3), and du/dt, (..., 3, 2)."""
    d = _cached_tangents(up)
    norm = np.sqrt(1 + (t**2).sum(-1))[..., None]
    u = (np.asarray(up) + row_products(t, d)) / norm
    return u, (d.T - u[..., :, None] * t[..., None, :] / norm[..., None]) / norm[..., None]


def sensed_motion(step: HandStep, duration: float, q: Mapping[str, Array]) -> MeanMotion:
    """Return the mean motion of the sensor during one step, as arrays of shape (..., 3).

    Parameters
    ----------
    step : HandStep
    duration : float
        Duration of the section on the recording's clock, s.
    q : mapping of str to (...) array
        Nuisances, SI, by full name; missing nuisances are zero. The mean specific force during a
        turn is "force_x[LABEL]", "force_y[LABEL]", "force_z[LABEL]".
    """
    return _hold_motion(step, q) if isinstance(step, Hold) else _turn_motion(step, duration, q)


def _step_motion(step: HandStep, q: Mapping[str, Array]) -> MeanMotion:
    """Return the motion during a step; an unknown force in a turn is gravity along its axis."""
    names = [f"force_{a}[{step.label}]" for a in "xyz"]
    if isinstance(step, Hold) or names[0] in q:
        return sensed_motion(step, step.seconds, q)
    n, dn = tilted_direction(step.axis, _parameter_pair(q, "axis", step.label))
    g = q["g"][..., None]
    force = g * n
    result = sensed_motion(
        step, step.seconds, {**q, **{k: force[..., i] for i, k in enumerate(names)}}
    )
    by_force: dict[str, Array] = {"g": n}
    by_force |= {f"axis{k + 1}[{step.label}]": g * dn[..., k] for k in range(2)}
    df = {name: by for name, by in result.df.items() if name not in names} | by_force
    dw = {name: by for name, by in result.dw.items() if name not in names}
    for name, by in by_force.items():
        along = sum((by[..., [i]] * result.dw[k] for i, k in enumerate(names)), np.zeros(3))
        dw[name] = dw.get(name, np.zeros(3)) + along
    return MeanMotion(result.motion, df, dw)


def _parameter_pair(q: Mapping[str, Array], name: str, label: str) -> Array:
    zero = np.zeros(())
    return stack_components(*(q.get(f"{name}{k}[{label}]", zero) for k in (1, 2)))


def _lean_names(q: Mapping[str, Array], label: str) -> list[str]:
    """Return the names of the pairs of tangents whose sum is the tilt of a hold."""
    own = [f"{name}[{label}]" for name in _PLACEMENT]
    if own[0] not in q:
        return [f"tilt{k}[{label}]" for k in (1, 2)]
    return [*(f"tilt{k}[{face_label(label)}]" for k in (1, 2)), *own]


def hold_tilt(q: Mapping[str, Array], label: str) -> Array:
    """Return the tangents of a hold, (..., 2): the sum of face tilt and placement tilt."""
    zero = np.zeros(())
    parts = [q.get(name, zero) for name in _lean_names(q, label)]
    parts = np.broadcast_arrays(*parts)
    return sum((np.stack(parts[k : k + 2], axis=-1) for k in range(0, len(parts), 2)), zero)


def _hold_motion(step: Hold, q: Mapping[str, Array]) -> MeanMotion:
    label = step.label
    names = _lean_names(q, label)
    u, du = tilted_direction(step.up, hold_tilt(q, label))
    d = _cached_tangents(step.up)
    g = q["g"][..., None]
    up_rate = q.get("earth_up", np.zeros(()))[..., None]
    azimuth = [f"{name}[{face_label(label)}]" for name in _AZIMUTH]
    azimuth += [own for name in _REVISIT if (own := f"{name}[{label}]") in q]
    level = _parameter_pair(q, "earth", face_label(label)) + _parameter_pair(
        q, "earth_visit", label
    )
    df = {"g": u} | {name: g * du[..., k % 2] for k, name in enumerate(names)}
    dw = {"earth_up": u} | {name: up_rate * du[..., k % 2] for k, name in enumerate(names)}
    dw |= {name: np.broadcast_to(d[k % 2], u.shape) for k, name in enumerate(azimuth)}
    own = _own_bias(q, label, u.shape, dw)
    return MeanMotion(Motion(g * u, up_rate * u + row_products(level, d) + own), df, dw)


def _own_bias(
    q: Mapping[str, Array], label: str, shape: tuple[int, ...], dw: dict[str, Array]
) -> Array:
    """Return β for a step, (..., 3), and add its derivatives to `dw`."""
    names = [f"{name}[{label}]" for name in _TURN_ON]
    if names[0] not in q:
        return np.zeros(3)
    dw |= {n: np.broadcast_to(row, shape) for n, row in zip(names, np.eye(3), strict=True)}
    return stack_components(*(q[name] for name in names))


def _turn_motion(step: Turn, duration: float, q: Mapping[str, Array]) -> MeanMotion:
    label = step.label
    zero = np.zeros(())
    n, dn = tilted_direction(step.axis, _parameter_pair(q, "axis", label))
    clock = 1 + q.get("timebase", zero)[..., None]
    rate = (step.angle + q.get(f"angle[{label}]", zero))[..., None] / (duration * clock)
    force = stack_components(*(q[f"force_{a}[{label}]"] for a in "xyz"))
    g = q["g"][..., None]
    up_rate = q.get("earth_up", zero)[..., None]
    df = {
        f"force_{a}[{label}]": np.broadcast_to(row, force.shape)
        for a, row in zip("xyz", np.eye(3), strict=True)
    }
    dw = {f"force_{a}[{label}]": up_rate / g * row for a, row in zip("xyz", np.eye(3), strict=True)}
    dw |= {
        f"angle[{label}]": n / (duration * clock),
        "timebase": -rate * n / clock,
        "earth_up": force / g,
        "g": -up_rate * force / g**2,
    }
    dw |= {f"axis{k + 1}[{label}]": rate * dn[..., k] for k in range(2)}
    own = _own_bias(q, label, force.shape, dw)
    return MeanMotion(Motion(force, rate * n + up_rate * force / g + own), df, dw)
