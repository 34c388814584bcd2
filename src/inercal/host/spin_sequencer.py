"""Runs the states of a plan on a rate table, on which an operator mounts the sensor.

::

    enable -> ( mount -> approach -> work )* -> return -> done
                  ^ paused, or restarted after an outage: the state is repeated from its start

`mount` stops the table and waits until the operator confirms the mounting of the next state. It is
skipped if the sensor already has this mounting. `approach` brings the table to the rate of the
state and waits until the rate is steady. For a state at rest, it stops the table. The table is not
homed, because no zero position is needed.

`MountingPrompt` requests a mounting of the sensor, and records who confirms it and when. A
confirmation names the mounting and the number of the request. The number is drawn at random when
the request is published, so nobody can know it earlier. A confirmation therefore has no effect if
it was sent before the request, for another request, or twice, even if it was delayed for a long
time.
"""

import secrets
from collections.abc import Callable
from math import inf, pi
from queue import SimpleQueue
from typing import Literal, NamedTuple

from inercal.benches.motion_control import SpinTask, TurnTask
from inercal.host.clock import Clock
from inercal.host.drivers.rotary_table import AxisState, TableState
from inercal.host.journal import Journal
from inercal.host.sequencer import (
    DURATION_MARGIN,
    GRACE,
    Command,
    EnableCommand,
    Phase,
    Sequencer,
    SpinCommand,
    StopCommand,
    TaskSequencer,
)
from inercal.host.tasks import HostPlan

_STEADY_SHARE = 0.01  # fraction of the set rate; within this tolerance, the rate is reached
_STEADY_TIME = 1.0  # s; the rate must be steady for this time before a state begins
_WRONG_SHARE = 0.05  # fraction of the set rate; beyond it, the drive does not hold the rate


class SpinSequencer(TaskSequencer[SpinTask]):
    """Carries out tasks on a single-axis rate table; for the parameters, see `TaskSequencer`.

    Attributes
    ----------
    mounting : str
        The last confirmed mounting; empty if no mounting was confirmed.
    """

    mounting = ""
    _is_waiting = False
    _steady_since = inf

    @property
    def awaited_task(self) -> SpinTask | None:
        """The task whose mounting the operator must confirm; None if there is none."""
        return self.task if self.phase == "mount" and self._is_waiting else None

    def confirm_mounting(self, number: int) -> bool:
        """Confirm the mounting for a task; return False if the table does not wait for it."""
        task = self.awaited_task
        if task is None or number != self.number:
            return False
        self.mounting = task.mounting
        return True

    def _commands(self, seen: TableState) -> tuple[list[Command], float]:
        (axis,), (limits,) = seen.axes, self._limits
        if self.phase == "enable":
            return [] if _is_ready(axis) else [EnableCommand()], GRACE
        braking = DURATION_MARGIN * abs(axis.rate) / limits.acceleration + GRACE
        if self.phase in ("mount", "return"):
            return ([] if axis.rests else [StopCommand()]), braking
        task = self._tasks[self.number]
        if self.phase == "approach":
            self._steady_since = inf
            if not task.rate:
                return ([] if axis.rests else [StopCommand()]), braking + _STEADY_TIME
            change = abs(task.rate - axis.rate) / limits.acceleration
            spin = SpinCommand(0, task.rate, limits.acceleration)
            return [spin], DURATION_MARGIN * change + GRACE + _STEADY_TIME
        self._begin_section(task, seen.time)
        return [], inf

    def _is_phase_finished(self, seen: TableState) -> bool:
        (axis,) = seen.axes
        if self.phase == "enable":
            return _is_ready(axis)
        if self.phase == "return":
            return axis.rests
        task = self._tasks[self.number]
        if self.phase == "mount":
            self._is_waiting = axis.rests
            if self._is_waiting:
                # The operator may take any amount of time for mounting.
                self._time_limit = inf
            return self._is_waiting and self.mounting == task.mounting
        if self.phase == "approach":
            if not _turns_at(axis, task.rate, _STEADY_SHARE):
                self._steady_since = inf
                return False
            self._steady_since = min(self._steady_since, seen.time)
            return seen.time - self._steady_since >= _STEADY_TIME
        self._require_rate(axis, task)
        return seen.time - self._phase_start >= task.seconds

    def _enter_phase(self, phase: Phase) -> None:
        super()._enter_phase(phase)
        # A mounting is only requested after a reading has shown the table at rest.
        self._is_waiting = False

    def _advance_phase(self, time: float) -> None:
        if self.phase == "work":
            self._finish_section(self._tasks[self.number], time)
        next_task: Phase = "return"
        if task := self.task:
            next_task = "approach" if task.mounting == self.mounting else "mount"
        following: dict[Phase, Phase] = {"mount": "approach", "approach": "work", "return": "done"}
        self._enter_phase(following.get(self.phase, next_task))

    def _require_rate(self, axis: AxisState, task: SpinTask) -> None:
        """Raise a fault if two successive readings both differ from the set rate.

        A single reading may have a corrupted digit.
        """
        doubted = self._motion_suspected
        self._motion_suspected = not _turns_at(axis, task.rate, _WRONG_SHARE)
        if doubted and self._motion_suspected:
            raise self._fault(
                f"axis {self._names[0]} turns at {axis.rate * 30 / pi:.4g} r/min instead of "
                f"{task.rate * 30 / pi:.4g} r/min: its drive does not hold the rate, or another "
                "program commands the table",
                0,
            )


