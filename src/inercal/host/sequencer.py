"""Sequences the steps of a plan: it derives the next commands from the state of the table.

The sequencer owns no link, no clock and no thread. It takes each state of the table and returns
commands, so that it is the same on a real table, in simulation and in a test::

    enable -> home -> ( approach -> settle -> work )* -> return -> done
                         ^ paused, or begun anew after an outage: the step is repeated whole

A section of the recording is from the moment `work` begins to the moment it ends, by the table's
clock.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees, pi, radians
from typing import Literal, NamedTuple

from inercal.benches.turntable.axis_profiles import AxisMotionLimits
from inercal.host.drivers.rotary_table import AxisState, TableFault, TableState
from inercal.host.tasks import Task

Phase = Literal["enable", "home", "approach", "work", "return", "paused", "done", "aborted"]
# Angle below which the table is already there, rad; a servo's band is smaller
_MOTION_THRESHOLD = 1e-4
_ARRIVAL_TOLERANCE = radians(0.05)  # beyond it an axis at rest is not where it was sent
_DURATION_MARGIN = 1.5  # times what a motion takes by its limits
_GRACE = 5.0  # s on top: to speed up, to settle
_HOMING_TIMEOUT = 300.0  # s
_RETURN_RATE_SHARE = 0.5  # of the limit of rate: nothing hurries any more


class EnableCommand(NamedTuple):
    """Close the servo loop of an axis (0 is the outermost), or of all."""

    axis: int | None = None


class DisableCommand(NamedTuple):
    """Open the servo loop of an axis that rests."""

    axis: int


class HomeCommand(NamedTuple):
    """Find the zero of an axis, or of all."""

    axis: int | None = None


class MoveCommand(NamedTuple):
    """Bring an axis (0 is the outermost) to an angle, rad, at a rate, rad/s, and acceleration."""

    axis: int
    angle: float
    rate: float
    acceleration: float


class SpinCommand(NamedTuple):
    """Turn an axis at a rate, rad/s, signed, reached at an acceleration, rad/s²; 0 stops it."""

    axis: int
    rate: float
    acceleration: float


class StopCommand(NamedTuple):
    """Decelerate all axes and hold them."""


Command = EnableCommand | DisableCommand | HomeCommand | MoveCommand | SpinCommand | StopCommand


@dataclass(frozen=True)
class SectionEvent:
    """A section of the recording that begins or ends.

    Parameters
    ----------
    number : int
        Of the task, from 0.
    label : str
    state : "begun", "done" or "void"
        Void is one that will be repeated: what it left has no label.
    time : float
        The table's clock, s.
    """

    number: int
    label: str
    state: Literal["begun", "done", "void"]
    time: float


class Sequencer:
    """Carries out tasks.

    Parameters
    ----------
    tasks : sequence of Task
    limits : sequence of Limits
        Of each axis.
    first : int
        The task to begin with; those before it are done.
    names : sequence of str, optional
        Of the axes, for what is said of them; else their numbers from 0.

    Attributes
    ----------
    phase : str
    number : int
        The task in hand; `len(tasks)` when all are done.
    sections : list of Section
        What began and ended, in order; the caller may take them out.
    """

    def __init__(
        self,
        tasks: Sequence[Task],
        limits: Sequence[AxisMotionLimits],
        first: int = 0,
        names: Sequence[str] = (),
    ):
        self._names = tuple(names) or tuple(str(i) for i in range(len(limits)))
        self.phase: Phase = "enable"
        self.number = first
        self.sections: list[SectionEvent] = []
        self._tasks, self._limits = tuple(tasks), tuple(limits)
        self._commanded = False  # the commands of this phase are out
        self._phase_start, self._time_limit = 0.0, 0.0
        self._target: tuple[float, ...] = ()
        self._working = False
        self._motion_suspected = False  # by its last reading an axis moved that should hold

    @property
    def task(self) -> Task | None:
        """The task in hand; None when all are done."""
        return self._tasks[self.number] if self.number < len(self._tasks) else None

    @property
    def is_over(self) -> bool:
        """Nothing more will be commanded."""
        return self.phase in ("done", "aborted")

    @property
    def is_holding(self) -> bool:
        """The table holds its place for the sake of a recording, and seems to."""
        task = self.task
        return self._working and task is not None and not task.rate and not self._motion_suspected

    def remaining_time(self, time: float) -> float:
        """Return how long the rest takes if nothing goes wrong, s, at a time of the table."""
        left = sum(t.approach + t.seconds for t in self._tasks[self.number :])
        task, gone = self.task, time - self._phase_start if self._commanded else 0.0
        if task and self.phase == "approach":
            left -= min(gone, task.approach)
        if task and self.phase == "work":
            left -= task.approach + min(gone, task.seconds)
        return left

    def pause(self, time: float) -> list[Command]:
        """Stop the table; the interrupted step is repeated when the run continues."""
        if self.is_over or self.phase == "paused":
            return []
        self._void_section(time)
        self._enter_phase("paused")
        return [StopCommand()]

    def resume(self) -> None:
        """Go on after a pause."""
        if self.phase == "paused":
            self._enter_phase("enable")

    def abort(self, time: float) -> list[Command]:
        """Stop the table and end the run."""
        self._void_section(time)
        self._enter_phase("aborted")
        return [StopCommand()]

    def step(self, seen: TableState) -> list[Command]:
        """Return what to tell the table now.

        Raises
        ------
        TableFault
            An axis that says a fault, loses its servo, does not arrive in time, comes to rest
            elsewhere than where it was sent, or leaves its place while it should hold it.
        """
        if self.is_over or self.phase == "paused":
            return []
        self._refuse_faults(seen)
        if not self._commanded:
            self._commanded, self._phase_start = True, seen.time
            commands, self._time_limit = self._commands(seen)
            if commands:
                return commands  # what the table says of itself is older than they are
        if self._is_phase_finished(seen):
            self._advance_phase(seen.time)
        elif seen.time - self._phase_start > self._time_limit:
            raise self._timeout_fault(seen)
        return []

    def _commands(self, seen: TableState) -> tuple[list[Command], float]:
        """Return what this phase begins with, and how long it may take, s."""
        if self.phase == "enable":
            # A fault that is latched goes when the loop is closed, if its cause has gone.
            wanted = not all(axis.enabled and not axis.faults for axis in seen.axes)
            return [EnableCommand()] if wanted else [], _GRACE
        if self.phase == "home":
            wanted = not all(axis.homed for axis in seen.axes)
            return [HomeCommand()] if wanted else [], _HOMING_TIMEOUT
        if self.phase == "return":
            rates = [one.rate * _RETURN_RATE_SHARE for one in self._limits]
            angles = [2 * pi * round(axis.angle / (2 * pi)) for axis in seen.axes]
            return self._move_commands(angles, rates, seen)
        task = self._tasks[self.number]
        if self.phase == "approach":
            return self._move_commands(task.start, [one.rate for one in self._limits], seen)
        self._working = True
        self.sections.append(SectionEvent(self.number, task.label, "begun", seen.time))
        if not task.rate:
            return [], float("inf")
        return self._move_commands(task.end, [task.rate] * len(seen.axes), seen)

    def _move_commands(
        self, angles: Sequence[float], rates: Sequence[float], seen: TableState
    ) -> tuple[list[Command], float]:
        """Return the commands that bring all axes to angles, and how long that may take."""
        commands: list[Command] = []
        longest = 0.0
        self._target = tuple(angles)
        for i, (angle, rate, axis) in enumerate(zip(angles, rates, seen.axes, strict=True)):
            if abs(angle - axis.angle) > _MOTION_THRESHOLD or axis.moving:
                accelerates = self._limits[i].acceleration
                commands.append(MoveCommand(i, angle, rate, accelerates))
                longest = max(longest, abs(angle - axis.angle) / rate + 2 * rate / accelerates)
        return commands, _DURATION_MARGIN * longest + _GRACE

    def _is_phase_finished(self, seen: TableState) -> bool:
        if self.phase == "enable":
            return all(axis.enabled and not axis.faults for axis in seen.axes)
        if self.phase == "home":
            return all(axis.homed and axis.settled for axis in seen.axes)
        task = self.task
        if self.phase == "work" and task is not None and not task.rate:
            return not self._has_moved(task, seen) and seen.time - self._phase_start >= task.seconds
        if not all(axis.settled for axis in seen.axes):
            return False
        for i, (axis, angle) in enumerate(zip(seen.axes, self._target, strict=True)):
            if abs(axis.angle - angle) > _ARRIVAL_TOLERANCE:
                raise self._fault(
                    f"axis {self._names[i]} is at rest at {degrees(axis.angle):.4f}° instead of "
                    f"{degrees(angle):.4f}°: it was stopped from outside; check the table's panel",
                    i,
                )
        return True

    def _advance_phase(self, time: float) -> None:
        if self.phase == "enable":
            self._enter_phase("home")
        elif self.phase == "home":
            self._enter_phase("approach" if self.task else "return")
        elif self.phase == "approach":
            self._enter_phase("work")
        elif self.phase == "work":
            task = self._tasks[self.number]
            self.sections.append(SectionEvent(self.number, task.label, "done", time))
            self._working = False
            self.number += 1
            self._enter_phase("approach" if self.task else "return")
        else:
            self._enter_phase("done")

    def _enter_phase(self, phase: Phase) -> None:
        self.phase, self._commanded, self._motion_suspected = phase, False, False

    def _void_section(self, time: float) -> None:
        if self._working and (task := self.task):
            self.sections.append(SectionEvent(self.number, task.label, "void", time))
        self._working = False

    def _refuse_faults(self, seen: TableState) -> None:
        enabling = self.phase == "enable" and not (
            self._commanded and seen.time - self._phase_start > self._time_limit
        )
        for i, axis in enumerate(seen.axes):
            if axis.faults and not enabling:
                raise self._fault(f"axis {self._names[i]}: {', '.join(axis.faults)}", i)
            if self.phase in ("approach", "work", "return") and not axis.enabled:
                raise self._fault(f"axis {self._names[i]}: its servo is off; switch it on", i)

    def _has_moved(self, task: Task, seen: TableState) -> bool:
        """Tell whether an axis leaves its place by this reading; by the second in a row, refuse.

        A panel or a hand can turn an axis whose controller says no fault; one reading alone may
        have a false digit.
        """
        doubted, self._motion_suspected = self._motion_suspected, False
        for i, (axis, angle) in enumerate(zip(seen.axes, task.start, strict=True)):
            if not (axis.moving or abs(axis.angle - angle) > _ARRIVAL_TOLERANCE):
                continue
            self._motion_suspected = True
            if doubted:
                raise self._fault(
                    f"axis {self._names[i]} moved during the hold: it is at "
                    f"{degrees(axis.angle):.4f}° instead of {degrees(angle):.4f}°; it was moved "
                    "from outside; keep people and panels from the table",
                    i,
                )
        return self._motion_suspected

    def _timeout_fault(self, seen: TableState) -> TableFault:
        """Return the fault that names the axes which have not arrived."""
        late = [i for i, axis in enumerate(seen.axes) if not _is_at_rest(axis)] or [0]
        where = ", ".join(
            f"axis {self._names[i]} at {degrees(seen.axes[i].angle):.4f}°" for i in late
        )
        return self._fault(
            f"after {self._time_limit:.1f} s the table has not arrived: {where}", *late
        )

    def _fault(self, text: str, *axes: int) -> TableFault:
        """Return a fault of these axes; `names` has the axes, then the label of the step."""
        names, task = tuple(self._names[i] for i in axes), self.task
        if task is None:
            return TableFault(text, key=self.phase, names=names)
        return TableFault(
            f"{text} (step {self.number + 1}, {task.label}: {self.phase})",
            key=self.phase,
            names=(*names, task.label),
        )


def _is_at_rest(axis: AxisState) -> bool:
    return axis.enabled and axis.homed and axis.settled
