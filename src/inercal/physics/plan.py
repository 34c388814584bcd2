"""Plans: the steps that a simulated or real bench carries out.

Each step's label is the name of the corresponding section in the recording.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import acos, cos, degrees, inf, isfinite, pi, sin, sqrt
from typing import Literal, Protocol

from inercal.basics.errors import InputError

Vector = tuple[float, float, float]
_MOST_AXES = 3  # axes of a turntable
_NOTICED = 0.15  # component of a unit vector; `describe_direction` omits smaller ones
AXES: dict[str, Vector] = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


@dataclass(frozen=True)
class Hold:
    """Keep the sensor still with its body direction `up` (unit vector) pointing upwards."""

    label: str
    up: Vector
    seconds: float

    def describe(self) -> str:
        """Return the instruction for the operator: "−z up", "+z up, tilted 45° (+x rises)"."""
        main, tilted, rest = describe_direction(self.up).partition(" tilted ")
        return f"{main} up" + (f", {tilted.lstrip()}{rest}" if tilted else "")


@dataclass(frozen=True)
class Turn:
    """Turn the sensor about its body direction `axis` (unit vector) by `angle`, rad.

    The axis points vertically upwards; a positive angle is counter-clockwise when seen from above.
    """

    label: str
    axis: Vector
    angle: float
    seconds: float

    def describe(self) -> str:
        """Return the instruction for the operator: "turn by +360° about +z"."""
        return f"turn by {self.angle * 180 / pi:+.0f}° about {describe_direction(self.axis)}"


@dataclass(frozen=True)
class Attitude:
    """An attitude on a centrifuge arm: the outward and the upward direction in the body frame.

    `out` (unit vector) points from the spindle to the sensor, and `up` (unit vector, perpendicular
    to `out`) points along the spindle. Attitudes with different names are different mountings; ""
    means that the attitude has no name.
    """

    out: Vector
    up: Vector
    name: str = ""


@dataclass(frozen=True)
class Spin:
    """Turn the arm of a centrifuge at a steady `rate`, rad/s, with the sensor in one attitude.

    Parameters
    ----------
    label : str
    rate : float
        Rate of the arm relative to the ground, rad/s, with the bench's sign convention.
    seconds : float
        Duration of the dwell; 0 means an unknown number of whole turns.
    attitude : Attitude or None
        None if it is unknown: the norm of the readings does not depend on it.
    azimuth : float or None
        Azimuth of the arm, rad, if the row was measured at a single azimuth, as on a
        counter-rotating platform. None means that the row is the mean over the dwell.
    """

    label: str
    rate: float
    seconds: float = 0.0
    attitude: Attitude | None = None
    azimuth: float | None = None

    def describe(self) -> str:
        """Return the instruction: "spin at 60 rpm, +x outwards, −z up", "at rest, +z up"."""
        text = f"spin at {self.rate * 30 / pi:.4g} rpm".replace("-", "−")
        if self.rate == 0:
            text = "at rest"
        if self.attitude is None:
            return text
        return (
            f"{text}, {describe_direction(self.attitude.out)} outwards, "
            f"{describe_direction(self.attitude.up)} up"
        )


@dataclass(frozen=True)
class Index:
    """Turn a dividing head to an angle and hold it there.

    Parameters
    ----------
    label : str
    angle : float
        Angle of the head, rad.
    sense : 1 or -1
        Direction of the pass: 1 is forward, −1 is reverse.
    level : float
        Tilt of the base about the spindle, measured by a level on the base, rad, with the sign of
        `angle`.
    reading : float
        Autocollimator reading minus the reading at the nominal angle, rad, with the sign of
        `angle`.
    seconds : float
        Duration of the hold.

    Raises
    ------
    InputError
        An angle, a level or a reading is not finite.
    """

    label: str
    angle: float
    sense: Literal[1, -1] = 1
    level: float = 0.0
    reading: float = 0.0
    seconds: float = 0.0

    def __post_init__(self) -> None:
        for name in ("angle", "level", "reading"):
            if not isfinite(value := getattr(self, name)):
                raise _step_error(self, name, f"its {name} is {value}; it must be finite")

    def describe(self) -> str:
        """Return the instruction for the operator: "head at 30°, forward"."""
        return f"head at {degrees(self.angle):.6g}°, {'forward' if self.sense > 0 else 'reverse'}"


@dataclass(frozen=True)
class Position:
    """Move the axes of a turntable to given angles and hold them there.

    Parameters
    ----------
    label : str
    angles : tuple of 1 to 3 float
        Angles, rad, outermost axis first; each axis moves to the nearest equivalent angle.
    seconds : float
        Duration of the hold.

    Raises
    ------
    InputError
        There are not one to three angles, an angle is not finite, or the hold is not > 0.
    """

    label: str
    angles: tuple[float, ...]
    seconds: float

    def __post_init__(self) -> None:
        _refuse_angles(self, self.angles)
        if not 0 < self.seconds < inf:
            raise _step_error(
                self, "seconds", f"its duration is {self.seconds:.6g} s; it must be > 0"
            )

    def describe(self) -> str:
        """Return the instruction for the operator: "axes at 90°, 45°, 0°"."""
        return f"{'axes' if len(self.angles) > 1 else 'axis'} at {_format_degrees(self.angles)}"


@dataclass(frozen=True)
class Rotation:
    """Turn one axis of a turntable from its present angle, from rest to rest.

    Parameters
    ----------
    label : str
    axis : 0, 1 or 2
        The axis to turn; 0 is the outermost.
    angle : float
        Angle to turn by, rad, right-handed about the axis; it may be several turns.
    rate : float
        Rate during the steady part, rad/s, > 0; a turn that is too short does not reach it.
    angles : tuple of float or None
        Angles, rad, to which all axes are moved first; None leaves them at their present angles.

    Raises
    ------
    InputError
        There is no such axis, the angle is zero, the rate is not > 0, or a value is not finite.
    """

    label: str
    axis: int
    angle: float
    rate: float
    angles: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        if self.angles is not None:
            _refuse_angles(self, self.angles)
        if self.axis not in range(most := _MOST_AXES if self.angles is None else len(self.angles)):
            raise _step_error(self, "axis", f"its axis is {self.axis}; it must be 0 to {most - 1}")
        if not isfinite(self.angle) or self.angle == 0:
            raise _step_error(
                self, "angle", f"its angle is {self.angle}; it must be finite and not 0"
            )
        if not 0 < self.rate < inf:
            raise _step_error(self, "rate", f"its rate is {self.rate} rad/s; it must be > 0")

    @property
    def seconds(self) -> float:
        """Duration of the turn at its steady rate, without acceleration and deceleration, s."""
        return abs(self.angle) / self.rate

    def describe(self) -> str:
        """Return the instruction for the operator: "turn the outermost axis by +720° at 10 °/s"."""
        turn = f"turn the {('outermost', 'second', 'third')[self.axis]} axis by "
        turn += f"{degrees(self.angle):+.6g}° at {degrees(self.rate):.6g} °/s"
        return turn if self.angles is None else f"{turn}, from {_format_degrees(self.angles)}"


HandStep = Hold | Turn
TableStep = Position | Rotation
HandSteps = Sequence[HandStep]
TableSteps = Sequence[TableStep]
Spins = Sequence[Spin]
Indexings = Sequence[Index]


class Step(Protocol):
    """One step of a plan; a bench kind from another package may define its own steps."""

    @property
    def label(self) -> str:
        """The step's name in rows and recordings."""
        ...

    @property
    def seconds(self) -> float:
        """Duration, s; 0 if nothing depends on it."""
        ...

    def describe(self) -> str:
        """Return the instruction for the operator, in words."""
        ...