def _is_ready(axis: AxisState) -> bool:
    return axis.enabled and not axis.faults


def _turns_at(axis: AxisState, rate: float, share: float) -> bool:
    return abs(axis.rate - rate) <= share * abs(rate) if rate else axis.rests


_NUMBERS = 1 << 48  # range of request numbers; JavaScript is exact below 2⁵³


class MountingRequest(NamedTuple):
    """A requested mounting: number of the request, name of the mounting, and instruction."""

    number: int
    mounting: str
    instruction: str


class MountingPrompt:
    """Asks the operator to mount the sensor, and processes the confirmations.

    Parameters
    ----------
    sequencer : SpinSequencer
    journal : Journal
    clock : Clock
        Clock of the bench; a simulated bench learns the mounting through it.
    say : callable
        Function that reports a message to the operator; the level is "info" or "warning".

    Attributes
    ----------
    before_request : callable
        Function that is called just before a request is published, to discard earlier input.
    """

    def __init__(
        self,
        sequencer: SpinSequencer,
        journal: Journal,
        clock: Clock,
        say: Callable[[Literal["info", "warning"], str], None],
    ):
        self._sequencer, self._journal, self._clock, self._say = sequencer, journal, clock, say
        self._confirmations: SimpleQueue[tuple[int, str, str]] = SimpleQueue()
        self.before_request: Callable[[], object] = lambda: None
        self._published: tuple[int, MountingRequest] | None = None  # and the number of its step

    @property
    def request(self) -> MountingRequest | None:
        """The published request that waits for confirmation; None if there is none."""
        awaited, published = self._awaited(), self._published
        if awaited is None or published is None or published[0] != awaited[0]:
            return None
        return published[1]

    def _awaited(self) -> tuple[int, SpinTask] | None:
        """Return the number and task of the step that waits for a mounting; None if none waits."""
        task = self._sequencer.awaited_task
        return None if task is None else (self._sequencer.number, task)

    def restore(self) -> None:
        """Restore the mounting on a simulated bench, because the bench may have been restarted.

        Raises
        ------
        LinkLost
            The simulated bench is gone.
        """
        if self._sequencer.mounting:
            self._clock.mount(self._sequencer.mounting)

    def confirm(self, number: int, mounting: str, by: str) -> None:
        """Confirm a mounting for a request, from any thread; `update` processes this."""
        self._confirmations.put((number, mounting, by))

    def update(self, time: float) -> None:
        """Publish a new request, and process the confirmations, at a table time in s.

        Raises
        ------
        LinkLost
            The simulated bench is gone.
        """
        # Confirmations that were received before a request is published have no effect.
        while not self._confirmations.empty():
            self._take(*self._confirmations.get(), time)
        awaited = self._awaited()
        if awaited is None:
            self._published = None
        elif self._published is None or self._published[0] != awaited[0]:
            self.before_request()
            step, task = awaited
            request = MountingRequest(secrets.randbelow(_NUMBERS), task.mounting, task.instruction)
            self._published = step, request
            self._say("info", f"{request.instruction}; then confirm the mounting")

    def _take(self, number: int, mounting: str, by: str, time: float) -> None:
        request = self.request
        if request is None or request.number != number:
            self._say(
                "warning", f"{by} confirms a mounting that is not requested; wait for the request"
            )
            return
        if request.mounting != mounting:
            self._say(
                "warning",
                f"{by} confirms the mounting {mounting!r}, but {request.mounting} is requested; "
                "mount it, then confirm it",
            )
            return
        self._clock.mount(request.mounting)
        # The mounting is recorded before the table turns. If the host is killed later, the request
        # is not repeated.
        step = self._sequencer.number
        self._journal.record_mounting(step, request.mounting, time)
        self._sequencer.confirm_mounting(step)
        self._say("info", f"{by} confirms: the sensor is mounted as {request.mounting}")


def create_sequencer(plan: HostPlan, first: int, mounting: str) -> Sequencer | SpinSequencer:
    """Return the sequencer for a plan from a first step, with the current mounting."""
    limits, names = plan.bench.axis_motion_limits, plan.bench.names
    if plan.spins:
        spins = [task for task in plan.tasks if isinstance(task, SpinTask)]
        sequencer = SpinSequencer(spins, limits, first, names)
        sequencer.mounting = mounting
        return sequencer
    turns = [task for task in plan.tasks if isinstance(task, TurnTask)]
    return Sequencer(turns, limits, first, names)
