"""The times in which a run was interrupted, and why, by the events of its log."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

HOST_GONE = "the host was not running"


@dataclass
class InterruptionSpan:
    """A time in which the table was stopped, or nobody drove it.

    Parameters
    ----------
    start, stop : float
        s of the run; `stop` is that of the last event known while the interruption lasts.
    causes : list of str
    is_open : bool
        It lasts.
    """

    start: float
    stop: float
    causes: list[str]
    is_open: bool = True


class InterruptionList:
    """Collects the interruptions of a run.

    Attributes
    ----------
    interruptions : list of InterruptionSpan
        In the order of time.
    """

    def __init__(self) -> None:
        self.interruptions: list[InterruptionSpan] = []
        self._last = 0.0

    def hear(self, time: float) -> None:
        """Note that a device has sent something, s of the run."""
        self._last = max(self._last, time)

    def add_event(self, time: float, event: Mapping[str, Any]) -> None:
        """Take in an event "session", "section" or "interruption", at a time of the run, s."""
        what, cause = event.get("what"), event.get("cause")
        if what == "interruption" and cause is not None:
            self._begin(float(event.get("since", time)), str(cause))
        elif what == "session" and self._last:
            # Where none lasts, a host was killed: nothing was said, and nothing came since.
            self._begin(self._last, "" if self._is_open else HOST_GONE)
        elif what == "interruption" or event.get("state") == "begun":
            self._end(time)

    @property
    def _is_open(self) -> bool:
        return bool(self.interruptions) and self.interruptions[-1].is_open

    def _begin(self, time: float, cause: str) -> None:
        if not self._is_open:
            self.interruptions.append(InterruptionSpan(time, time, []))
        last = self.interruptions[-1]
        if cause and cause not in last.causes:
            last.causes.append(cause)

    def _end(self, time: float) -> None:
        if self._is_open:
            last = self.interruptions[-1]
            last.stop, last.is_open = time, False
