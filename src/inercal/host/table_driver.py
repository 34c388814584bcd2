"""Drives the table in a run: reads its state, sends commands, and brings it to rest.

If the host cannot stop the table, the watchdog (`guard`) stops it.

`CommandedMotion` detects motion that this program has not commanded. A lock prevents two programs
on one machine from commanding the same table. Commands from another machine or a control panel are
detected by the motion of the table. Each axis is compared with the last command that it received::

    at rest               it leaves its angle by more than 0.5° (5° if an operator works at it)
    moving to a goal      it turns away from the goal, or over 20 % faster than commanded
    at a rate             it turns the other way, or over 20 % faster than commanded
    stopping, homing      any motion is allowed until it is at rest

An axis with its servo off may be turned by hand and is not checked. An axis that has not been at
rest since the connection was made is not checked either. A single reading may have a corrupted
digit, so three successive readings are required.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import degrees, inf, isfinite, radians
from select import select
from time import monotonic
from typing import Literal

from inercal.basics.units import format_duration
from inercal.host import sequencer
from inercal.host.clock import Clock
from inercal.host.drivers.rotary_table import (
    REST_RATE,
    AxisState,
    ProtocolError,
    RotaryTable,
    TableFault,
    TableState,
)
from inercal.host.guard import Guard
from inercal.host.link import LinkLost

_READINGS = 3  # successive readings
_STARTING_TIME = 0.3  # s after a command; readings may still show earlier motion
_GRACE = 1.0  # s for settling at a new rate, in addition to the acceleration time
_REST_TOLERANCE, _HANDS_ON_TOLERANCE = radians(0.5), radians(5)  # rad
_RATE_MARGIN = 1.2  # times the commanded rate


@dataclass
class _Axis:
    """The last command to one axis.

    Parameters
    ----------
    does : "free", "rest", "move", "spin", "home" or "stop"
        "free" means that there is no command to compare with until the axis is at rest.
    goal, rate, acceleration : float
        Goal in rad, rate in rad/s, and acceleration in rad/s². At rest, `goal` is the present
        angle.
    since : float or None
        Table time of the first reading after the command, s; None before this reading.
    start_rate : float
        Rate at the first reading after the command, rad/s.
    doubted : int
        Number of successive readings that contradict the command.
    """

    does: Literal["free", "rest", "move", "spin", "home", "stop"] = "free"
    goal: float = 0.0
    rate: float = 0.0
    acceleration: float = 1.0
    since: float | None = None
    start_rate: float = 0.0
    doubted: int = 0


class CommandedMotion:
    """Compares the motion of one table with the commands that it received.

    Parameters
    ----------
    axes : sequence of str
        Names of the axes.
    """

    def __init__(self, axes: Sequence[str]):
        self._names = tuple(axes)
        self._axes = [_Axis() for _ in axes]

    def record(self, command: sequencer.Command) -> None:
        """Record a command before it is sent to the table."""
        match command:
            case sequencer.MoveCommand(axis, angle, rate, acceleration):
                self._axes[axis] = _Axis("move", angle, rate, acceleration)
            case sequencer.SpinCommand(axis, rate, acceleration) if rate:
                self._axes[axis] = _Axis("spin", 0.0, rate, acceleration)
            case sequencer.SpinCommand(axis):
                self._axes[axis] = _Axis("stop")
            case sequencer.DisableCommand(axis):
                self._axes[axis] = _Axis()
            case sequencer.HomeCommand(axis):
                for i in range(len(self._axes)) if axis is None else (axis,):
                    self._axes[i] = _Axis("home")
            case sequencer.EnableCommand():
                pass  # the axis holds its position
            case _:
                self._axes = [_Axis("stop") for _ in self._axes]

    def check(self, state: TableState, *, hands_on: bool = False) -> str | None:
        """Describe motion that was not commanded; None if there is none.

        Parameters
        ----------
        state : TableState
            A plausible reading that is later than the previous reading.
        hands_on : bool
            Whether an operator works at the table and may touch it.
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
        """Record that an axis has come to rest, if its command ends at rest."""
        assert told.since is not None
        if told.does in ("rest", "spin") or time - told.since < _STARTING_TIME:
            return
        rests = axis.settled or axis.rests
        if told.does == "home":
            rests = axis.homed and axis.settled
        elif told.does == "move":  # before the goal, the axis may only be starting late
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


