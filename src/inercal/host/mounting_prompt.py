"""The change of a mounting: the operator is asked, and who confirms is kept with name and time.

A confirmation names the step that it is for: one that was meant for another prompt, as by a second
click, confirms nothing.
"""

from collections.abc import Callable
from queue import SimpleQueue
from typing import Literal, NamedTuple

from inercal.host.clock import Clock
from inercal.host.journal import Journal
from inercal.host.sequencer import Sequencer
from inercal.host.spin_sequencer import SpinSequencer


class MountingRequest(NamedTuple):
    """What an operator is asked for: the step that waits for it, the mounting, and how."""

    number: int
    mounting: str
    instruction: str


class MountingPrompt:
    """Asks for mountings, and hears who confirms them.

    Parameters
    ----------
    sequencer : Sequencer or SpinSequencer
        One on a table of angles asks for no mounting.
    journal : Journal
    clock : Clock
        That of a simulated bench is told how the sensor is mounted.
    say : callable
        Takes "info" or "warning", and what an operator should know.
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
        self._asked: int | None = None

    @property
    def request(self) -> MountingRequest | None:
        """What is asked for now; None where nothing is."""
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
        """Ask for what is awaited, and take what was confirmed, at a time of the table, s.

        Raises
        ------
        LinkLost
            A simulated bench is gone.
        """
        if self._sequencer is None:
            return
        request = self.request
        if request is None:
            self._asked = None
        elif self._asked != request.number:
            self._asked = request.number
            self._say("info", f"{request.instruction}; then confirm the mounting")
        while not self._confirmations.empty():
            self._take(*self._confirmations.get(), time)

    def _take(self, number: int, by: str, time: float) -> None:
        request = self.request
        if self._sequencer is None or request is None or request.number != number:
            self._say("warning", f"{by} confirms a mounting that is not asked for now")
            return
        self._clock.mount(request.mounting)
        # Before the table is told to turn: a host that is killed then does not ask again.
        self._journal.record_mounting(number, request.mounting, time)
        self._sequencer.confirm_mounting(number)
        self._say("info", f"{by} confirms: the sensor is mounted as {request.mounting}")
