"""From step to step: what the table is told next, by what it says of itself.

The sequencer owns no link, no clock and no thread. It is shown each state of the table and answers
with commands, so that it is the same on iron, in simulation and in a test::

    enable -> home -> ( approach -> settle -> work )* -> return -> done
                         ^ paused, or begun anew after an outage: the step is repeated whole

A section of the recording is from the moment `work` begins to the moment it ends, by the table's
clock.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees, pi, radians
from typing import Literal, NamedTuple

from inercal.benches.turntable.moves import Limits
from inercal.host.drivers.table import AxisState, TableFault, TableState
from inercal.host.tasks import Task

Phase = Literal["enable", "home", "approach", "work", "return", "paused", "done", "aborted"]
_NEAR = 1e-4  # rad: there, as far as the choice of a way goes; a servo's band is smaller
_THERE = radians(0.05)  # beyond it an axis at rest is not where it was sent
_PATIENCE = 1.5  # times what a motion takes by its limits
_GRACE = 5.0  # s on top: to speed up, to settle
_HOMING = 300.0  # s
_FASTEST_RETURN = 0.5  # of the limit of rate: nothing hurries any more


class Enable(NamedTuple):
    """Close the servo loops."""


class Home(NamedTuple):
    """Find the zeros."""


class Go(NamedTuple):
    """Bring an axis (0 is the outermost) to an angle, rad, at a rate, rad/s, and acceleration."""

    axis: int
    angle: float
    rate: float
    acceleration: float


class Stop(NamedTuple):
    """Decelerate all axes and hold them."""


Command = Enable | Home | Go | Stop


@dataclass(frozen=True)
class Section:
    """A section of the recording that begins or ends.

    Parameters
    ----------
    number : int
        Of the task, from 0.
    label : str
    what : "begun", "done" or "void"
        Void is one that will be repeated: what it left has no label.
    time : float
        The table's clock, s.
    """

    number: int
    label: str
    what: Literal["begun", "done", "void"]
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
        limits: Sequence[Limits],
        first: int = 0,
        names: Sequence[str] = (),
    ):
        self._names = tuple(names) or tuple(str(i) for i in range(len(limits)))
        self.phase: Phase = "enable"
        self.number = first
        self.sections: list[Section] = []
        self._tasks, self._limits = tuple(tasks), tuple(limits)
        self._told = False  # the commands of this phase are out
        self._since, self._within = 0.0, 0.0
        self._target: tuple[float, ...] = ()
        self._working = False
        self._doubted = False  # by its last reading an axis moved that should hold

    @property
    def task(self) -> Task | None:
        """The task in hand; None when all are done."""
        return self._tasks[self.number] if self.number < len(self._tasks) else None

    @property
    def over(self) -> bool:
        """Nothing more will be commanded."""
        return self.phase in ("done", "aborted")

    @property
    def holding(self) -> bool:
        """The table holds its place for the sake of a recording, and seems to."""
        task = self.task
        return self._working and task is not None and not task.rate and not self._doubted

    def remaining(self, time: float) -> float:
        """Return how long the rest takes if nothing goes wrong, s, at a time of the table."""
        left = sum(t.approach + t.seconds for t in self._tasks[self.number :])
        task, gone = self.task, time - self._since if self._told else 0.0
        if task and self.phase == "approach":
            left -= min(gone, task.approach)
        if task and self.phase == "work":
            left -= task.approach + min(gone, task.seconds)
        return left

    def pause(self, time: float) -> list[Command]:
        """Stop the table; the step in hand is repeated when the run goes on."""
        if self.over or self.phase == "paused":
            return []
        self._void(time)
        self._enter("paused")
        return [Stop()]

    def go_on(self) -> None:
        """Go on after a pause."""
        if self.phase == "paused":
            self._enter("enable")

    def abort(self, time: float) -> list[Command]:
        """Stop the table and end the run."""
        self._void(time)
        self._enter("aborted")
        return [Stop()]

    def step(self, seen: TableState) -> list[Command]:
        """Return what to tell the table now.

        Raises
        ------
        TableFault
            An axis that says a fault, loses its servo, does not arrive in time, comes to rest
            elsewhere than where it was sent, or leaves its place while it should hold it.
        """
        if self.over or self.phase == "paused":
            return []
        self._refuse_faults(seen)
        if not self._told:
            self._told, self._since = True, seen.time
            commands, self._within = self._commands(seen)
            if commands:
                return commands  # what the table says of itself is older than they are
        if self._finished(seen):
            self._go_further(seen.time)
        elif seen.time - self._since > self._within:
            raise TableFault(self._late(seen))
        return []

    def _commands(self, seen: TableState) -> tuple[list[Command], float]:
        """Return what this phase begins with, and how long it may take, s."""
        if self.phase == "enable":
            # A fault that is latched goes when the loop is closed, if its cause has gone.
            wanted = not all(axis.enabled and not axis.faults for axis in seen.axes)
            return [Enable()] if wanted else [], _GRACE
        if self.phase == "home":
            wanted = not all(axis.homed for axis in seen.axes)
            return [Home()] if wanted else [], _HOMING
        if self.phase == "return":
            rates = [one.rate * _FASTEST_RETURN for one in self._limits]
            angles = [2 * pi * round(axis.angle / (2 * pi)) for axis in seen.axes]
            return self._to(angles, rates, seen)
        task = self._tasks[self.number]
        if self.phase == "approach":
            return self._to(task.start, [one.rate for one in self._limits], seen)
        self._working = True
        self.sections.append(Section(self.number, task.label, "begun", seen.time))
        if not task.rate:
            return [], float("inf")
        return self._to(task.end, [task.rate] * len(seen.axes), seen)

    def _to(
        self, angles: Sequence[float], rates: Sequence[float], seen: TableState
    ) -> tuple[list[Command], float]:
        """Return the commands that bring all axes to angles, and how long that may take."""
        commands: list[Command] = []
        longest = 0.0
        self._target = tuple(angles)
        for i, (angle, rate, axis) in enumerate(zip(angles, rates, seen.axes, strict=True)):
            if abs(angle - axis.angle) > _NEAR or axis.moving:
                accelerates = self._limits[i].acceleration
                commands.append(Go(i, angle, rate, accelerates))
                longest = max(longest, abs(angle - axis.angle) / rate + 2 * rate / accelerates)
        return commands, _PATIENCE * longest + _GRACE

    def _finished(self, seen: TableState) -> bool:
        if self.phase == "enable":
            return all(axis.enabled and not axis.faults for axis in seen.axes)
        if self.phase == "home":
            return all(axis.homed and axis.settled for axis in seen.axes)
        task = self.task
        if self.phase == "work" and task is not None and not task.rate:
            return not self._moved(task, seen) and seen.time - self._since >= task.seconds
        if not all(axis.settled for axis in seen.axes):
            return False
        for i, (axis, angle) in enumerate(zip(seen.axes, self._target, strict=True)):
            if abs(axis.angle - angle) > _THERE:
                raise TableFault(
                    f"axis {self._names[i]} stands at {degrees(axis.angle):.4f}° instead of "
                    f"{degrees(angle):.4f}°: it was stopped from outside{self._during()}"
                )
        return True

    def _go_further(self, time: float) -> None:
        if self.phase == "enable":
            self._enter("home")
        elif self.phase == "home":
            self._enter("approach" if self.task else "return")
        elif self.phase == "approach":
            self._enter("work")
        elif self.phase == "work":
            task = self._tasks[self.number]
            self.sections.append(Section(self.number, task.label, "done", time))
            self._working = False
            self.number += 1
            self._enter("approach" if self.task else "return")
        else:
            self._enter("done")

    def _enter(self, phase: Phase) -> None:
        self.phase, self._told, self._doubted = phase, False, False

    def _void(self, time: float) -> None:
        if self._working and (task := self.task):
            self.sections.append(Section(self.number, task.label, "void", time))
        self._working = False

    def _refuse_faults(self, seen: TableState) -> None:
        enabling = self.phase == "enable" and not (
            self._told and seen.time - self._since > self._within
        )
        for i, axis in enumerate(seen.axes):
            if axis.faults and not enabling:
                raise TableFault(f"axis {self._names[i]}: {', '.join(axis.faults)}{self._during()}")
            if self.phase in ("approach", "work", "return") and not axis.enabled:
                raise TableFault(f"axis {self._names[i]}: its servo is off{self._during()}")

    def _moved(self, task: Task, seen: TableState) -> bool:
        """Tell whether an axis leaves its place by this reading; by the second in a row, refuse.

        A panel or a hand can turn an axis whose controller says no fault; one reading alone may
        have a false digit.
        """
        doubted, self._doubted = self._doubted, False
        for i, (axis, angle) in enumerate(zip(seen.axes, task.start, strict=True)):
            if not (axis.moving or abs(axis.angle - angle) > _THERE):
                continue
            self._doubted = True
            if doubted:
                raise TableFault(
                    f"axis {self._names[i]} moved during the hold: it is at "
                    f"{degrees(axis.angle):.4f}° instead of {degrees(angle):.4f}°; it was moved "
                    f"from outside{self._during()}"
                )
        return self._doubted

    def _late(self, seen: TableState) -> str:
        """Say which axes have not done what they were told."""
        late = [i for i, axis in enumerate(seen.axes) if not _at_rest(axis)] or [0]
        where = ", ".join(
            f"axis {self._names[i]} at {degrees(seen.axes[i].angle):.4f}°" for i in late
        )
        return f"after {self._within:.1f} s the table has not arrived: {where}{self._during()}"

    def _during(self) -> str:
        task = self.task
        return f" (step {self.number + 1}, {task.label}: {self.phase})" if task else ""


def _at_rest(axis: AxisState) -> bool:
    return axis.enabled and axis.homed and axis.settled