# Time limit for a reply from a real table, s. Replies take milliseconds. A later reply is not used,
# because at 100 °/s the table turns by 28° in this time.
READ_TIMEOUT = 0.28
# Time without a valid reading after which a table that may be moving is stopped, s. This is the
# time of one missing reply or of several invalid replies. After a single invalid reply, the table
# is read again.
_BLIND_LIMIT = 0.25
_MAX_ROUND_TRIP = 1.0  # s; if it is longer, the host was suspended meanwhile
_MAX_FAILED_READINGS = 10  # number of successive failed readings that are tolerated
_GUARD_INTERVAL = 0.05  # s of wall time between two checks of the watchdog
_REST_TIMEOUT = 12.0  # s of wall time; in this time, the watchdog must find the table at rest


class TableDriver:
    """Drives a table and its watchdog.

    Parameters
    ----------
    table : RotaryTable
    guard : Guard
    now : callable
        Function that returns the run time, s.
    say : callable
        Function that reports a message to the operator; the level is "warning" or "alarm".

    Attributes
    ----------
    state : TableState or None
        The last state that was read.
    at_rest : bool
        Whether no axis moved at the last reading and no command was sent after it. Also true before
        the first reading.
    commanded_motion : CommandedMotion
        The motion that this program has commanded.
    """

    def __init__(
        self,
        table: RotaryTable,
        guard: Guard,
        now: Callable[[], float],
        say: Callable[[Literal["warning", "alarm"], str], None],
    ):
        self.state: TableState | None = None
        self.at_rest = True
        self._table, self._guard, self._now, self._say = table, guard, now, say
        self._commanded, self._failed_readings = False, 0
        self._shortest_round_trip = inf
        self._servos_off = False
        self.commanded_motion = CommandedMotion(table.axes)
        self._last_reading, self._stopped_blind, self._may_turn = monotonic(), False, False

    def read(self) -> tuple[float, TableState] | None:
        """Read the table, and return the run time and its state; None if the reading failed.

        If the table may be moving and could not be read for `_BLIND_LIMIT`, both the host and the
        watchdog stop it.

        Raises
        ------
        LinkLost
            Too many successive readings have failed.
        """
        self.at_rest = False
        requested = self._now()
        try:
            state = self._table.read()
        except (ProtocolError, LinkLost) as error:
            # A short stall of the machine or the network does no harm, because the driver
            # reconnects.
            self._failed_readings += 1
            self._stop_blind()
            self._say("warning", str(error))
            if self._failed_readings == _MAX_FAILED_READINGS:
                raise LinkLost(
                    f"the table does not answer: {_MAX_FAILED_READINGS} readings in a row "
                    f"failed: {error}"
                ) from error
            return None
        self._failed_readings = 0
        self._last_reading, self._stopped_blind = monotonic(), False
        # The clocks are related by the smallest delay. At most half of the shortest round trip
        # observed so far is therefore subtracted, even if a state arrives late.
        answered = self._now()
        if answered - requested <= _MAX_ROUND_TRIP:
            self._shortest_round_trip = min(self._shortest_round_trip, answered - requested)
        shortest = self._shortest_round_trip
        time = answered - (shortest / 2 if isfinite(shortest) else 0.0)
        if not isfinite(state.time):
            state = replace(state, time=time)  # the controller has no clock
        self.state = state
        # Just after a command, an axis may not yet report motion.
        self.at_rest = not self._commanded and all(axis.rests for axis in state.axes)
        self._may_turn = not self.at_rest
        return time, state

    def _stop_blind(self) -> None:
        """Stop a table that cannot be read; this is repeated only after a successful reading."""
        blind = monotonic() - self._last_reading
        if self._stopped_blind or not self._may_turn or blind < _BLIND_LIMIT:
            return
        self._stopped_blind = True
        told = self._guard.stop()
        try:
            self._table.stop()
            answer = "the table answered the stop"
        except (TableFault, ProtocolError) as error:
            answer = f"a stop was sent to the table, but it did not answer ({error})"
        except LinkLost as error:
            answer = f"no stop could be sent to the table ({error})"
        does = "stops it too" if told else "is gone too: cut the table's power"
        unread = f"the table could not be read for {format_duration(blind)}: {answer}"
        self._say("alarm", f"{unread}; the watchdog {does}")

    def send(self, commands: Sequence[sequencer.Command]) -> None:
        """Send commands, if any, to the table before the next reading.

        Raises
        ------
        TableFault, ProtocolError, LinkLost
            The table refuses a command or cannot be reached.
        """
        self._commanded = bool(commands)
        self._may_turn |= self._commanded
        self.at_rest = self.at_rest and not commands
        for command in commands:
            self.commanded_motion.record(command)
            match command:
                case sequencer.EnableCommand(axis):
                    self._table.enable(self._name(axis))
                case sequencer.DisableCommand(axis):
                    self._table.kill(self._name(axis))
                case sequencer.HomeCommand(axis):
                    self._table.home(self._name(axis))
                case sequencer.MoveCommand(axis, angle, rate, acceleration):
                    self._table.move(self._table.axes[axis], angle, rate, acceleration)
                case sequencer.SpinCommand(axis, rate, acceleration):
                    self._table.spin(self._table.axes[axis], rate, acceleration)
                case _:
                    self._table.stop()

    def require_idle(self) -> None:
        """Raise an error if the table turns before it was commanded.

        Raises
        ------
        TableFault
            A servo turns an axis.
        """
        state = None if self.at_rest else self.state
        for name, axis in zip(self._table.axes, state.axes if state else (), strict=False):
            if axis.enabled and axis.moving:
                raise TableFault(
                    f"axis {name} turns at {degrees(axis.rate):.3g} °/s before this run has "
                    "commanded anything: another program commands the table; end it first",
                    names=(name,),
                )

    def _name(self, axis: int | None) -> str | None:
        """Return the name of an axis; None means all axes."""
        return None if axis is None else self._table.axes[axis]

    def stop(self, commands: Sequence[sequencer.Command]) -> None:
        """Stop the table; if it does not accept the command, the watchdog stops it."""
        off = self.state is not None and not any(axis.enabled for axis in self.state.axes)
        # A stop closes servo loops, but an axis that somebody has switched off must stay off.
        if self._guard.axis_killed or (off and self.at_rest):
            return
        try:
            self.send(commands)
        except (TableFault, ProtocolError, LinkLost) as error:
            told = self._guard.stop()
            does = "now stops the table" if told else "is gone too: cut the table's power"
            self._say("alarm", f"{error}; the watchdog {does}")

    def switch_servos_off(self) -> None:
        """Switch all servos off, because a servo with a frozen encoder accelerates its axis."""
        if self._servos_off:
            return
        words = "the servos are switched off; a moving axis coasts to a stop"
        try:
            self._table.kill(coasting=True)
        except TableFault as error:
            words = str(error)
        except (ProtocolError, LinkLost) as error:
            self._say("alarm", f"{error}; the servos could not be switched off yet")
            return  # the caller will try again
        self._servos_off = True
        self._say("alarm", words)

    def leave(self, clock: Clock, say: Callable[[str], object], *, at_rest: bool) -> None:
        """Leave the table at rest, with the watchdog's help if necessary, and report problems."""
        try:
            if not at_rest:
                clock.close()  # a simulated bench now continues by itself
                if (words := self.release_to_guard()) is not None:
                    say(words)
        except BaseException:
            # If a user interrupts the waiting by another Ctrl-C, the stop is not cancelled.
            self._guard.release_to_guard()
            raise

    def release_to_guard(self) -> str | None:
        """Let the watchdog bring the table to rest; return a text if there was a problem."""
        self._guard.read_lines()
        self._guard.stop()
        until = monotonic() + _REST_TIMEOUT
        lines = list[str]()
        while "at rest" not in lines and self._guard.alive and monotonic() < until:
            select([], [], [], _GUARD_INTERVAL)
            lines += self._guard.read_lines()
        if "at rest" in lines:
            return next((f"watchdog: {line}" for line in lines if line.startswith("killed")), None)
        self._guard.release_to_guard()
        does = "keeps trying to stop it" if self._guard.alive else "is gone: cut its power"
        words = f"no reading shows the table at rest; the watchdog {does}"
        return "; ".join([words, *lines[-1:]])