def table_steps(steps: Iterable[Step]) -> list[TableStep]:
    """Return the positions and rotations of a plan; on a turntable these are all of its steps."""
    return [step for step in steps if isinstance(step, Position | Rotation)]


def _refuse_angles(step: Step, angles: tuple[float, ...]) -> None:
    if not 1 <= len(angles) <= _MOST_AXES:
        text = f"it has {len(angles)} angles; a turntable has one to three axes"
        raise _step_error(step, "angles", text)
    if not all(map(isfinite, angles)):
        raise _step_error(step, "angles", f"its angles are {angles}; each must be finite")


def _step_error(step: Step, key: str, text: str) -> InputError:
    """Return the error for a field of a step: "position p1: seconds is 0; it must be > 0"."""
    kind = "rotation" if isinstance(step, Rotation) else "position"
    return InputError(f"{kind} {step.label}: {text}", key=key, names=(step.label,))


def _format_degrees(angles: tuple[float, ...]) -> str:
    return ", ".join(f"{degrees(angle):.6g}°" for angle in angles)


def describe_direction(vector: Vector) -> str:
    """Describe a body direction by its nearest axis and by the axes that rise when it points up.

    >>> describe_direction((0.0, 0.0, -1.0))
    '−z'
    >>> describe_direction((0.7071, 0.0, 0.7071))
    '+z tilted 45° (+x rises)'
    """
    # If components are equal, the last axis is the main axis: most housings lie with z up.
    names = [
        (("+" if part > 0 else "−") + name, abs(part))
        for part, name in zip(vector[::-1], reversed(AXES), strict=True)
    ]
    (main, size), *others = sorted(names, key=lambda pair: -round(pair[1], 6))
    length = sqrt(sum(part**2 for part in vector))
    angle = degrees(acos(min(size / length, 1.0)))
    rising = [name for name, part in others if part > _NOTICED * length]
    if not rising or round(angle) == 0:
        return main
    verb = "rises" if len(rising) == 1 else "rise"
    return f"{main} tilted {angle:.0f}° ({' and '.join(rising)} {verb})"


