"""What is asked of a run from outside: commands, whenever they come, and signals."""

from typing import Literal

from inercal.host.run import BenchRun

_COMMANDS: dict[str, Literal["pause", "go on", "stop"]] = {
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
        self._waiting: list[Literal["pause", "go on", "stop"]] = []

    def command(self, words: str) -> None:
        """Do what `pause`, `go on` or `abort` say, from whichever thread; else nothing."""
        if (what := _COMMANDS.get(words)) is None:
            return
        self._waiting.append(what)
        self._hand_on()

    def attach(self, run: BenchRun) -> None:
        """Have a run hear from now on; signals are its own matter then."""
        self._run, self.interruptible = run, False
        self._hand_on()

    def interrupt(self, *_: object) -> None:
        """Hear a signal outside of the run.

        Raises
        ------
        KeyboardInterrupt
            Where that harms nothing.
        """
        if self.interruptible:
            raise KeyboardInterrupt

    def _hand_on(self) -> None:
        while self._run is not None and self._waiting:
            self._run.ask(self._waiting.pop(0))
