"""Relay bytes between a driver and a simulator, and break the link on request.

All bytes from the driver are passed on. Replies pass through `change`, which may garble or swallow
them. A link that is unplugged ends at once, and so does each new connection.

What the checks of a driver have in common: opening, waiting, and expecting an error.
"""

import re
import socket
from collections.abc import Callable, Generator
from contextlib import closing, suppress
from math import degrees
from selectors import EVENT_READ, DefaultSelector
from threading import Event, RLock, Thread
from time import monotonic
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from inercal.basics.closeable import Closeable, on_failure
from inercal.host.addresses import open_table
from inercal.host.drivers.rotary_table import ProtocolError, RotaryTable, TableFault, TableState
from inercal.host.equipment import Chamber
from inercal.host.link import LinkLost, connect_socket

if TYPE_CHECKING:
    from inercal.benches.motion_control import ControlledBench


_SIZE = 1 << 16
_CONNECT_TIMEOUT = 2.0  # s; the simulator runs on this machine

Change = Callable[[bytes], bytes]


def unchanged(reply: bytes) -> bytes:
    """Pass the reply on."""
    return reply


# Replies that no protocol permits, by what is wrong with them.
MALFORMED: dict[str, Change] = {
    "letters for digits": lambda reply: re.sub(rb"[0-9]", b"x", reply),
    "a byte that is not ASCII": lambda reply: bytes([reply[0] | 0x80]) + reply[1:],
    "only the end of a reply": lambda reply: re.findall(rb"[^\w?.+-]*$", reply)[0],
    "half a reply": lambda reply: reply[: len(reply) // 2],
}


class Relay(Closeable):
    """Listens on a port of this machine, and connects to the simulator for each connection.

    Parameters
    ----------
    place : (str, int)
        Host and port of the simulator.

    Attributes
    ----------
    port : int
        Port to which the driver connects.
    change : callable
        Function that returns the bytes to send instead of a reply.
    unplugged : bool
        Whether new connections end at once; see `unplug`.
    held : list of (socket, bytes) or None
        Replies that are kept for `release`; None if replies are sent at once.
    received_bytes : int
        Number of bytes that came from the driver.
    is_binary : bool
        Whether a reply contained a zero byte, so that its digits are not text.
    connections : int
        Number of open connections.
    """

    def __init__(self, place: tuple[str, int]):
        self.change: Change = unchanged
        self.unplugged, self.received_bytes, self.is_binary = False, 0, False
        self.held: list[tuple[socket.socket, bytes]] | None = None
        self._place = place
        self._peers: dict[socket.socket, socket.socket] = {}
        self._drivers = set[socket.socket]()
        self._lock, self._stopped, self._idle = RLock(), False, Event()
        self._selector = DefaultSelector()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._wake, self._woken = socket.socketpair()
        self.port: int = self._listener.getsockname()[1]
        for end in (self._listener, self._woken):
            self._selector.register(end, EVENT_READ)
        self._thread = Thread(target=self._run, name="relay", daemon=True)
        self._thread.start()

    @property
    def connections(self) -> int:
        """The number of open connections."""
        with self._lock:
            return len(self._drivers)

    def unplug(self) -> None:
        """End all connections, and refuse new ones until `mend`."""
        with self._lock:
            self.unplugged = True
            for end in list(self._drivers):
                self._end(end)

    def silence(self) -> None:
        """Swallow all replies until `mend`."""
        self.change = lambda _: b""

    def mend(self) -> None:
        """Pass everything on again; connections that are open stay open."""
        with self._lock:
            self.change, self.unplugged, self.held = unchanged, False, None

    def release(self) -> None:
        """Send the replies that were held, on the connections that are still open."""
        with self._lock:
            for end, reply in self.held or ():
                if end in self._drivers:
                    with suppress(OSError):
                        end.sendall(reply)
            self.held = None

    def wait_for_bytes(self, timeout: float) -> None:
        """Wait until nothing is on the way from the driver, or for `timeout` s."""
        with self._lock:
            self._idle.clear()
        self._wake.send(b".")
        self._idle.wait(timeout)

    def close(self) -> None:
        """End all connections."""
        self._stopped = True
        self._wake.send(b".")
        self._thread.join()
        with self._lock:
            for end in list(self._drivers):
                self._end(end)
        for end in (self._listener, self._wake, self._woken):
            end.close()
        self._selector.close()

    def _run(self) -> None:
        while not self._stopped:
            ready = [key.fileobj for key, _ in self._selector.select()]
            with self._lock:
                for end in ready:
                    if end is self._listener:
                        self._accept()
                    elif end is not self._woken and end in self._peers:
                        self._pass_on(end)  # pyright: ignore[reportArgumentType]
                if ready == [self._woken]:
                    self._woken.recv(_SIZE)
                    self._idle.set()

    def _accept(self) -> None:
        driver, _ = self._listener.accept()
        if self.unplugged:
            driver.close()
            return
        try:
            device = connect_socket("simulator", self._place, _CONNECT_TIMEOUT)
        except Exception:  # the simulator is gone, and so is the link
            driver.close()
            return
        driver.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._drivers.add(driver)
        for end, other in ((driver, device), (device, driver)):
            self._peers[end] = other
            self._selector.register(end, EVENT_READ)

    def _pass_on(self, end: socket.socket) -> None:
        try:
            data = end.recv(_SIZE)
            self.is_binary |= end not in self._drivers and b"\0" in data
            if end in self._drivers:
                self.received_bytes += len(data)
            elif data and self.held is not None:
                self.held.append((self._peers[end], data))
                return
            elif data:
                data = self.change(data) or None
            if data:
                self._peers[end].sendall(data)
        except OSError:
            data = b""
        if data == b"":
            self._end(end)

    def _end(self, end: socket.socket) -> None:
        for one in (end, self._peers[end]):
            self._selector.unregister(one)
            self._drivers.discard(one)
            del self._peers[one]
            one.close()


GRACE = 3.0  # s, in addition to the time of a motion
_DETECTION_TIME = 1.0  # s, in addition to twice the timeout, as a driver may connect again
_ATTEMPTS = 3  # readings after an error, of which one must work


class CheckFailed(Exception):
    """A driver does not do what a check expects; `str(error)` says what it did instead."""


def require(condition: bool, otherwise: str) -> None:
    """Raise a `CheckFailed` if a condition is not true."""
    if not condition:
        raise CheckFailed(otherwise)


D = TypeVar("D", RotaryTable, Chamber)


class LinkProbe(Generic[D]):
    """A driver whose link to the simulator the checks can break.

    `opener` opens the device at an address. For the other arguments, see `check_driver`.
    """

    def __init__(
        self,
        address: str,
        timeout: float,
        now: Callable[[], float],
        relay: Relay,
        opener: Callable[[str, float], D],
    ):
        self.timeout, self.now, self.relay, self._opener = timeout, now, relay, opener
        self._address = re.sub(r"//[^/?#]*", f"//127.0.0.1:{relay.port}", address, count=1)

    def open(self) -> D:
        """Open the device through the relay."""
        return self._opener(self._address, self.timeout)

    def bring_to_rest(self) -> None:
        """Mend the link, and stop the device, as far as the driver can."""
        self.relay.mend()
        # The check of `stop` reports what fails here.
        with suppress(Exception), closing(self.open()) as device:
            device.stop()
            self.wait_for_rest(device)

    def wait_for_rest(self, device: D) -> None:
        """Wait until a stopped device is at rest; a chamber need not be."""

    def expect_error(self, act: Callable[[], object], what: str) -> float:
        """Return the wall time in which a call raised a documented error, s."""
        begun = monotonic()
        try:
            act()
        except (LinkLost, ProtocolError, TableFault):
            took = monotonic() - begun
            limit = 2 * self.timeout + _DETECTION_TIME
            require(took < limit, f"{what}: the error came only after {took:.2f} s")
            return took
        raise CheckFailed(f"{what}: no error was raised")

    def read_after_losses(self, device: D) -> Generator[Any]:
        """Yield a reading after the link was unplugged, and one after it was silent."""
        for what, cut in (("unplugged", self.relay.unplug), ("silent", self.relay.silence)):
            cut()
            with suppress(LinkLost, ProtocolError, TableFault):
                device.read()  # the check of a lost link requires an error
            self.relay.mend()
            yield self.read_again(device, f"after the link was {what}")

    def read_again(self, device: D, after: str) -> Any:
        """Return a reading after an error; the first ones may fail."""
        for left in reversed(range(_ATTEMPTS)):
            try:
                return device.read()
            except (LinkLost, ProtocolError, TableFault) as error:
                require(left > 0, f"{after}: {_ATTEMPTS} readings failed: {error}")
        raise AssertionError


class Probe(LinkProbe[RotaryTable]):
    """A driver of a table; `bench` names its axes."""

    def __init__(
        self,
        address: str,
        bench: "ControlledBench | None",
        timeout: float,
        now: Callable[[], float],
        relay: Relay,
    ):
        self.bench = bench
        super().__init__(address, timeout, now, relay, lambda at, s: open_table(at, bench, s))

    def open_enabled(self) -> RotaryTable:
        """Open the table, and switch on its servos."""
        table = self.open()
        with on_failure(table.close):
            table.enable()
            self.wait(table, lambda now: all(a.enabled for a in now.axes), 0.0, "is not enabled")
        return table

    def wait(
        self, table: RotaryTable, done: Callable[[TableState], bool], seconds: float, otherwise: str
    ) -> TableState:
        """Read the table until `done`; it may take `seconds` and `GRACE` longer."""
        end = self.now() + seconds + GRACE
        while True:
            late = self.now() > end
            state = table.read()
            if done(state):
                return state
            if late:
                at = ", ".join(f"{degrees(a.angle):.3f}° ({a.status_text})" for a in state.axes)
                raise CheckFailed(f"the table {otherwise} within {seconds + GRACE:.1f} s: {at}")

    def wait_for_rest(self, device: RotaryTable) -> None:
        """See `LinkProbe.wait_for_rest`."""
        self.wait(device, lambda state: all(a.rests for a in state.axes), 0.0, "turns")
