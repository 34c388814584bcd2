"""Sequences the steps of a plan on a turntable, which moves to angles.

::

    enable -> home -> ( approach -> settle -> work )* -> return -> done
                         ^ paused, or restarted after an outage: the step is repeated from its start

A section of the recording lasts from the moment `work` begins to the moment it ends, by the table's
clock.
"""

from collections.abc import Sequence
from math import degrees, pi, radians

from inercal.benches.motion_control import TurnTask
from inercal.host.drivers.rotary_table import TableState
from inercal.host.task_sequencer import (
    DURATION_MARGIN,
    GRACE,
    Command,
    EnableCommand,
    HomeCommand,
    MoveCommand,
    Phase,
    TaskSequencer,
)

# Distance below which the table counts as already there, rad; a servo's band is smaller
_MOTION_THRESHOLD = 1e-4
_ARRIVAL_TOLERANCE = radians(0.05)  # an axis at rest farther away is not where it was sent
_HOMING_TIMEOUT = 300.0  # s
_RETURN_RATE_SHARE = 0.5  # of the rate limit, because there is no hurry any more


class Sequencer(TaskSequencer[TurnTask]):
    """Carries out tasks on a turntable; the parameters are those of `TaskSequencer`."""

    _target: tuple[float, ...] = ()

    def _commands(self, seen: TableState) -> tuple[list[Command], float]:
        """Return the first commands of this phase, and how long it may take in s."""
        if self.phase == "enable":
            # Closing the loop clears a latched fault if its cause has gone.
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
        """Return the commands that move all axes to angles, and how long this may take in s."""
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
        """Return whether an axis has left its position; raise at the second such reading in a row.

        A panel or a hand can turn an axis without the controller reporting a fault. A single
        reading may have a corrupted digit.
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
