"""Sections of a run on a rate platform: rests, constant rates and turns in a setting, and poses.

The table's axis is vertical. A setting is one way to fix the case on the table, with a case axis
pointing up. The rate is positive counter-clockwise seen from above, so with −z up the z gyro reads
a negative rate.

A pose is a rest at known angles from level. The case is turned right-handed about its x axis by the
roll, then about the horizontal y axis by the pitch. The upward direction is then::

    u = (−sin pitch, cos pitch sin roll, cos pitch cos roll)
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, degrees, pi, radians, sin

from inercal.basics.errors import InputError
from inercal.physics.plan import AXES, Vector, describe_direction
from inercal.recordings.data.rest_marks import parse_face

SMALL_RATE = radians(2.0)  # rad/s: the largest change of a rate that shows threshold and resolution
_NUMBER = r"[-+−]?\d+(?:\.\d+)?(?:e-?\d+)?"
_COUNT = r"(?:\s*\(\d+\))?"
_DWELL = re.compile(rf"([-+−]?[xyz])\s+(?:(rest)|({_NUMBER})\s*(?:°/s)?){_COUNT}")
_TURN = re.compile(rf"([-+−]?[xyz])\s+turn\s+({_NUMBER})\s*°?{_COUNT}")
_POSE = re.compile(rf"roll\s+({_NUMBER})\s*°?,?\s+pitch\s+({_NUMBER})\s*°?{_COUNT}")


@dataclass(frozen=True)
class RateDwell:
    """Turn the table at a constant rate, or rest, with a case axis up.

    Parameters
    ----------
    label : str
    axis : str
        Case axis that points up: "x", "-x", "y", "-y", "z" or "-z".
    rate : float
        Rate about the upward vertical, rad/s; 0 means a rest.
    seconds : float
        Duration, s; 0 means an unknown number of whole turns.
    setting : str
        Name of the setting, by default the axis. Dwells in one setting share its errors.
    """

    label: str
    axis: str
    rate: float
    seconds: float = 0.0
    setting: str = ""

    @property
    def place(self) -> str:
        """Name of the setting."""
        return self.setting or self.axis

    @property
    def up(self) -> Vector:
        """Case direction that points up."""
        x, y, z = AXES[self.axis[-1]]
        sign = -1.0 if self.axis.startswith("-") else 1.0
        return (sign * x, sign * y, sign * z)

    def describe(self) -> str:
        """Describe the dwell for the operator, such as "+z up, turn at −50°/s"."""
        turn = "rest" if self.rate == 0 else f"turn at {_signed(degrees(self.rate))}°/s"
        return f"{describe_direction(self.up)} up, {turn}"


@dataclass(frozen=True)
class KnownTurn(RateDwell):
    """Turn the table through a known angle, from rest to rest, with a case axis up.

    The rate is the mean rate, which is the angle divided by the duration.
    """

    @property
    def angle(self) -> float:
        """Angle of the turn, rad, positive counter-clockwise seen from above."""
        return self.rate * self.seconds

    def describe(self) -> str:
        """Describe the turn for the operator, such as "+z up, turn by −360°"."""
        return f"{describe_direction(self.up)} up, turn by {_signed(degrees(self.angle))}°"


@dataclass(frozen=True)
class Pose:
    """Rest at known angles from level.

    Parameters
    ----------
    label : str
    roll, pitch : float
        Roll and pitch as defined in the module, rad.
    seconds : float
        Duration, s; 0 if nothing depends on it.
    """

    label: str
    roll: float
    pitch: float
    seconds: float = 0.0

    @property
    def up(self) -> Vector:
        """Case direction that points up."""
        return (
            -sin(self.pitch),
            cos(self.pitch) * sin(self.roll),
            cos(self.pitch) * cos(self.roll),
        )

    def describe(self) -> str:
        """Describe the pose for the operator, such as "roll 90°, pitch 0°"."""
        return f"roll {degrees(self.roll):.6g}°, pitch {degrees(self.pitch):.6g}°"


PlatformStep = RateDwell | Pose
PlatformSteps = Sequence[PlatformStep]


def dwell_label(axis: str, rate: float) -> str:
    """Return the label of a dwell, such as "x +50 °/s" or "-y rest"."""
    return f"{axis} rest" if rate == 0 else f"{axis} {degrees(rate):+.6g} °/s"


def turn_label(axis: str, angle: float) -> str:
    """Return the label of a turn through an angle in rad, such as "x turn +360°"."""
    return f"{axis} turn {degrees(angle):+.6g}°"


def pose_label(roll: float, pitch: float) -> str:
    """Return the label of a pose, such as "roll 90° pitch 0°"."""
    return f"roll {degrees(roll) + 0.0:.6g}° pitch {degrees(pitch) + 0.0:.6g}°"


def step_of_label(label: str, seconds: float) -> PlatformStep:
    """Return the section that a label describes.

    Parameters
    ----------
    label : str
        Label such as "x +50 °/s", "-y rest", "x turn +360°" or "roll 90° pitch 0°". A repetition
        has a number, as in "x rest (2)". In file names a space may be "_", a decimal point a comma,
        and a sign a dash.
    seconds : float
        Duration of the section, s.

    Raises
    ------
    InputError
        The label does not describe a section.
    """
    text = re.sub(r"(?<=\d),(?=\d)", ".", label.replace("_", " ").replace("–", "-").strip())
    if (found := _DWELL.fullmatch(text)) is not None:
        axis = parse_face(found[1])
        assert axis is not None
        return RateDwell(label, axis, 0.0 if found[2] else radians(_number(found[3])), seconds)
    if (found := _TURN.fullmatch(text)) is not None:
        axis = parse_face(found[1])
        assert axis is not None
        return KnownTurn(label, axis, radians(_number(found[2])) / seconds, seconds)
    if (found := _POSE.fullmatch(text)) is not None:
        return Pose(label, radians(_number(found[1])), radians(_number(found[2])), seconds)
    raise InputError(
        f'label {label!r} does not describe a section; write a rate as "x +50" (x up, 50 °/s), '
        'a rest as "-y rest", a turn as "x turn +360", or a pose as "roll 90 pitch 0"',
        names=(label,),
    )


def whole_turns(rate: float, seconds: float) -> float:
    """Return the longest time of whole turns within a time, s; at rest, the time itself."""
    turns = abs(rate) * seconds // (2 * pi)
    return seconds if rate == 0 or turns == 0 else turns * 2 * pi / abs(rate)


def _number(text: str) -> float:
    return float(text.replace("−", "-"))


def _signed(value: float) -> str:
    return f"{value:+.6g}".replace("-", "−")
