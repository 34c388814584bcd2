"""The watchdog stops the table on request, or if the host's heartbeat fails.

The watchdog is a separate process with its own connection to the table. It can therefore stop the
table even if the host is blocked or has ended. It reads a pipe to which only the host writes::

    .           heartbeat; after the first, a gap of `silence` s is a reason to stop
    s           stop now; so are the bytes 2 and 15, which signal handlers write
    q           release the table and end
    end of file the host has ended: stop now, and end when the table is at rest

The watchdog writes the lines `ready`, `stopping: WHY`, `at rest`, `killed: WHY` and `cannot: WHY`.
Between `stopping` and `at rest` it stops any axis that turns again, and the host must not command
the table.

The watchdog uses `RotaryTable.stop`, which sends the command before it waits for any answer. All
axes then decelerate and are held. If an axis does not decelerate as fast as its limits allow, the
watchdog kills it, and this axis coasts. The deceleration is measured by the clock of the
controller, if it has a clock. If a table is at rest and all its servos are off, it is not stopped,
because this would switch the servos on. If the link is lost, the watchdog reconnects and stops the
table again, until it is at rest.

The watchdog is not a safety function; the hardware interlock is.
"""

import os
import signal
import sys
from collections.abc import Generator
from contextlib import contextmanager, suppress
from math import inf
from select import select
from subprocess import PIPE, STDOUT, Popen, TimeoutExpired
from time import monotonic
from weakref import WeakSet

from inercal.basics.closeable import Closeable, on_failure
from inercal.host.link import LinkLost

_BEAT_INTERVAL = 0.1  # s
_START_TIMEOUT = 30.0  # s; the guard must be ready within this time
_EXIT_TIMEOUT = 10.0  # s; the guard must end within this time, even while it connects


class Guard(Closeable):
    """The host's connection to the watchdog process of a table.

    An object must only be used in one thread; it sends signals to the main thread.

    Parameters
    ----------
    address : str
        Address of the table; see `inercal.host.addresses.open_table`.
    silence : float
        Time without a heartbeat after which the table is stopped, s.
    patience : float
        Time for which a watchdog without a host tries to reach a lost table, s. A simulated table
        may have ended together with its host.

    Attributes
    ----------
    signal_received : bool
        Whether a signal was received within `catch_signals`.
    axis_killed : bool
        Whether the watchdog has reported that it killed an axis that did not slow down.

    Raises
    ------
    LinkLost
        The watchdog cannot reach the table.
    """

    def __init__(self, address: str, silence: float = 1.5, patience: float = 600.0):
        self.signal_received = self.axis_killed = False
        self._received, self._beat_time = b"", -inf
        self._released = False
        command = [sys.executable, "-P", "-m", "inercal.host.guard.watchdog", address]
        command += ["--silence", str(silence), "--patience", str(patience)]
        # The process has a separate session, so a terminal cannot send signals to it or end it.
        self._process = Popen(command, 0, None, PIPE, PIPE, STDOUT, start_new_session=True)
        assert self._process.stdin
        assert self._process.stdout
        self._pipe, self._lines = self._process.stdin.fileno(), self._process.stdout.fileno()
        os.set_blocking(self._pipe, False)
        os.set_blocking(self._lines, False)
        _guards.add(self)
        with on_failure(self.close):
            self._wait_until_ready()

    @property
    def alive(self) -> bool:
        """Whether the watchdog is running; without it, the table must not move unattended."""
        return self._process.poll() is None

    def beat(self) -> None:
        """Send a heartbeat, at most every 0.1 s; this never waits."""
        now = monotonic()
        if now - self._beat_time >= _BEAT_INTERVAL:
            self._beat_time = now
            self._write(b".")

    def stop(self) -> bool:
        """Request an immediate stop of the table; return False if no watchdog can receive it."""
        return self._write(b"s") and self.alive

    def read_lines(self) -> list[str]:
        """Return the lines that the watchdog wrote since the last call; this never waits."""
        with suppress(OSError):
            while data := os.read(self._lines, 1 << 16):
                self._received += data
        *ended, self._received = self._received.split(b"\n")
        lines = [line.decode("utf-8", "replace") for line in ended]
        self.axis_killed |= any(line.startswith("killed") for line in lines)
        return lines

    @contextmanager
    def catch_signals(self) -> Generator[None]:
        """Let SIGINT and SIGTERM stop the table during the block; only for the main thread.

        The signal handler in C writes directly to the pipe, whatever the interpreter is doing.
        """

        def interrupted(*_: object) -> None:
            self.signal_received = True

        before = signal.set_wakeup_fd(self._pipe, warn_on_full_buffer=False)
        both = (signal.SIGINT, signal.SIGTERM)
        handlers = {number: signal.signal(number, interrupted) for number in both}
        try:
            yield
        finally:
            for number, handler in handlers.items():
                signal.signal(number, signal.SIG_DFL if handler is None else handler)
            signal.set_wakeup_fd(before)

    def release_to_guard(self) -> None:
        """Leave the table to the watchdog, which ends when the table is at rest."""
        self._close_pipe()
        self._released = True

    def close(self) -> None:
        """Tell the watchdog to end, and wait for its end; a second call does nothing."""
        if self._released:
            _guards.discard(self)
            _detached_processes.append(self._process)
            return
        self._write(b"q")
        self._close_pipe()
        try:
            self._process.wait(_EXIT_TIMEOUT)
        except TimeoutExpired:
            self._process.kill()
            self._process.wait()
        _guards.discard(self)
        if self._lines >= 0 and self._process.stdout:
            self._received = (
                b"".join(f"{line}\n".encode() for line in self.read_lines()) + self._received
            )
            self._process.stdout.close()
            self._lines = -1

    def _wait_until_ready(self) -> None:
        end, lines = monotonic() + _START_TIMEOUT, list[str]()
        while "ready" not in lines:
            ended = not self.alive
            lines += self.read_lines()
            if ended or monotonic() > end:
                said = "; ".join(lines[-1:]).removeprefix("cannot: ")
                raise LinkLost(
                    "the guard process, which stops the table, did not start: "
                    f"{said or f'not ready within {_START_TIMEOUT:g} s'}; begin again"
                )
            select([self._lines], [], [], 0.1)

    def _write(self, data: bytes) -> bool:
        try:
            return os.write(self._pipe, data) == len(data)
        except OSError:  # the pipe is full or has no reader; `alive` shows the difference
            return False

    def _close_pipe(self) -> None:
        """Close the pipe, after making sure that no signal can write to it."""
        if self._pipe < 0:
            return
        with suppress(ValueError):  # only the main thread can have a wake-up descriptor
            other = signal.set_wakeup_fd(-1)
            if other not in (-1, self._pipe):
                signal.set_wakeup_fd(other)
        self._pipe = -1
        assert self._process.stdin
        self._process.stdin.close()


_guards: WeakSet[Guard] = WeakSet()
_detached_processes: list[Popen[bytes]] = []  # they end by themselves


def _close_pipes_after_fork() -> None:
    """Close the pipes in a forked process, because the watchdog must notice the host's end."""
    for guard in _guards:
        guard._close_pipe()  # pyright: ignore[reportPrivateUsage]


os.register_at_fork(after_in_child=_close_pipes_after_fork)
