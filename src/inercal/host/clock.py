"""Clock of a run: the host's monotonic clock, or the clock of a simulated bench.

The clock does not use UTC: a step of the host's date changes no time of a run, nor of a run that is
resumed.

`begin(until)` lets the bench advance to a time and returns at once; `end()` returns when the bench
has reached it, and meanwhile the host processes data. A simulated bench advances no further than
`until`, so that the speeds of host and bench change no number.

A simulated bench states how many bytes its IMU has sent by which time, and the host takes exactly
these; a real bench cannot state this.

**Protocol** of a simulated bench's clock, lines over TCP: the bench answers `until 12.5`, `now` and
`mounted NAME`, which states how an operator has mounted the sensor, by "TIME SENT SENT_BY", s,
bytes, s. The IMU makes the readings of the last interval while the host
polls the table: SENT counts up to the interval before, or up to the last one where the requested
time has passed already. Before the first `until` the clock rests at 0. Without an `until` for 5 s,
or without a connection, it follows the wall clock until the next `until`.
"""

import socket
from pathlib import Path
from struct import pack
from time import monotonic, sleep
from typing import NamedTuple
from urllib.parse import urlsplit

from inercal.basics.errors import InputError
from inercal.host.link import LinkLost, connect_socket, host_and_port

_ANSWER_TIMEOUT = 20  # s; of a bench whose machine is busy
_STALE_AFTER = 0.5  # s of the wall after which the last answer is asked for again
_MAX_CATCH_UP = 0.1  # s of the wall that a paced bench makes up for


class Tick(NamedTuple):
    """What time it is, s of the run, and what the IMU has sent by when."""

    time: float
    bytes_sent: int | None  # bytes in all; None where nobody knows
    sent_time: float


class HostUptime(NamedTuple):
    """Time since the host booted, s, including suspended time."""

    boot: str
    seconds: float


def read_host_uptime() -> HostUptime | None:
    """Return how long this host has been up; None if the system does not tell.

    Every process of a boot reads the same, so that it measures how long a run was without a host.
    """
    try:
        boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip()
        return HostUptime(boot, float(Path("/proc/uptime").read_text(encoding="ascii").split()[0]))
    except (OSError, ValueError, IndexError):
        return None


class MonotonicClock:
    """The host's monotonic clock, for a bench in real time.

    Parameters
    ----------
    start : float
        The run's time now, s.
    """

    def __init__(self, start: float):
        self._offset = start - monotonic()
        self._until = start

    def now(self) -> float:
        """Return the time on the bench, s of the run; another thread may ask too."""
        return monotonic() + self._offset

    def begin(self, until: float) -> None:
        """Let the bench advance to `until`; return at once."""
        self._until = until

    def end(self) -> Tick:
        """Return once the time given to `begin` is reached."""
        while (left := self._until - self.now()) > 0:
            sleep(left)
        now = self.now()
        return Tick(now, None, now)

    def mount(self, mounting: str) -> None:
        """Tell a simulated bench how its operator has mounted the sensor; here somebody has."""

    def close(self) -> None:
        """Release the bench."""


class SimulatedClock:
    """The clock of a simulated bench; `now` is what it last said, if that was not long ago.

    Parameters
    ----------
    address : str
        `clock://HOST:PORT`.
    speed : float, optional
        Most seconds of the bench in one of the wall's; None: as fast as it goes.

    Raises
    ------
    InputError
        An address of another form, or a speed that is not > 0.
    LinkLost
        No bench is there.
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
        # The system's own time limit: with that of Python each call asks twice.
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
        """As `MonotonicClock.now`; raises `LinkLost` where the bench is gone."""
        if not self._awaits_answer and monotonic() - self._answer_time > _STALE_AFTER:
            # The bench may have gone on by itself meanwhile.
            self._send(b"now\n")
            self._time = self._answer().time
        return self._time

    def begin(self, until: float) -> None:
        """As `MonotonicClock.begin`; raises `LinkLost` where the bench is gone."""
        if self._awaits_answer:
            raise RuntimeError("begin() was called twice; call end() before the next begin()")
        if self._speed is not None:
            # A pause is not made up for in haste, a late wake-up is.
            start = max(self._due_time, monotonic() - _MAX_CATCH_UP)
            self._due_time = start + max(until - self._time, 0.0) / self._speed
        self._send(f"until {float(until)!r}\n".encode())
        self._awaits_answer = True

    def end(self) -> Tick:
        """As `MonotonicClock.end`; raises `LinkLost` where the bench is gone."""
        if not self._awaits_answer:
            raise RuntimeError("end() was called without begin(); call begin() first")
        self._awaits_answer = False
        tick = self._answer()
        if self._speed is not None and (left := self._due_time - monotonic()) > 0:
            sleep(left)
        self._time = tick.time
        return tick

    def mount(self, mounting: str) -> None:
        """Have the sensor of the simulated bench mounted so; raises `LinkLost` without a bench."""
        if self._awaits_answer:
            raise RuntimeError("mount() between begin() and end()")
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
            now, sent, sent_time = line.split()
            return Tick(float(now), int(sent), float(sent_time))
        except ValueError as error:
            raise LinkLost(
                f"{self._address}: expected the time of a simulated bench, got {line[:40]!r}; "
                "check --clock"
            ) from error


Clock = MonotonicClock | SimulatedClock
