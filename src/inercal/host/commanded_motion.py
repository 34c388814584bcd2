"""Motion of a table that this program has not commanded.

A lock keeps programs on one machine from one table; a program elsewhere, or a panel, is known by
what the table does. Each axis is compared with the last command that it was given::

    at rest               it leaves its angle by more than 0.5° (5° where an operator works at it)
    on its way to a goal  it turns away from the goal, or faster than commanded by a fifth
    at a rate             it turns the other way, or faster than commanded by a fifth
    stopped, homing       anything, until it rests

An axis whose servo is off may be turned by hand and is compared with nothing; neither is one that
has not rested since the connection was made. One reading may have a false digit, so that only three
in a row count.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees, radians
from typing import Literal

from inercal.host.drivers.rotary_table import REST_RATE, AxisState, TableState
from inercal.host.task_sequencer import (
    Command,
    DisableCommand,
    EnableCommand,
    HomeCommand,
    MoveCommand,
    SpinCommand,
)

_READINGS = 3  # in a row
_STARTING_TIME = 0.3  # s after a command in which an axis may still say what it did before
_GRACE = 1.0  # s to settle at a new rate, in addition to the acceleration
_REST_TOLERANCE, _HANDS_ON_TOLERANCE = radians(0.5), radians(5)  # rad
_RATE_MARGIN = 1.2  # times the commanded rate


@dataclass
class _Axis:
    """What one axis was told last.

    Parameters
    ----------
    does : "free", "rest", "move", "spin", "home" or "stop"
        Free: nothing to compare with, until it rests.
    goal, rate, acceleration : float
        rad, rad/s, rad/s²; at rest `goal` is the angle where it rests.
    since : float or None
        s by the table's clock; None until the first reading after the command.
    start_rate : float
        rad/s at that reading.
    doubted : int
        Readings in a row that are not what was commanded.
    """

    does: Literal["free", "rest", "move", "spin", "home", "stop"] = "free"
    goal: float = 0.0
    rate: float = 0.0
    acceleration: float = 1.0
    since: float | None = None
    start_rate: float = 0.0
    doubted: int = 0


class CommandedMotion:
    """The comparison for one table.

    Parameters
    ----------
    axes : sequence of str
        Their names.
    """

    def __init__(self, axes: Sequence[str]):
        self._names = tuple(axes)
        self._axes = [_Axis() for _ in axes]

    def record(self, command: Command) -> None:
        """Note what the table is told, before it is told."""
        match command:
            case MoveCommand(axis, angle, rate, acceleration):
                self._axes[axis] = _Axis("move", angle, rate, acceleration)
            case SpinCommand(axis, rate, acceleration) if rate:
                self._axes[axis] = _Axis("spin", 0.0, rate, acceleration)
            case SpinCommand(axis):
                self._axes[axis] = _Axis("stop")
            case DisableCommand(axis):
                self._axes[axis] = _Axis()
            case HomeCommand(axis):
                for i in range(len(self._axes)) if axis is None else (axis,):
                    self._axes[i] = _Axis("home")
            case EnableCommand():
                pass  # it holds an axis where it is
            case _:
                self._axes = [_Axis("stop") for _ in self._axes]

    def check(self, state: TableState, *, hands_on: bool = False) -> str | None:
        """Return in words what the table does uncommanded; None while it does nothing.

        Parameters
        ----------
        state : TableState
            A plausible reading, later than that before.
        hands_on : bool
            An operator works at the table, and may nudge it.
        """
        found: str | None = None
        for name, told, axis in zip(self._names, self._axes, state.axes, strict=True):
            if not axis.enabled:
                told.does, told.doubted = "free", 0
                continue
            if told.since is None:
                told.since, told.start_rate = state.time, axis.rate
            self._follow(told, axis, state.time)
            does = self._uncommanded(told, axis, state.time, hands_on=hands_on)
            told.doubted = told.doubted + 1 if does else 0
            if told.doubted >= _READINGS:
                found = found or (
                    f"axis {name} {does}: another program commands the table, or it is moved from "
                    "outside; end that program, and keep panels and people from the table"
                )
        return found

    def _follow(self, told: _Axis, axis: AxisState, time: float) -> None:
        """See an axis come to rest where it may."""
        assert told.since is not None
        if told.does in ("rest", "spin") or time - told.since < _STARTING_TIME:
            return
        rests = axis.settled or axis.rests
        if told.does == "home":
            rests = axis.homed and axis.settled
        elif told.does == "move":  # elsewhere it may be late to start
            rests = rests and abs(axis.angle - told.goal) < _REST_TOLERANCE
        if rests:
            told.does, told.goal = "rest", axis.angle

    def _uncommanded(
        self, told: _Axis, axis: AxisState, time: float, *, hands_on: bool
    ) -> str | None:
        assert told.since is not None
        since, turns = time - told.since, f"turns at {degrees(axis.rate):.3g} °/s"
        if told.does == "rest":
            away = axis.angle - told.goal
            if abs(away) > (_HANDS_ON_TOLERANCE if hands_on else _REST_TOLERANCE):
                return f"has left its place by {degrees(away):.3g}° without a command"
            return None
        if told.does not in ("move", "spin"):
            return None
        braking = abs(told.start_rate) / told.acceleration
        if since < _STARTING_TIME + braking + (_GRACE if told.does == "spin" else 0.0):
            return None
        commanded, left = abs(told.rate), told.goal - axis.angle
        if abs(axis.rate) > _RATE_MARGIN * commanded + REST_RATE:
            return f"{turns} instead of {degrees(told.rate):.3g} °/s as commanded"
        if told.does == "spin":
            back = axis.rate * told.rate < 0
            return f"{turns} against its commanded direction" if back and _turns(axis) else None
        overshoot = told.start_rate**2 / (2 * told.acceleration) + _REST_TOLERANCE
        if _turns(axis) and axis.rate * left < 0 and abs(left) > overshoot:
            return f"{turns} away from the commanded {degrees(told.goal):.3f}°"
        return None


def _turns(axis: AxisState) -> bool:
    return abs(axis.rate) > 2 * REST_RATE
