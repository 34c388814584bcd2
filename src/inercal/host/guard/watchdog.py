"""The process of the watchdog: reads commands and heartbeats, and stops the table.

The host starts it as `python -m inercal.host.guard.watchdog TABLE_ADDRESS --silence 1.5`, with a
pipe from the host as its standard input.
"""

import os
import signal
import sys
from argparse import ArgumentParser
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from math import degrees, inf, isfinite
from select import select
from time import monotonic
from typing import NamedTuple

from inercal.host.addresses import allows_second_connection, open_table
from inercal.host.drivers.rotary_table import REST_RATE, ProtocolError, RotaryTable, TableState

_TIMEOUT = 0.5  # s for a reply
_START_ATTEMPTS = 4  # attempts to reach the table at the beginning
# Time between checks of a table that need not stop, s: often enough to notice a lost link
_IDLE_INTERVAL = 1.0
_STOP_POLL_INTERVAL = 0.03  # s between readings of a table that is being stopped
_REST_READINGS = 2  # successive readings at rest
# Time within which the rate must decrease by this fraction, s. If not, the table is not slowing
# down.
_DECELERATION_WINDOW = 0.5
_MIN_RATE_DROP = 0.1
_WAKE_UP_DELAY = 0.1  # s; a wake-up may be late by this time
_GRACE = 1.0  # s, in addition to the deceleration time
_CLOCK_TIMEOUT = 5.0  # s of wall time; the controller's clock may stand still for this time


class _RateSample(NamedTuple):
    """The highest rate of all axes at an instant, rad/s, with controller time and wall time."""

    time: float
    wall: float
    rate: float


@dataclass
class _StopProgress:
    """The progress of a stop.

    Parameters
    ----------
    acknowledged : bool
        Whether the controller has answered the stop.
    killed : bool
        Whether the servos were killed because the stop had no effect.
    rest_readings : int
        Number of successive readings at rest.
    expected_time : float
        Time for a stop from the highest observed rate at the acceleration limits, s.
    first, last : _RateSample or None
        Samples between which the table should have slowed down.
    """

    acknowledged: bool = False
    killed: bool = False
    rest_readings: int = 0
    expected_time: float = 0.0
    first: _RateSample | None = None
    last: _RateSample | None = None


