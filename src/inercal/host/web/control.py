"""What is asked of a run from outside: commands, whenever they come, and signals."""

from contextlib import suppress
from queue import Empty, SimpleQueue
from typing import Literal

from inercal.host.run import BenchRun

_Asked = Literal["pause", "go on", "stop"]
_COMMANDS: dict[str, _Asked] = {
    "pause": "pause",
    "go on": "go on",
    "abort": "stop",
}


class Control:
    """Hands on what is asked to the run, once there is one.

    Attributes
    ----------
    interruptible : bool
        A signal ends the process: nothing moves yet, and nothing is written.
    """

    def __init__(self):
        self.interruptible = True
        self._run: BenchRun | None = None
        self._waiting: SimpleQueue[_Asked] = SimpleQueue()

    def command(self, words: str) -> None:
        """Do what `pause`, `go on` or `abort` say, from whichever thread; else nothing."""
        if (what := _COMMANDS.get(words)) is None:
            return
        self._waiting.put(what)
        self._hand_on()

    def attach(self, run: BenchRun) -> None:
        """Have a run hear from now on, of signals too until it catches them itself."""
        self._run, self.interruptible = run, False
        self._hand_on()

    def interrupt(self, *_: object) -> None:
        """Hear a signal that the run does not catch itself, and ask the run, if any, to stop.

        Raises
        ------
        KeyboardInterrupt
            Where that harms nothing.
        """
        if self.interruptible:
            raise KeyboardInterrupt
        if self._run is not None:
            # A SimpleQueue: this does not wait, whatever the signal interrupts.
            self._run.ask("stop")

    def _hand_on(self) -> None:
        if self._run is None:
            return
        with suppress(Empty):  # two threads hand on: what one of them sees, the other may have
            while True:
                self._run.ask(self._waiting.get_nowait())
