"""Carries out the tasks of a plan: finds the next commands from the state of the table.

A sequencer has no link, no clock and no thread. It gets each state of the table and returns
commands, so it works in the same way on a real table, in a simulation and in a test. For a
turntable, which moves to angles, there is `Sequencer`; for a rate table, there is `spin_sequencer`.

::

    enable -> home -> ( approach -> settle -> work )* -> return -> done
                         ^ paused, or restarted after an outage: the step is repeated from its start

A section of the recording lasts from the beginning to the end of `work`, by the table's clock.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import degrees, pi, radians
from typing import Generic, Literal, NamedTuple, TypeVar

from inercal.benches.motion_control import AxisMotionLimits, SpinTask, TurnTask
from inercal.host.drivers.rotary_table import AxisState, TableFault, TableState

T = TypeVar("T", TurnTask, SpinTask)
Phase = Literal[
    "enable", "home", "mount", "approach", "work", "return", "paused", "done", "aborted"
]
GRACE = 5.0  # s; added to the time of a motion for settling and similar delays
DURATION_MARGIN = 1.5  # times the duration of a motion at its limits


class EnableCommand(NamedTuple):
    """Close the servo loop of an axis (0 is the outermost axis) or of all axes."""

    axis: int | None = None


class DisableCommand(NamedTuple):
    """Open the servo loop of an axis at rest."""

    axis: int


class HomeCommand(NamedTuple):
    """Find the zero position of an axis or of all axes."""

    axis: int | None = None


class MoveCommand(NamedTuple):
    """Move an axis (0 is the outermost) to an angle, rad, at a rate, rad/s, and acceleration."""

    axis: int
    angle: float
    rate: float
    acceleration: float


class SpinCommand(NamedTuple):
    """Turn an axis at a signed rate, rad/s, with an acceleration, rad/s²; rate 0 stops it."""

    axis: int
    rate: float
    acceleration: float


class StopCommand(NamedTuple):
    """Decelerate all axes and hold their positions."""


Command = EnableCommand | DisableCommand | HomeCommand | MoveCommand | SpinCommand | StopCommand


@dataclass(frozen=True)
class SectionEvent:
    """The beginning or the end of a section in the recording.

    Parameters
    ----------
    number : int
        Number of the task, counted from 0.
    label : str
    state : "begun", "done" or "void"
        A "void" section will be repeated, and its samples get no label.
    time : float
        Time by the table's clock, s.
    section : str
        Label of the samples in the recording.
    """

    number: int
    label: str
    state: Literal["begun", "done", "void"]
    time: float
    section: str


class TaskSequencer(ABC, Generic[T]):
    """Carries out tasks; subclasses find the commands for one task.

    Parameters
    ----------
    tasks : sequence of Task
    limits : sequence of Limits
        Limits of each axis.
    first : int
        Number of the first task; all tasks before it are complete.
    names : sequence of str, optional
        Names of the axes in messages; by default, their numbers from 0.

    Attributes
    ----------
    phase : str
    number : int
        Number of the current task; `len(tasks)` if all tasks are complete.
    sections : list of Section
        Events of sections that began or ended, in order; the caller may remove them.
    may_begin : callable
        Function of the number of a task that returns whether the table may approach it now.
    """

    def __init__(
        self,
        tasks: Sequence[T],
        limits: Sequence[AxisMotionLimits],
        first: int = 0,
        names: Sequence[str] = (),
    ):
        self._names = tuple(names) or tuple(str(i) for i in range(len(limits)))
        self.phase: Phase = "enable"
        self.number = first
        self.sections: list[SectionEvent] = []
        self.may_begin: Callable[[int], bool] = lambda number: True
        self._tasks, self._limits = tuple(tasks), tuple(limits)
        self._commanded = False  # whether the commands of this phase were sent
        self._phase_start, self._time_limit = 0.0, 0.0
        self._working = self._waited = False
        self._motion_suspected = False  # whether an axis moved in a hold at the last reading

    @property
    def task(self) -> T | None:
        """The current task; None if all tasks are complete."""
        return self._tasks[self.number] if self.number < len(self._tasks) else None

    @property
    def is_over(self) -> bool:
        """Whether the sequencer will return no more commands."""
        return self.phase in ("done", "aborted")

    @property
    def is_waiting(self) -> bool:
        """Whether the table stays at rest until `may_begin` permits the next task."""
        if self.phase != "approach" or self._commanded:
            return False
        return not self.may_begin(self.number)

    @property
    def is_holding(self) -> bool:
        """Whether the table holds its position, according to the latest reading."""
        task = self.task
        if self.is_waiting:
            return True
        return self._working and task is not None and not task.rate and not self._motion_suspected

    def remaining_time(self, time: float) -> float:
        """Return the time that the remaining tasks need, without interruptions, s."""
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
        """Continue after a pause."""
        if self.phase == "paused":
            self._enter_phase("enable")

    def abort(self, time: float) -> list[Command]:
        """Stop the table and end the run."""
        self._void_section(time)
        self._enter_phase("aborted")
        return [StopCommand()]

    def step(self, seen: TableState) -> list[Command]:
        """Return the commands to send to the table now.

        Raises
        ------
        TableFault
            An axis reports a fault, its servo is off, it does not arrive in time, it stops away
            from its goal, or it leaves its position during a hold.
        """
        if self.is_over or self.phase == "paused":
            return []
        self._refuse_faults(seen)
        waited, self._waited = self._waited, self.is_waiting
        if waited or self._waited:
            return []  # after a wait, the polls are first frequent again
        if not self._commanded:
            self._commanded, self._phase_start = True, seen.time
            commands, self._time_limit = self._commands(seen)
            if commands:
                return commands  # the state of the table is older than these commands
        if self._is_phase_finished(seen):
            self._advance_phase(seen.time)
        elif seen.time - self._phase_start > self._time_limit:
            raise self._timeout_fault(seen)
        return []

    def _enter_phase(self, phase: Phase) -> None:
        self.phase, self._commanded, self._motion_suspected = phase, False, False

    def _record_section(
        self, task: T, state: Literal["begun", "done", "void"], time: float
    ) -> None:
        self.sections.append(SectionEvent(self.number, task.label, state, time, task.section))

    def _void_section(self, time: float) -> None:
        if self._working and (task := self.task):
            self._record_section(task, "void", time)
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

    def _timeout_fault(self, seen: TableState) -> TableFault:
        """Return the fault for a timeout; it names the axes that have not arrived."""
        late = [i for i, axis in enumerate(seen.axes) if not _is_at_rest(axis)] or [0]
        where = ", ".join(
            f"axis {self._names[i]} at {degrees(seen.axes[i].angle):.4f}°" for i in late
        )
        return self._fault(
            f"after {self._time_limit:.1f} s the table has not arrived: {where}", *late
        )

    def _fault(self, text: str, *axes: int) -> TableFault:
        """Return a fault of some axes; `names` contains the axes and the label of the step."""
        names, task = tuple(self._names[i] for i in axes), self.task
        if task is None:
            return TableFault(text, key=self.phase, names=names)
        return TableFault(
            f"{text} (step {self.number + 1}, {task.label}: {self.phase})",
            key=self.phase,
            names=(*names, task.label),
        )

    @abstractmethod
    def _commands(self, seen: TableState) -> tuple[list[Command], float]:
        """Return the first commands of this phase, and the longest time for it, s."""

    @abstractmethod
    def _is_phase_finished(self, seen: TableState) -> bool:
        """Return whether the current phase is complete."""

    @abstractmethod
    def _advance_phase(self, time: float) -> None:
        """Begin the next phase."""

    def _begin_section(self, task: T, time: float) -> None:
        self._working = True
        self._record_section(task, "begun", time)

    def _finish_section(self, task: T, time: float) -> None:
        self._record_section(task, "done", time)
        self._working = False
        self.number += 1


def _is_at_rest(axis: AxisState) -> bool:
    return axis.enabled and axis.homed and axis.settled


# Distance from a goal at which the table need not move, rad; the tolerance of a servo is smaller.
_MOTION_THRESHOLD = 1e-4
_ARRIVAL_TOLERANCE = radians(0.05)  # an axis at rest farther away has not arrived
_HOMING_TIMEOUT = 300.0  # s
_RETURN_RATE_SHARE = 0.5  # fraction of the rate limit, because there is no hurry at the end


class Sequencer(TaskSequencer[TurnTask]):
    """Carries out tasks on a turntable; for the parameters, see `TaskSequencer`."""

    _target: tuple[float, ...] = ()

    def _commands(self, seen: TableState) -> tuple[list[Command], float]:
        """Return the first commands of this phase, and the longest time for it, s."""
        if self.phase == "enable":
            # Closing the loop clears a latched fault if its cause is gone.
            wanted = not all(axis.enabled and not axis.faults for axis in seen.axes)
            return [EnableCommand()] if wanted else [], GRACE
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
        self._begin_section(task, seen.time)
        if not task.rate:
            return [], float("inf")
        return self._move_commands(task.end, [task.rate] * len(seen.axes), seen)

    def _move_commands(
        self, angles: Sequence[float], rates: Sequence[float], seen: TableState
    ) -> tuple[list[Command], float]:
        """Return the commands that move all axes to angles, and the longest time for this, s."""
        commands: list[Command] = []
        longest = 0.0
        self._target = tuple(angles)
        for i, (angle, rate, axis) in enumerate(zip(angles, rates, seen.axes, strict=True)):
            if abs(angle - axis.angle) > _MOTION_THRESHOLD or axis.moving:
                accelerates = self._limits[i].acceleration
                commands.append(MoveCommand(i, angle, rate, accelerates))
                longest = max(longest, abs(angle - axis.angle) / rate + 2 * rate / accelerates)
        return commands, DURATION_MARGIN * longest + GRACE

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
                    f"{degrees(angle):.4f}°: it was stopped from outside, at its panel or by "
                    "another program",
                    i,
                )
        return True

    def _advance_phase(self, time: float) -> None:
        if self.phase == "work":
            self._finish_section(self._tasks[self.number], time)
        next_task = "approach" if self.task else "return"
        following: dict[Phase, Phase] = {"enable": "home", "approach": "work", "return": "done"}
        self._enter_phase(following.get(self.phase, next_task))

    def _has_moved(self, task: TurnTask, seen: TableState) -> bool:
        """Return whether an axis has left its position; raise an error at the second such reading.

        An axis can be turned from a panel or by hand, and the controller reports no fault. A single
        reading is not sufficient, because it may have a corrupted digit.
        """
        doubted, self._motion_suspected = self._motion_suspected, False
        for i, (axis, angle) in enumerate(zip(seen.axes, task.start, strict=True)):
            if not (axis.moving or abs(axis.angle - angle) > _ARRIVAL_TOLERANCE):
                continue
            self._motion_suspected = True
            if doubted:
                raise self._fault(
                    f"axis {self._names[i]} moved during the hold: it is at "
                    f"{degrees(axis.angle):.4f}° instead of {degrees(angle):.4f}°; another program "
                    "commands the table, it was moved from outside, or its encoder drifts; end "
                    "that program, and keep people and panels from the table",
                    i,
                )
        return self._motion_suspected
