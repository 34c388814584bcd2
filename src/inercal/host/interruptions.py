"""Tracks the interruptions of a run: the current reasons to pause it, and reasons to end it."""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf
from queue import SimpleQueue
from time import monotonic
from typing import Literal, Protocol

from inercal.basics.errors import InercalError
from inercal.basics.units import format_duration
from inercal.host.guard import Guard
from inercal.host.interlocks import MAX_CHECK_INTERVAL
from inercal.host.sequencer import Command, Sequencer
from inercal.host.spin_sequencer import SpinSequencer

_GUARD_INTERVAL = 0.05  # s of wall time between two checks of the watchdog
_Request = Literal["pause", "go on", "stop"]
_PauseCause = Literal["operator", "host", "watchdog", "IMU", "interlocks", "chamber"]


class TroubleSource(Protocol):
    """A source of temporary problems: the IMU, the interlocks, or the chamber."""

    trouble: str | None
    trouble_since: float


@dataclass(eq=False)
class Interruptions:
    """Pauses or ends a run on request of the operator, the watchdog or the devices.

    Parameters
    ----------
    sequencer : Sequencer
    guard : Guard
    stop : callable
        Function that calls `Sequencer.pause` or `Sequencer.abort` and sends the resulting commands
        to the table. It also records the cause and for how long it has lasted, s.
    go_on : callable
        Function that records that the run continues after a pause.
    say : callable
        Function that reports a message to the operator; the level is "info", "warning" or "alarm".

    Attributes
    ----------
    trouble : str
        Reason why the run was interrupted; empty if it was not interrupted.
    """

    sequencer: Sequencer | SpinSequencer
    guard: Guard
    stop: Callable[[Callable[[float], list[Command]], str, float], None]
    go_on: Callable[[], None]
    say: Callable[[Literal["info", "warning", "alarm"], str], None]
    trouble: str = ""
    _pauses: dict[_PauseCause, str] = field(default_factory=dict[_PauseCause, str])
    _reported_ends: set[str] = field(default_factory=set[str])
    _requests: SimpleQueue[_Request] = field(default_factory=SimpleQueue[_Request])
    _guard_check_time: float = -inf

    @property
    def pause_reason(self) -> str:
        """Reason why the run is paused; empty if it is not paused."""
        return "; ".join(self._pauses.values())

    def request(self, what: _Request) -> None:
        """Request a command, from any thread; `update` executes it."""
        self._requests.put(what)

    def update(
        self, time: float, imu: TroubleSource, interlocks: TroubleSource, patience: float
    ) -> None:
        """Check requests, watchdog, IMU and interlocks, and pause, continue or end the run.

        Parameters
        ----------
        time : float
            Run time, s.
        imu, interlocks : TroubleSource
        patience : float
            Longest time for which a problem may last before the run ends, s.
        """
        while not self._requests.empty():
            match self._requests.get():
                case "pause":
                    self._pause("operator", "paused by the operator")
                case "go on":
                    self._pauses.pop("operator", None)
                case "stop":
                    self.end("stopped by the operator")
        if self.guard.signal_received or monotonic() - self._guard_check_time >= _GUARD_INTERVAL:
            self.check_guard()
        self.follow("IMU", imu, time, patience)
        # If not, the reason is the IMU or the host, which has already been reported.
        if imu.trouble is None and "host" not in self._pauses:
            self.follow("interlocks", interlocks, time, patience)
        if self.sequencer.phase == "paused" and not self._pauses:
            self.say("info", "the run continues")
            self.sequencer.resume()
            self.go_on()

    def follow_host(self, late: float) -> None:
        """Pause until the next tick if the host itself stood still, because nothing was checked.

        Parameters
        ----------
        late : float
            Time by which a tick was too late, s.
        """
        if late > MAX_CHECK_INTERVAL:
            self._pause("host", f"the host stood still for {format_duration(late)}", late)
        else:
            self._pauses.pop("host", None)

    def check_guard(self) -> None:
        """Read the watchdog's messages, and check that the watchdog is alive."""
        self._guard_check_time = monotonic()
        if self.guard.signal_received:
            self.end("stopped by the operator")
        for line in self.guard.read_lines():
            if line in ("at rest", "ready"):
                self._pauses.pop("watchdog", None)
            elif line.startswith("killed"):
                # If the table did not slow down, somebody must inspect it before it moves again.
                self.end(f"watchdog: {line}")
            elif "watchdog" in self._pauses:
                self.say("warning", f"watchdog: {line}")
            else:
                self._pause("watchdog", f"watchdog: {line}")
        if not self.guard.alive:
            self.end("the watchdog is gone")

    def handle_table_error(self, error: InercalError) -> None:
        """End the run because the table does not obey, unless the watchdog is stopping it."""
        self.check_guard()
        if "watchdog" not in self._pauses:
            self.end(str(error))

    def end(self, words: str) -> None:
        """Abort the run; the reason is reported once, and the first reason is kept."""
        self.trouble = self.trouble or words
        try:
            # The table is stopped before the report, because the journal may be slow or may have
            # failed.
            if not self.sequencer.is_over:
                self.stop(self.sequencer.abort, words, 0.0)
        finally:
            # This is called repeatedly while the table comes to rest, but one report is enough.
            if words not in self._reported_ends:
                self._reported_ends.add(words)
                self.say("alarm", words)

    def add(self, words: str) -> None:
        """Report a problem that became known after the end, and add it to `trouble`."""
        self.trouble = f"{self.trouble}; {words}" if self.trouble else words
        self.say("alarm", words)

    def follow(self, why: _PauseCause, source: TroubleSource, time: float, patience: float) -> None:
        """Pause while there is a problem, and end the run if the problem lasts too long."""
        if source.trouble is None:
            self._pauses.pop(why, None)
        elif time - source.trouble_since > patience:
            self.end(f"{source.trouble}, and it did not come back within {patience:g} s")
        else:
            self._pause(why, source.trouble)

    def _pause(self, why: _PauseCause, words: str, lasted: float = 0.0) -> None:
        if why in self._pauses or self.sequencer.is_over:
            return
        self._pauses[why] = words
        self.stop(self.sequencer.pause, words, lasted)
        self.say("warning", f"{words}; the table stops, and the current step will be repeated")
