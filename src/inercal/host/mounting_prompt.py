"""Requests a mounting of the sensor, and records who confirms it and when.

A confirmation names the mounting and the number of its request. The number is drawn when the
request is published, so that nobody knows it before: what was sent earlier, to another request or
twice confirms nothing, however long it waited on its way.
"""

import secrets
from collections.abc import Callable
from queue import SimpleQueue
from typing import Literal, NamedTuple

from inercal.host.clock import Clock
from inercal.host.journal import Journal
from inercal.host.sequencer import Sequencer
from inercal.host.spin_sequencer import SpinSequencer, SpinTask

_NUMBERS = 1 << 48  # of requests; JavaScript has whole numbers below 2⁵³


class MountingRequest(NamedTuple):
    """A requested mounting: the number of the request, the mounting's name, the instruction."""

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

    Attributes
    ----------
    before_request : callable
        Called just before a request is published: what has been typed is read, and belongs to none.
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
        self._confirmations: SimpleQueue[tuple[int, str, str]] = SimpleQueue()
        self.before_request: Callable[[], object] = _do_nothing
        self._published: tuple[int, MountingRequest] | None = None  # with the step that waits

    @property
    def request(self) -> MountingRequest | None:
        """The request that was published and waits for a confirmation, or None."""
        awaited, published = self._awaited(), self._published
        if awaited is None or published is None or published[0] != awaited[0]:
            return None
        return published[1]

    def _awaited(self) -> tuple[int, SpinTask] | None:
        """Return the step that waits for a mounting, with its task; None where none does."""
        task = self._sequencer.awaited_task if self._sequencer else None
        return None if self._sequencer is None or task is None else (self._sequencer.number, task)

    def restore(self) -> None:
        """Have the sensor of a simulated bench, which may be a new one, mounted as before.

        Raises
        ------
        LinkLost
            The simulated bench is gone.
        """
        if self._sequencer is not None and self._sequencer.mounting:
            self._clock.mount(self._sequencer.mounting)

    def confirm(self, number: int, mounting: str, by: str) -> None:
        """Confirm a mounting for the request `number`, from whichever thread; `update` does it."""
        self._confirmations.put((number, mounting, by))

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
            self._published = None
        elif self._published is None or self._published[0] != awaited[0]:
            self.before_request()
            step, task = awaited
            request = MountingRequest(secrets.randbelow(_NUMBERS), task.mounting, task.instruction)
            self._published = step, request
            self._say("info", f"{request.instruction}; then confirm the mounting")

    def _take(self, number: int, mounting: str, by: str, time: float) -> None:
        request = self.request
        if self._sequencer is None or request is None or request.number != number:
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
        # Recorded before the table turns, so that a killed host does not request it again.
        step = self._sequencer.number
        self._journal.record_mounting(step, request.mounting, time)
        self._sequencer.confirm_mounting(step)
        self._say("info", f"{by} confirms: the sensor is mounted as {request.mounting}")


def _do_nothing() -> None: ...
