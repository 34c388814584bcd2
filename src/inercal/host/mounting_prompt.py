"""Requests a mounting of the sensor, and records who confirms it and when.

A confirmation names its step: one for another request, as by a second click, confirms nothing.
"""

from collections.abc import Callable
from queue import SimpleQueue
from typing import Literal, NamedTuple

from inercal.host.clock import Clock
from inercal.host.journal import Journal
from inercal.host.sequencer import Sequencer
from inercal.host.spin_sequencer import SpinSequencer


class MountingRequest(NamedTuple):
    """A requested mounting: the step that waits, its name, and the instruction."""

    number: int
    mounting: str
    instruction: str


class MountingPrompt:
    """Requests mountings of the operator and takes the confirmations.

    Parameters
    ----------
    sequencer : Sequencer or SpinSequencer
        A table of angles has no mountings.
    journal : Journal
    clock : Clock
        A simulated bench receives the mounting by its clock.
    say : callable
        Takes "info" or "warning", and the message for the operator.
    """

    def __init__(
        self,
        sequencer: Sequencer | SpinSequencer,
        journal: Journal,
        clock: Clock,
        say: Callable[[Literal["info", "warning"], str], None],
    ):
        self._sequencer = sequencer if isinstance(sequencer, SpinSequencer) else None
        self._journal, self._clock, self._say = journal, clock, say
        self._confirmations: SimpleQueue[tuple[int, str]] = SimpleQueue()
        self._requested: int | None = None

    @property
    def request(self) -> MountingRequest | None:
        """The request that was published and waits for a confirmation, or None."""
        awaited = self._awaited()
        return awaited if awaited is not None and awaited.number == self._requested else None

    def _awaited(self) -> MountingRequest | None:
        task = self._sequencer.awaited_task if self._sequencer else None
        if self._sequencer is None or task is None:
            return None
        return MountingRequest(self._sequencer.number, task.mounting, task.instruction)

    def restore(self) -> None:
        """Have the sensor of a simulated bench, which may be a new one, mounted as before.

        Raises
        ------
        LinkLost
            The simulated bench is gone.
        """
        if self._sequencer is not None and self._sequencer.mounting:
            self._clock.mount(self._sequencer.mounting)

    def confirm(self, number: int, by: str) -> None:
        """Confirm the mounting for a step, from whichever thread; `update` does it."""
        self._confirmations.put((number, by))

    def update(self, time: float) -> None:
        """Publish a new request, and take the confirmations, at a time of the table, s.

        Raises
        ------
        LinkLost
            A simulated bench is gone.
        """
        if self._sequencer is None:
            return
        # What came before a request is published confirms nothing.
        while not self._confirmations.empty():
            self._take(*self._confirmations.get(), time)
        awaited = self._awaited()
        if awaited is None:
            self._requested = None
        elif self._requested != awaited.number:
            self._requested = awaited.number
            self._say("info", f"{awaited.instruction}; then confirm the mounting")

    def _take(self, number: int, by: str, time: float) -> None:
        request = self.request
        if self._sequencer is None or request is None or request.number != number:
            self._say(
                "warning", f"{by} confirms a mounting that is not requested; wait for the request"
            )
            return
        self._clock.mount(request.mounting)
        # Recorded before the table turns, so that a killed host does not request it again.
        self._journal.record_mounting(number, request.mounting, time)
        self._sequencer.confirm_mounting(number)
        self._say("info", f"{by} confirms: the sensor is mounted as {request.mounting}")
