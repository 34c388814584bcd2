"""Sequences the tasks of a plan: it derives the next commands from the state of the table.

A sequencer owns no link, no clock and no thread. It takes each state of the table and returns
commands, so that it is the same on a real table, in simulation and in a test.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees
from typing import Generic, Literal, NamedTuple, TypeVar

from inercal.benches.motion_control import AxisMotionLimits, SpinTask, TurnTask
from inercal.host.drivers.rotary_table import AxisState, TableFault, TableState

T = TypeVar("T", TurnTask, SpinTask)
Phase = Literal[
    "enable", "home", "mount", "approach", "work", "return", "paused", "done", "aborted"
]
GRACE = 5.0  # s on top of what a motion takes: to speed up, to settle
DURATION_MARGIN = 1.5  # times what a motion takes by its limits


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
    section : str
        The label of its samples in the recording.
    """

    number: int
    label: str
    state: Literal["begun", "done", "void"]
    time: float
    section: str


class TaskSequencer(ABC, Generic[T]):
    """Carries out tasks; a subclass derives the commands of one task.

    Parameters
    ----------
    tasks : sequence of Task
    limits : sequence of Limits
        Of each axis.
    first : int
        The task to begin with; those before it are done.
    names : sequence of str, optional
        Names of the axes for messages; by default their numbers from 0.

    Attributes
    ----------
    phase : str
    number : int
        The present task; `len(tasks)` when all are done.
    sections : list of Section
        What began and ended, in order; the caller may take them out.
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
        self._tasks, self._limits = tuple(tasks), tuple(limits)
        self._commanded = False  # the commands of this phase are out
        self._phase_start, self._time_limit = 0.0, 0.0
        self._working = False
        self._motion_suspected = False  # by its last reading an axis moved that should hold

    @property
    def task(self) -> T | None:
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

    @abstractmethod
    def _commands(self, seen: TableState) -> tuple[list[Command], float]:
        """Return the first commands of this phase, and how long it may take, s."""

    @abstractmethod
    def _is_phase_finished(self, seen: TableState) -> bool:
        """Tell whether what the phase is for has come about."""

    @abstractmethod
    def _advance_phase(self, time: float) -> None:
        """Begin the phase that follows."""

    def _begin_section(self, task: T, time: float) -> None:
        self._working = True
        self._record_section(task, "begun", time)

    def _finish_section(self, task: T, time: float) -> None:
        self._record_section(task, "done", time)
        self._working = False
        self.number += 1


def _is_at_rest(axis: AxisState) -> bool:
    return axis.enabled and axis.homed and axis.settled
