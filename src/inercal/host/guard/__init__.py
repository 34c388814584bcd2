"""The watchdog: it stops the table on request, and when the heartbeat of the host fails.

The watchdog is a separate process with its own connection to the table, so that it can stop the
table although the host is blocked or has ended. It reads a pipe to which only the host writes::

    .           heartbeat; after the first, a gap of `silence` s is a reason to stop
    s           stop now; so are the bytes 2 and 15, which signal handlers write
    q           release the table and end
    end of file the host has ended: stop now, and end when the table is at rest

It writes lines: `ready`, `stopping: WHY`, `at rest`, `killed: WHY`, `cannot: WHY`. Between
`stopping` and `at rest` it stops any axis that turns again; the host must not command the table.

It stops by `RotaryTable.stop`, which sends the command before it waits for any answer: all axes
decelerate and are held. It kills an axis that does not
decelerate as its limits allow; that axis coasts. It measures the deceleration by the clock of the
controller, where there is one. It does not stop a table at rest whose servos are all off, as that
would switch them on. Where the link is lost, it connects again and stops again, until the table is
at rest.

This is no safety function: that is the hardware interlock.
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

from inercal.host.closeable import Closeable
from inercal.host.link import LinkLost

_BEAT_INTERVAL = 0.1  # s
_START_TIMEOUT = 30.0  # s that the guard may take to be ready
_EXIT_TIMEOUT = 10.0  # s that it may take to end, connecting perhaps


class Guard(Closeable):
    """The host's side of the guard of the table at `address`.

    One object serves one thread, and signals the main one.

    Parameters
    ----------
    address : str
        As `inercal.host.addresses.open_table` takes it.
    silence : float
        s without a beat after which the table is stopped.
    patience : float
        s that a guard without a host looks for a table that is gone. A simulated one may have ended
        with its host.

    Attributes
    ----------
    signal_received : bool
        A signal came within `catch_signals`.
    killed : bool
        It has said that it took the power off an axis, which did not slow down.

    Raises
    ------
    LinkLost
        The guard does not reach the table.
    """

    def __init__(self, address: str, silence: float = 1.5, patience: float = 600.0):
        self.signal_received = self.axis_killed = False
        self._received, self._beat_time = b"", -inf
        self._released = False
        command = [sys.executable, "-P", "-m", "inercal.host.guard.watchdog", address]
        command += ["--silence", str(silence), "--patience", str(patience)]
        # A session of its own: no terminal sends it a signal, or takes it along when it closes.
        self._process = Popen(command, 0, None, PIPE, PIPE, STDOUT, start_new_session=True)
        assert self._process.stdin
        assert self._process.stdout
        self._pipe, self._lines = self._process.stdin.fileno(), self._process.stdout.fileno()
        os.set_blocking(self._pipe, False)
        os.set_blocking(self._lines, False)
        _guards.add(self)
        try:
            self._wait_until_ready()
        except BaseException:
            self.close()
            raise

    @property
    def alive(self) -> bool:
        """Whether the guard runs; without one, a table must not be left alone."""
        return self._process.poll() is None

    def beat(self) -> None:
        """Send a heartbeat; never waits, and writes at most every 0.1 s."""
        now = monotonic()
        if now - self._beat_time >= _BEAT_INTERVAL:
            self._beat_time = now
            self._write(b".")

    def stop(self) -> bool:
        """Request a stop of the table now; False if no guard can receive it."""
        return self._write(b"s") and self.alive

    def read_lines(self) -> list[str]:
        """Return the lines that the guard wrote since the last call; never waits."""
        with suppress(OSError):
            while data := os.read(self._lines, 1 << 16):
                self._received += data
        *ended, self._received = self._received.split(b"\n")
        lines = [line.decode("utf-8", "replace") for line in ended]
        self.axis_killed |= any(line.startswith("killed") for line in lines)
        return lines

    @contextmanager
    def catch_signals(self) -> Generator[None]:
        """Have SIGINT and SIGTERM stop the table, from the main thread, while in the context.

        The system's handler writes to the guard's pipe by itself, whatever the interpreter does.
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
        """Leave the table to the guard, which ends when the table is at rest."""
        self._close_pipe()
        self._released = True

    def close(self) -> None:
        """Tell the guard to end, and wait for it; a second call does nothing."""
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
        except OSError:  # full, or nobody there: `alive` tells
            return False

    def _close_pipe(self) -> None:
        """Close the pipe, which no signal may write to then."""
        if self._pipe < 0:
            return
        with suppress(ValueError):  # only the main thread has one
            other = signal.set_wakeup_fd(-1)
            if other not in (-1, self._pipe):
                signal.set_wakeup_fd(other)
        self._pipe = -1
        assert self._process.stdin
        self._process.stdin.close()


_guards: WeakSet[Guard] = WeakSet()
_detached_processes: list[Popen[bytes]] = []  # they end by themselves, and are not to be waited for


def _close_pipes_after_fork() -> None:
    """Close in a forked process what would hide the host's end from the guard."""
    for guard in _guards:
        guard._close_pipe()  # pyright: ignore[reportPrivateUsage]


os.register_at_fork(after_in_child=_close_pipes_after_fork)
