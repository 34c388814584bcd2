"""A Turbo PMAC on Ethernet, written from the manual's words alone: nothing here is the simulator's.

It takes what one read of the socket gives for one request, as the manual speaks of packets: a
second request in the same packet is lost. Replies leave in pieces of two bytes. Time is this
machine's monotonic clock; each request is kept with the time at which it was read.

Source: Delta Tau, Turbo PMAC User Manual, "Turbo PMAC Ethernet Protocol"; Turbo PMAC Software
Reference Manual, on-line commands `J+`, `J/`, `^A`, `P`, `V`, `F`, `?`.
"""

import re
import socket
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from threading import Event, RLock, Thread
from time import monotonic

I10 = 3713707
CYCLE = I10 / 8388608e3  # s
COUNTS_PER_TURN = 3_600_000
_TOKEN = re.compile(
    r"\s*(?:I(\d+)=(I?)([\d.]+)|I(\d+)|#(\d+)|(J[+/-])|(RHX\$0)|([PVFK?]))", re.IGNORECASE
)
Ignores = Callable[[str, int], bool]


@dataclass
class _Motor:
    """A motor whose rate changes evenly towards the rate that it was told, counts/ms."""

    closed: bool = True
    since: float = 0.0  # ms
    position: float = 0.0
    rate: float = 0.0
    wanted: float = 0.0
    acceleration: float = 1.0

    def settle(self, now: float) -> None:
        """Bring position and rate up to a time, ms."""
        passed, change = now - self.since, self.wanted - self.rate
        during = min(passed, abs(change) / self.acceleration)
        reached = self.rate + (change and change / abs(change)) * self.acceleration * during
        self.position += (self.rate + reached) / 2 * during + reached * (passed - during)
        self.rate, self.since = self.wanted if during < passed else reached, now

    def tell(self, now: float, wanted: float, acceleration: float) -> None:
        self.settle(now)
        self.closed, self.wanted, self.acceleration = True, wanted, acceleration


class StrictPmac:
    """A controller of three motors; a context manager, whose `address` a driver opens.

    Parameters
    ----------
    delay : float
        s from a request to its reply.
    ignores : callable
        Takes a request ("^A", "FLUSH", or a command line) and the number of its connection, from
        0; what it says True of is neither carried out nor answered.

    Attributes
    ----------
    requests : list of (float, int, str)
        Time, number of the connection, and request.
    """

    def __init__(self, delay: float = 0.0, ignores: Ignores = lambda request, connection: False):
        self._delay, self._ignores = delay, ignores
        self._lock, self._closed = RLock(), Event()
        self._motors = {n: _Motor() for n in (1, 2, 3)}
        self._variables = {10: float(I10)}
        for n in self._motors:
            # Activated; 400 °/s and 2000 °/s² in counts and ms, the same for aborts.
            of_motor = {0: 1, 11: 0, 13: 0, 14: 0, 15: 20, 16: 4000, 17: 20, 19: 20, 22: 1, 60: 0}
            self._variables |= {100 * n + k: float(value) for k, value in of_motor.items()}
        self.requests: list[tuple[float, int, str]] = []
        self._connections: list[socket.socket] = []
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{self.port}"
        self._threads = [Thread(target=self._accept)]

    def __enter__(self) -> "StrictPmac":
        self._threads[0].start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closed.set()
        with self._lock:
            for end in (self._listener, *self._connections):
                with suppress(OSError):  # the host may have closed it
                    end.shutdown(socket.SHUT_RDWR)
        for thread in list(self._threads):
            thread.join()
        for end in (self._listener, *self._connections):
            end.close()

    def is_at_rest(self) -> bool:
        """Tell whether no motor turns now."""
        with self._lock:
            for motor in self._motors.values():
                motor.settle(monotonic() * 1e3)
            return all(motor.rate == 0 for motor in self._motors.values())

    def times(self, request: str, connection: int | None = None) -> list[float]:
        """Return when requests came that contain a text."""
        with self._lock:
            return [
                time
                for time, number, line in self.requests
                if request in line and connection in (None, number)
            ]

    def _accept(self) -> None:
        while not self._closed.is_set():
            try:
                end, _ = self._listener.accept()
            except OSError:
                return
            end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            with self._lock:
                thread = Thread(target=self._serve, args=(end, len(self._connections)))
                self._connections.append(end)
                self._threads.append(thread)
                thread.start()

    def _serve(self, end: socket.socket, number: int) -> None:
        try:
            while packet := end.recv(1500):
                reply = self._answer(packet, number)
                if reply and self._delay:
                    self._closed.wait(self._delay)
                for k in range(0, len(reply), 2):
                    end.sendall(reply[k : k + 2])
        except OSError:
            return

    def _answer(self, packet: bytes, number: int) -> bytes:
        """Carry out the first request of a packet; return its reply."""
        kind, what, value = packet[0], packet[1], packet[2]
        line = {(0x40, 0xB3): "FLUSH", (0xC0, 0xC4): f"^{chr(value | 0x40)}"}.get(
            (kind, what), packet[8 : 8 + int.from_bytes(packet[6:8], "big")].decode("ascii")
        )
        with self._lock:
            now = monotonic()
            self.requests.append((now, number, line))
            if self._ignores(line, number):
                return b""
            if line == "FLUSH":
                return b"@"
            if line == "^A":
                for n, motor in self._motors.items():
                    motor.tell(now * 1e3, 0.0, self._variables[100 * n + 15])
                return b"\x06"
            return "".join(f"{text}\r" for text in self._execute(line, now)).encode() + b"\x06"

    def _execute(self, line: str, now: float) -> list[str]:
        said: list[str] = []
        at, addressed = 0, 1
        while at < len(line):
            found = _TOKEN.match(line, at)
            assert found, line[at:]
            at = found.end()
            variable, of, value, asked, motor, jog, clock, query = found.groups()
            if variable:
                self._variables[int(variable)] = self._variables[int(value)] if of else float(value)
            elif asked:
                said.append(f"{self._variables[int(asked)]:.9f}".rstrip("0").rstrip("."))
            elif motor:
                addressed = int(motor)
            elif jog:
                self._jog(addressed, jog[1], now)
            elif clock:
                said.append(f"{int(now / CYCLE) & 0xFFFFFF:X}")
            elif query.upper() == "K":
                self._motors[addressed].closed = False
            else:
                said.append(self._report(addressed, query, now))
        return said

    def _jog(self, n: int, way: str, now: float) -> None:
        rate = {"+": 1, "-": -1, "/": 0}[way] * self._variables[100 * n + 22]
        self._motors[n].tell(now * 1e3, rate, self._variables[100 * n + 19])

    def _report(self, n: int, query: str, now: float) -> str:
        motor = self._motors[n]
        motor.settle(now * 1e3)
        match query.upper():
            case "P":
                return f"{motor.position:.1f}"
            case "V":
                return f"{motor.rate * CYCLE * 1e3:.1f}"
            case "F":
                return "0"
            case _:
                rests = motor.rate == motor.wanted == 0
                first = 1 << 23 | motor.closed << 19 | (not motor.closed) << 18 | rests << 13
                return f"{first:06X}{1 << 10 | rests:06X}"
