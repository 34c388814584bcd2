"""What is asked of a run from outside: commands, whenever they come, and signals."""

import json
from contextlib import suppress
from queue import Empty, SimpleQueue
from typing import Literal

from inercal.host.bench_run import BenchRun

_RunCommand = Literal["pause", "go on", "stop"]
_COMMANDS: dict[str, _RunCommand] = {
    "pause": "pause",
    "go on": "go on",
    "abort": "stop",
}
NOTE = "note "  # begins a line that is to be written down
_MOUNTED = "mounted "  # begins a line by which a mounting is confirmed


def mounted_line(number: int, mounting: str, by: str) -> str:
    """Return the line by which somebody confirms a mounting for the request `number`."""
    return f"{_MOUNTED}{json.dumps([number, mounting, by])}"


class CommandRelay:
    """Hands on what is asked to the run, once there is one.

    Attributes
    ----------
    interruptible : bool
        A signal ends the process: nothing moves yet, and nothing is written.
    """

    def __init__(self):
        self.interruptible = True
        self._run: BenchRun | None = None
        self._queue: SimpleQueue[_RunCommand] = SimpleQueue()
        self._notes: SimpleQueue[str] = SimpleQueue()

    def command(self, words: str) -> None:
        """Do what `pause`, `go on`, `abort`, a note or `mounted` say, from whichever thread."""
        if words.startswith(NOTE):
            self._notes.put(words.removeprefix(NOTE))
        if words.startswith(_MOUNTED) and self._run is not None:
            self._run.confirm_mounting(*json.loads(words.removeprefix(_MOUNTED)))
        if (what := _COMMANDS.get(words)) is None:
            return
        self._queue.put(what)
        self._forward_commands()

    def take_notes(self) -> list[str]:
        """Return the notes since the last call, for the thread that has the journal."""
        notes: list[str] = []
        with suppress(Empty):
            while True:
                notes.append(self._notes.get_nowait())
        return notes

    def attach(self, run: BenchRun) -> None:
        """Have a run hear from now on, of signals too until it catches them itself."""
        self._run, self.interruptible = run, False
        self._forward_commands()

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
            self._run.request("stop")

    def _forward_commands(self) -> None:
        if self._run is None:
            return
        with suppress(Empty):  # two threads hand on: what one of them sees, the other may have
            while True:
                self._run.request(self._queue.get_nowait())
