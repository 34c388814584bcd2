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

Checks an operator's command to an axis, and converts it to a command for the table.

The narrower of the limits in the run file's [bench] and in the controller apply. A jog toward a
soft limit is executed as a move that ends `LIMIT_MARGIN` before the limit, because the controller
then stops the axis there.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import degrees, inf, isfinite, nan, radians
from typing import Any, Literal, NamedTuple

from inercal.basics.errors import InputError
from inercal.benches.motion_control import AxisMotionLimits
from inercal.host import sequencer
from inercal.host.drivers import rotary_table
from inercal.host.drivers.rotary_table import AxisLimits, AxisState, Feature, TableFault, TableState

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


Activity = Literal["idle", "home", "go", "jog", "stop"]


@dataclass(frozen=True)
class AxisTask:
    """The last manual command to an axis.

    Parameters
    ----------
    activity : "idle", "home", "go", "jog" or "stop"
        "stop" means that the axis decelerates.
    goal : float
        Commanded angle, rad; NaN if no angle is commanded.
    rate : float
        Commanded rate, rad/s; signed for a jog.
    begun, due : float
        Session time of the command, and deadline of the motion, s.
    """

    activity: Activity = "idle"
    goal: float = nan
    rate: float = 0.0
    begun: float = -inf
    due: float = inf


LIMIT_MARGIN = radians(0.1)  # rad; a jog ends at this distance from a soft limit
_LEAST_JOG = radians(0.01)  # rad from this end; a nearer axis has reached the end
_HOMING_TIMEOUT = 300.0  # s
_DURATION_MARGIN, _GRACE = 1.5, 5.0  # factor for the duration of a motion, and additional s


def narrower_limits(
    controller: Sequence[AxisLimits], bench: Sequence[AxisMotionLimits]
) -> tuple[AxisLimits, ...]:
    """Return the limits of each axis: the narrower of controller and run file."""
    return tuple(
        replace(
            of, rate=min(of.rate, held.rate), acceleration=min(of.acceleration, held.acceleration)
        )
        for of, held in zip(controller, bench, strict=True)
    )


@dataclass(frozen=True)
class CommandCheck:
    """Checks commands to one table.

    Parameters
    ----------
    axes : tuple of str
        Names of the axes, from outer to inner.
    limits : sequence of AxisLimits
        Limits to enforce for each axis.
    unsupported : mapping
        Functions that the controller cannot carry out, with the reasons.
    """

    axes: tuple[str, ...]
    limits: Sequence[AxisLimits]
    unsupported: Mapping[Feature, str]

    def judge(
        self,
        command: AxisCommand,
        state: TableState,
        tasks: Sequence[AxisTask],
        time: float,
    ) -> tuple[sequencer.Command, AxisTask | None]:
        """Return the command for the table, and the axis's new task (None if it is unchanged).

        Parameters
        ----------
        command : AxisCommand
        state : TableState
            The last state that was read.
        tasks : sequence of AxisTask
            Current task of each axis.
        time : float
            Session time, s.

        Raises
        ------
        InputError
            The command exceeds a limit, names an axis that does not exist, or is not possible now.
        TableFault
            The axis has a fault, or its servo is off.
        """
        i = rotary_table.axis_index(command.axis, self.axes)
        axis, limits, task = state.axes[i], self.limits[i], tasks[i]
        match command:
            case ServoCommand(on=True):
                if axis.enabled and not axis.faults:
                    raise InputError("its servo is already on")
                return sequencer.EnableCommand(i), None
            case ServoCommand():
                self._require_supported("servo")
                if task.activity != "idle" or abs(axis.rate) > rotary_table.REST_RATE:
                    raise InputError("the axis is moving; stop it first")
                return sequencer.DisableCommand(i), None
            case HomeAxisCommand():
                self._require_supported("home")
                _require_ready(axis, task)
                return sequencer.HomeCommand(i), AxisTask("home", due=time + _HOMING_TIMEOUT)
            case GoCommand(_, angle, rate):
                limits.check(command.axis, rate, limits.acceleration, angle)
                _require_ready(axis, task)
                if not axis.homed:
                    raise InputError("its angle is not known yet; home it first")
                takes = abs(angle - axis.angle) / rate + 2 * rate / limits.acceleration
                due = time + _DURATION_MARGIN * takes + _GRACE
                goes = AxisTask("go", angle, rate, due=due)
                return sequencer.MoveCommand(i, angle, rate, limits.acceleration), goes
            case JogCommand(_, rate):
                if rate == 0:
                    raise InputError("the rate of a jog is not 0")
                limits.check(command.axis, abs(rate), limits.acceleration)
                _require_ready(axis, task, rate)
                end = limits.high - LIMIT_MARGIN if rate > 0 else limits.low + LIMIT_MARGIN
                way = end - axis.angle if rate > 0 else axis.angle - end
                if way < _LEAST_JOG:
                    raise InputError(
                        f"it is at {degrees(axis.angle):.4f}°, and its limit is at "
                        f"{degrees(limits.high if rate > 0 else limits.low):.6g}°; turn it back"
                    )
                if isfinite(end):
                    moves = sequencer.MoveCommand(i, end, abs(rate), limits.acceleration)
                    return moves, AxisTask("jog", end, rate)
                spins = sequencer.SpinCommand(i, rate, limits.acceleration)
                return spins, AxisTask("jog", nan, rate)

    def _require_supported(self, feature: Feature) -> None:
        if feature in self.unsupported:
            raise InputError(self.unsupported[feature])


def _require_ready(axis: AxisState, task: AxisTask, rate: float = 0.0) -> None:
    """Raise an error if an axis cannot move; a jog away from a limit switch is permitted."""
    at_limit = axis.at_low or axis.at_high
    leaves = (rate > 0 and axis.at_low and not axis.at_high) or (
        rate < 0 and axis.at_high and not axis.at_low
    )
    if at_limit and not leaves:
        raise TableFault("a limit switch is closed; jog the axis away from it")
    if not axis.enabled:
        why = f"{', '.join(axis.faults)}: " if axis.faults else ""
        raise TableFault(f"{why}its servo is off; switch it on first")
    if axis.faults and not at_limit:
        raise TableFault(f"{', '.join(axis.faults)}; switch its servo on again once that is gone")
    if task.activity == "home":
        raise InputError("it is homing; wait, or halt it")
