"""Keep the time of a run, by the host's monotonic clock or the clock of a simulated bench.

The clock does not use UTC. Setting the date of the host therefore changes no time in a run, not
even in a resumed run.

`begin(until)` lets the bench advance to a time and returns at once, so the host can process data in
the meantime. `end()` returns when the bench has reached this time. A simulated bench never advances
beyond `until`, so the speeds of host and bench do not affect any result.

A simulated bench reports the number of bytes that its IMU has sent and the time of this count, and
the host takes exactly these bytes. A real bench cannot report this.

**Protocol** of a simulated bench's clock, as lines over TCP: the host sends `until 12.5`, `now` or
`mounted NAME`, which states how an operator has mounted the sensor. The bench answers each line
with "TIME SENT SENT_BY", in s, bytes and s, followed by SENT of each further IMU. The IMU computes
the readings of the last interval while the host polls the table. SENT therefore counts the bytes
before this interval, or all bytes if the requested time has already passed. Before the first
`until`, the clock stands at 0. If there is no `until` for 5 s, or no connection, the clock follows
the wall clock until the next `until`.
"""

import socket
from pathlib import Path
from struct import pack
from time import monotonic, sleep
from typing import NamedTuple
from urllib.parse import urlsplit

from inercal.basics.errors import InputError
from inercal.host.link import LinkLost, connect_socket, host_and_port

_ANSWER_TIMEOUT = 20  # s; long enough for a bench on a busy machine
_STALE_AFTER = 0.5  # s of wall time; after this, the clock is queried again
_MAX_CATCH_UP = 0.1  # s of wall time; a paced bench makes up for at most this delay


class Tick(NamedTuple):
    """The run time in s, and counts of the bytes that the IMUs have sent, with their time."""

    time: float
    bytes_sent: int | None  # total number of bytes; None if unknown
    sent_time: float
    further_bytes: tuple[int, ...] = ()  # the same for each further IMU of a simulated bench


class HostUptime(NamedTuple):
    """The time since the host booted, s, including times during which it was suspended."""

    boot: str
    seconds: float


def read_host_uptime() -> HostUptime | None:
    """Return the time since this host booted; None if the system does not report it.

    All processes read the same clock until the next boot, so it shows how long a run had no host.
    """
    try:
        boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip()
        return HostUptime(boot, float(Path("/proc/uptime").read_text(encoding="ascii").split()[0]))
    except (OSError, ValueError, IndexError):
        return None


class MonotonicClock:
    """The host's monotonic clock, for a bench that runs in real time.

    Parameters
    ----------
    start : float
        Run time at this moment, s.
    """

    def __init__(self, start: float):
        self._offset = start - monotonic()
        self._until = start

    def now(self) -> float:
        """Return the run time, s; any thread may call this."""
        return monotonic() + self._offset

    def begin(self, until: float) -> None:
        """Let the bench advance to `until`, and return at once."""
        self._until = until

    def end(self) -> Tick:
        """Wait until the time given to `begin`, and then return the tick."""
        while (left := self._until - self.now()) > 0:
            sleep(left)
        now = self.now()
        return Tick(now, None, now)

    def mount(self, mounting: str) -> None:
        """Report a mounting to the bench; on a real bench this does nothing."""

    def close(self) -> None:
        """Release the bench."""


class SimulatedClock:
    """The clock of a simulated bench; `now` returns the last answer if it is recent enough.

    Parameters
    ----------
    address : str
        `clock://HOST:PORT`.
    speed : float, optional
        Highest speed, in bench seconds per second of wall time; None means as fast as possible.

    Raises
    ------
    InputError
        The address is malformed, or the speed is not > 0.
    LinkLost
        No simulated bench answers.
    """

    def __init__(self, address: str, speed: float | None = None):
        if speed is not None and not speed > 0:
            raise InputError(
                f"speed {speed} is not possible; it must be more than 0", key="--speed"
            )
        self._address, self._speed = address, speed
        parts = urlsplit(address)
        place = host_and_port(parts)
        if parts.scheme != "clock" or place is None:
            raise InputError(
                f"{address!r} is not the address of a clock; possible: clock://127.0.0.1:4000",
                key="--clock",
            )
        self._socket = connect_socket(address, place, _ANSWER_TIMEOUT)
        # The timeout is set in the system, because Python's timeout needs an additional system call
        # for each answer.
        self._socket.settimeout(None)
        limit = pack("@ll", _ANSWER_TIMEOUT, 0)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, limit)
        self._received = b""
        self._due_time = monotonic()
        self._awaits_answer = False
        self._time, self._answer_time = 0.0, monotonic()
        self._send(b"now\n")
        self._time = self._answer().time

    def now(self) -> float:
        """Return the run time, s; raises `LinkLost` if the bench is gone."""
        if not self._awaits_answer and monotonic() - self._answer_time > _STALE_AFTER:
            # The bench may have advanced by itself in the meantime.
            self._send(b"now\n")
            self._time = self._answer().time
        return self._time

    def begin(self, until: float) -> None:
        """Let the bench advance to `until`; raises `LinkLost` if the bench is gone."""
        if self._awaits_answer:
            raise RuntimeError("begin() was called twice; call end() before the next begin()")
        if self._speed is not None:
            # The bench makes up for a late wake-up, but not for a pause.
            start = max(self._due_time, monotonic() - _MAX_CATCH_UP)
            self._due_time = start + max(until - self._time, 0.0) / self._speed
        self._send(f"until {float(until)!r}\n".encode())
        self._awaits_answer = True

    def end(self) -> Tick:
        """Wait until the time is reached; raises `LinkLost` if the bench is gone."""
        if not self._awaits_answer:
            raise RuntimeError("end() was called without begin(); call begin() first")
        self._awaits_answer = False
        tick = self._answer()
        if self._speed is not None and (left := self._due_time - monotonic()) > 0:
            sleep(left)
        self._time = tick.time
        return tick

    def mount(self, mounting: str) -> None:
        """Report a mounting to the simulated bench; raises `LinkLost` if the bench is gone."""
        if self._awaits_answer:
            raise RuntimeError("mount() was called between begin() and end(); call end() first")
        self._send(b"mounted " + mounting.encode() + b"\n")
        self._time = self._answer().time

    def close(self) -> None:
        """Release the bench; its clock then follows the wall clock."""
        self._socket.close()

    def _send(self, line: bytes) -> None:
        try:
            self._socket.sendall(line)
        except OSError as error:
            raise self._lost(error) from error

    def _lost(self, error: OSError) -> LinkLost:
        return LinkLost(
            f"{self._address}: the connection to the simulated bench is lost: "
            f"{error.strerror or error}; begin a new run"
        )

    def _answer(self) -> Tick:
        while b"\n" not in self._received:
            try:
                data = self._socket.recv(4096)
            except BlockingIOError as error:
                raise LinkLost(
                    f"{self._address}: the simulated bench did not answer within "
                    f"{_ANSWER_TIMEOUT} s; begin a new run"
                ) from error
            except OSError as error:
                raise self._lost(error) from error
            if not data:
                raise LinkLost(
                    f"{self._address}: the simulated bench has closed the connection; begin a new "
                    "run"
                )
            self._received += data
        line, _, self._received = self._received.partition(b"\n")
        self._answer_time = monotonic()
        try:
            now, sent, sent_time, *further = line.split()
            return Tick(float(now), int(sent), float(sent_time), tuple(map(int, further)))
        except ValueError as error:
            raise LinkLost(
                f"{self._address}: expected the time of a simulated bench, got {line[:40]!r}; "
                "check --clock"
            ) from error


Clock = MonotonicClock | SimulatedClock