class Watchdog:
    """The watchdog, in its own process.

    Parameters
    ----------
    address : str
    silence : float
        Time without a heartbeat after which the table is stopped, s.
    patience : float
        Time without a reply from the table after which a watchdog without a host gives up, s.
    listen : sequence of int
        Descriptors to read: the pipe from the host, and the pipe for signals to this process.
    say : callable
        Function that reports a line to the host.
    """

    def __init__(
        self,
        address: str,
        silence: float,
        patience: float,
        listen: tuple[int, int],
        say: Callable[[str], None],
    ):
        self._address, self._silence, self._patience = address, silence, patience
        self._shares_link = allows_second_connection(address)
        self._pipe, self._signals = listen
        self._say = say
        self._table: RotaryTable | None = None
        self._state: TableState | None = None
        self._reported_errors = set[str]()  # current errors; each is reported only once
        self._last_answer_time = self._last_reading_time = monotonic()
        self._last_beat_time: float | None = None  # last heartbeat; None if none is expected
        self._host_gone = self._released = False
        self._stopping: _StopProgress | None = None

    def run(self) -> int:
        """Watch until released, or until the table is at rest without a host; return the status."""
        try:
            return self._watch()
        finally:
            if self._table is not None:
                self._table.close()

    def _watch(self) -> int:
        if self._shares_link and not self._find_table():
            return 1
        self._say("ready")
        while not self._released:
            self._listen(_STOP_POLL_INTERVAL if self._stopping else self._wait_time())
            now = monotonic()
            if self._last_beat_time is not None and now - self._last_beat_time > self._silence:
                self._last_beat_time = None
                self._stop(f"the host was silent for {self._silence:g} s")
            if self._stopping:
                self._follow_stop(self._stopping)
            elif self._shares_link and now - self._last_reading_time >= _IDLE_INTERVAL:
                self._check_link()
            if self._host_gone and not self._stopping:
                return 0
            if self._host_gone and now - self._last_answer_time > self._patience:
                self._say(f"cannot: no reply from the table for {self._patience:g} s; given up")
                return 1
        return 0

    def _wait_time(self) -> float:
        due = self._last_reading_time + _IDLE_INTERVAL if self._shares_link else inf
        if self._last_beat_time is not None:
            due = min(due, self._last_beat_time + self._silence)
        return min(max(due - monotonic(), 0.0), _IDLE_INTERVAL)

    def _listen(self, wait: float) -> None:
        """Execute a command that arrives within `wait` s."""
        ends = [self._signals] if self._host_gone else [self._pipe, self._signals]
        due = monotonic() + wait
        ready, _, _ = select(ends, [], [], wait)
        late = monotonic() - due
        if self._last_beat_time is not None and late > _WAKE_UP_DELAY:
            # The whole machine stood still, so the host is not the cause of the silence.
            self._last_beat_time += late
        if self._signals in ready:
            os.read(self._signals, 64)
            self._host_gone = True
            self._stop("the guard process received a signal to end")
        elif self._pipe in ready:
            told = os.read(self._pipe, 1 << 16)
            if not told:
                self._host_gone, self._last_beat_time = True, None
                self._stop("the host is gone")
            if b"." in told:
                self._last_beat_time = monotonic()
            for byte in told:
                if byte in b"s\x02\x0f":
                    self._stop(
                        "the host requested it" if byte == ord("s") else signal.Signals(byte).name
                    )
                elif byte == ord("q"):
                    self._released = True
                    return

    def _stop(self, why: str) -> None:
        """Begin to stop the table, unless a stop is already in progress."""
        if self._stopping:
            return
        self._say(f"stopping: {why}")
        self._stopping = _StopProgress()
        # First it is checked whether all servos are off, because a stop would switch them on.
        if not (self._servos_are_off() and self._read_state() and self._servos_are_off()):
            self._stopping.acknowledged = self._send_stop()

    def _follow_stop(self, stop: _StopProgress) -> None:
        """Check the progress of a stop; if necessary, repeat the stop or kill the servos."""
        if not stop.acknowledged and not stop.killed and not self._servos_are_off():
            stop.acknowledged = self._send_stop()
        if not self._read_state() or self._state is None:
            # It is unknown which commands the table has received before the link was lost.
            stop.acknowledged, stop.rest_readings, stop.first = False, 0, None
            return
        turning = [abs(axis.rate) > REST_RATE or axis.moving for axis in self._state.axes]
        stop.rest_readings = 0 if any(turning) else stop.rest_readings + 1
        if stop.rest_readings >= _REST_READINGS:
            self._finish_stop()
        elif any(a.enabled and turns for a, turns in zip(self._state.axes, turning, strict=True)):
            self._check_deceleration(stop, self._state)

    def _check_deceleration(self, stop: _StopProgress, state: TableState) -> None:
        """Repeat the stop of a table that does not slow down; kill its servos after a timeout."""
        wall, rate = monotonic(), max(abs(axis.rate) for axis in state.axes if axis.enabled)
        now = _RateSample(state.time if isfinite(state.time) else wall, wall, rate)
        if stop.first is None or stop.last is None:
            stop.first = stop.last = now
        limits = self._table.limits if self._table else ()
        took = (
            abs(a.rate) / (of.acceleration or inf) for a, of in zip(state.axes, limits, strict=True)
        )
        stop.expected_time = max(stop.expected_time, *took)
        stands = now.wall - stop.last.wall > _CLOCK_TIMEOUT
        if now.time - stop.last.time < _DECELERATION_WINDOW and not stands:
            return
        slows, stop.last = now.rate < (1 - _MIN_RATE_DROP) * stop.last.rate, now
        if slows:
            return
        # The stop is repeated before a kill, because the host may have commanded a motion at the
        # same moment.
        late = stands or now.time - stop.first.time > stop.expected_time + _GRACE
        if late and self._try(lambda table: table.kill(coasting=True)):
            stop.killed = True
            self._say(f"killed: it turned at {degrees(rate):.3g} °/s and did not slow down")
        else:
            self._send_stop()

    def _finish_stop(self) -> None:
        self._stopping = None
        self._reported_errors.clear()
        self._say("at rest")
        if self._table and not self._shares_link:
            # From here on, the host may command the table again.
            self._table.close()
            self._table = None

    def _find_table(self) -> bool:
        """Check that the table answers; a single late reply is tolerated."""
        return any(self._read_state(quietly=left > 0) for left in reversed(range(_START_ATTEMPTS)))

    def _check_link(self) -> None:
        """Check the link to the table; if the machine only stalled, the link is not lost."""
        if (self._read_state(quietly=True) or self._read_state()) and self._reported_errors:
            self._reported_errors.clear()
            self._say("ready")

    def _servos_are_off(self) -> bool:
        """Return whether the servos of all axes were off in the last state."""
        return self._state is not None and not any(axis.enabled for axis in self._state.axes)

    def _read_state(self, *, quietly: bool = False) -> bool:
        """Read the state of the table; return False if it does not answer."""
        self._state = None
        self._last_reading_time = monotonic()

        def read(table: RotaryTable) -> None:
            self._state = table.read()

        return self._try(read, quietly=quietly)

    def _send_stop(self) -> bool:
        """Send a stop before waiting for any answer; return whether it was answered."""
        return self._try(lambda table: table.stop(), unanswered="a stop was sent, but not answered")

    def _try(
        self,
        act: Callable[[RotaryTable], None],
        *,
        quietly: bool = False,
        unanswered: str = "cannot",
    ) -> bool:
        """Call a function with the table; an error is reported once, unless `quietly` is set."""
        try:
            if self._table is None:
                self._table = open_table(self._address, None, _TIMEOUT)
            act(self._table)
        # Any error may be gone the next time, and nobody else will try.
        except Exception as error:
            what = unanswered if isinstance(error, ProtocolError) else "cannot"
            wrong = f"{what}: {str(error) or type(error).__name__}"
            if not quietly and wrong not in self._reported_errors:
                self._say(wrong)
                self._reported_errors.add(wrong)
            return False
        self._last_answer_time = monotonic()
        return True


def _say(line: str) -> None:
    # The host may be gone, or suspended with a full pipe. This must not delay the stop.
    with suppress(OSError):
        os.write(1, " ".join(line[:1000].split()).encode() + b"\n")


def _ignore_signal(*_: object) -> None:
    """Do nothing, because the wake-up descriptor has already reported the signal."""


def main() -> int:
    """Watch the table at the given address, and return the exit status."""
    parser = ArgumentParser(
        prog="python -m inercal.host.guard.watchdog", description="Guards a table."
    )
    parser.add_argument("address")
    parser.add_argument("--silence", type=float, default=1.5)
    parser.add_argument("--patience", type=float, default=600.0)
    options = parser.parse_args()
    signals, poke = os.pipe()
    for end in (signals, poke):
        os.set_blocking(end, False)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.set_wakeup_fd(poke, warn_on_full_buffer=False)
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, _ignore_signal)  # SIG_IGN would write no byte
    # The process gets a higher priority than other processes, if the system permits this.
    with suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, -20)
    if not os.isatty(1):
        os.set_blocking(1, False)
    return Watchdog(options.address, options.silence, options.patience, (0, signals), _say).run()


if __name__ == "__main__":
    sys.exit(main())
