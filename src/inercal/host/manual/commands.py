"""Defines the manual commands of an operator, and converts them from and to JSON.

Each command has a fixed set of fields. The page sends JSON objects in degrees and seconds, which
this module converts to commands in SI. The session (`manual.session`) decides whether the table can
execute them.

    {"what": "servo", "axis": "inner", "on": true}
    {"what": "home", "axis": "inner"}
    {"what": "go", "axis": "inner", "angle": 30, "rate": 10}            °, °/s
    {"what": "jog", "axis": "inner", "rate": -5, "press": 7}            °/s, signed
    {"what": "hold", "press": 7}                                        while the key is held
    {"what": "release"}                                                 the key is up
    {"what": "halt"}                                                    all axes
"""

from collections.abc import Callable, Mapping
from math import degrees, radians
from typing import Any, NamedTuple

from inercal.basics.errors import InputError

_MAX_NAME = 40  # largest number of characters in the name of an axis
_MAX_NUMBER = 1e6  # ° and °/s
_MAX_PRESS = 1 << 53  # up to this, every JSON reader represents integers exactly


class ServoCommand(NamedTuple):
    """Switch the servo of an axis on or off."""

    axis: str
    on: bool

    def __str__(self) -> str:
        return f"axis {self.axis}: servo {'on' if self.on else 'off'}"


class HomeAxisCommand(NamedTuple):
    """Find the zero position of an axis."""

    axis: str

    def __str__(self) -> str:
        return f"axis {self.axis}: home"


class GoCommand(NamedTuple):
    """Move an axis to an angle (rad) at a rate (rad/s)."""

    axis: str
    angle: float
    rate: float

    def __str__(self) -> str:
        return f"axis {self.axis}: go to {degrees(self.angle):.6g}° at {degrees(self.rate):.6g} °/s"


class JogCommand(NamedTuple):
    """Turn an axis at a signed rate (rad/s) as long as a numbered key press is held."""

    axis: str
    rate: float
    press: int

    def __str__(self) -> str:
        return f"axis {self.axis}: jog at {degrees(self.rate):+.6g} °/s"


class HoldCommand(NamedTuple):
    """Report that a numbered key press is still held."""

    press: int


class ReleaseCommand(NamedTuple):
    """Stop the axis that is being jogged."""

    def __str__(self) -> str:
        return "the key is released"


class HaltCommand(NamedTuple):
    """Stop and hold all axes."""

    why: str = ""

    def __str__(self) -> str:
        return f"halt all axes: {self.why}" if self.why else "halt all axes"


AxisCommand = ServoCommand | HomeAxisCommand | GoCommand | JogCommand
ManualCommand = AxisCommand | HoldCommand | ReleaseCommand | HaltCommand


def parse_command(fields: Mapping[str, Any]) -> ManualCommand:
    """Convert a JSON object to a command.

    Raises
    ------
    InputError
        The command is unknown, or a field is missing, unknown or of the wrong type.
    """
    what = fields.get("what")
    if not isinstance(what, str) or what not in _COMMANDS:
        raise InputError(
            f"no manual command {str(what)[:_MAX_NAME]!r}; possible: {', '.join(_COMMANDS)}",
            key="what",
        )
    kind, checks = _COMMANDS[what]
    given = set(fields) - {"what"}
    if given != set(checks):
        listed = ", ".join(checks) or "no more fields"
        raise InputError(
            f"{what} takes {listed}", key=what, names=tuple(sorted(given ^ set(checks)))
        )
    return kind(*(check(name, fields[name]) for name, check in checks.items()))


def command_fields(command: ManualCommand) -> dict[str, Any]:
    """Convert a command to a JSON object, as the inverse of `parse_command`."""
    for what, (kind, fields) in _COMMANDS.items():
        if isinstance(command, kind):
            values = command._asdict()
            return {"what": what} | {
                name: degrees(values[name]) if check is _number else values[name]
                for name, check in fields.items()
            }
    raise TypeError(command)


def _axis(key: str, value: object) -> str:
    if not (isinstance(value, str) and 0 < len(value) <= _MAX_NAME and value.isprintable()):
        raise InputError(f"{key}: give the name of an axis", key=key)
    return value


def _number(key: str, value: object) -> float:
    if (
        isinstance(value, bool)
        or not isinstance(value, (int, float))
        or not abs(value) <= _MAX_NUMBER  # also true for NaN
    ):
        raise InputError(
            f"{key}: give a number from {-_MAX_NUMBER:g} to {_MAX_NUMBER:g} (in degrees and "
            "seconds)",
            key=key,
        )
    return radians(value)


def _switch(key: str, value: object) -> bool:
    if not isinstance(value, bool):
        raise InputError(f"{key}: give true or false", key=key)
    return value


def _press(key: str, value: object) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < _MAX_PRESS:
        raise InputError(f"{key}: give a whole number of at least 0", key=key)
    return value


_Check = Callable[[str, object], Any]
_COMMANDS: dict[str, tuple[type[Any], dict[str, _Check]]] = {
    "servo": (ServoCommand, {"axis": _axis, "on": _switch}),
    "home": (HomeAxisCommand, {"axis": _axis}),
    "go": (GoCommand, {"axis": _axis, "angle": _number, "rate": _number}),
    "jog": (JogCommand, {"axis": _axis, "rate": _number, "press": _press}),
    "hold": (HoldCommand, {"press": _press}),
    "release": (ReleaseCommand, {}),
    "halt": (HaltCommand, {}),
}