def arm_attitude(psi: float, theta: float) -> Attitude:
    """Return the attitude of a two-axis dividing head on the arm, at the angles ψ and θ, rad.

    In the body frame the outward direction is (cos ψ cos θ, sin ψ, cos ψ sin θ) and the upward
    direction is (sin θ, 0, −cos θ). These are the positions in Wang and Li 2021.
    """
    out = (cos(psi) * cos(theta), sin(psi), cos(psi) * sin(theta))
    return Attitude(out, (sin(theta), 0.0, -cos(theta)))


def small_loop(changes: Iterable[float]) -> list[float]:
    """Return a loop through small changes of the input, up, down and up again to zero.

    >>> small_loop((1.0, 2.0))
    [0.0, 1.0, 2.0, 1.0, 0.0, -1.0, -2.0, -1.0, 0.0]
    """
    rising = sorted(changes)
    half = [0.0, *rising, *rising[-2::-1], 0.0]
    return [*half, *(0.0 - change for change in half[1:])]


def with_second_azimuths(steps: Iterable[HandStep]) -> list[HandStep]:
    """Return the steps, and each hold again at another azimuth, as magnetometers need it.

    Raises
    ------
    InputError
        The plan already repeats positions.
    """
    first = list(steps)
    if any(step.label.endswith(" (2)") for step in first):
        raise InputError(
            "with magnetometers, the plan repeats each position once; remove positions",
            key="[method] positions",
        )
    again = (replace(step, label=f"{step.label} (2)") for step in first if isinstance(step, Hold))
    return [*first, *again]


def six_positions(seconds: float = 10.0, positions: int = 6) -> tuple[Hold, ...]:
    """Return the six holds x_p, x_a, y_p, …, in which each axis points up (p), then down (a).

    Further positions are second visits in the reverse order, "z_a (2)", "z_p (2)", …, and so on.

    Raises
    ------
    InputError
        There are fewer than six positions.
    """
    if positions < 6:
        raise InputError(
            f"positions is {positions}, but a six-position test needs 6 or more",
            key="[method] positions",
        )
    holds: list[Hold] = []
    for name, (x, y, z) in AXES.items():
        holds += [Hold(name + "_p", (x, y, z), seconds), Hold(name + "_a", (-x, -y, -z), seconds)]
    while len(holds) < positions:
        back = holds[-1 - 2 * (len(holds) % 6)]  # the last one, the one before it, …
        face = back.label.partition(" ")[0]
        holds.append(replace(back, label=f"{face} ({len(holds) // 6 + 1})"))
    return tuple(holds)


def ferraris_plan(
    seconds: float = 10.0, angle: float | tuple[float, ...] = 2 * pi, turn_seconds: float = 8.0
) -> tuple[HandStep, ...]:
    """Return the six holds followed by the turns x_rot, y_rot, z_rot (Ferraris et al. 1995).

    Parameters
    ----------
    seconds, turn_seconds : float
        Duration of each hold and of each turn.
    angle : float or tuple of 3 float
        Angle of all turns, or the angles of the turns about x, y and z, rad.

    Raises
    ------
    InputError
        The number of angles is neither one nor three.
    """
    angles = angle if isinstance(angle, tuple) else (angle,) * len(AXES)
    if len(angles) != len(AXES):
        raise InputError(
            f"turn has {len(angles)} angles; give one for all turns, or three for the turns about "
            "x, y and z",
            key="[method] turn",
        )
    turns = [
        Turn(f"{name}_rot", axis, of_axis, turn_seconds)
        for (name, axis), of_axis in zip(AXES.items(), angles, strict=True)
    ]
    return (*six_positions(seconds), *turns)
