"""Reads the bytes of the IMU in a separate thread, with their arrival times.

A serial port buffers 4 kB, which is 45 ms of data at 921600 baud. A separate thread empties the
buffer in time, whatever else the host does. The arrival times are only used to relate the IMU's
clock to the table's clock at the start of a run.

`ImuReceiver` passes the bytes on tick by tick, and reports if the port is lost, silent or working
again.
"""

from collections import deque
from collections.abc import Callable
from math import inf, isnan, nan
from threading import Condition, Thread
from time import monotonic
from typing import NamedTuple

from inercal.basics.closeable import Closeable, on_failure
from inercal.basics.errors import InercalError
from inercal.host.clock import Tick
from inercal.host.link import CONNECT_TIMEOUT, Link, LinkLost
from inercal.host.packets import PacketLayout

_MAX_BYTES = 1 << 16  # bytes at a time
_WAIT = 0.2  # s between the thread's checks whether it must end
_MAX_STALE_BYTES = 1 << 20  # bytes; a link that delivers more at once never becomes empty


class ImuPort(Closeable):
    """Receives the bytes that arrive over a link.

    Parameters
    ----------
    link : Link
        Link to the IMU; it is closed together with the port. Bytes that are already waiting are
        discarded, because their arrival time is unknown.
    layout : PacketLayout
        Layout of the packets.
    now : callable
        Function that returns the present time, s, as the arrival time of bytes.
    synchronous : bool
        Whether the other end waits for the host, as a simulated bench does. No thread is needed in
        this case, because `take` reads the link.

    Attributes
    ----------
    address : str
        Address of the link.
    received_bytes : int
        Number of bytes received since the port was opened, whether they were taken or not.
    discarded_bytes : int
        Number of bytes that were discarded when the port was opened.

    Raises
    ------
    LinkLost
        The other end has already closed the connection.
    """

    def __init__(
        self,
        link: Link,
        layout: PacketLayout,
        now: Callable[[], float],
        *,
        synchronous: bool = False,
    ):
        self.layout, self.address = layout, link.address
        self.received_bytes = self.discarded_bytes = 0
        self._link, self._now = link, now
        self._pieces: deque[tuple[float, bytes]] = deque()
        self._taken_bytes = 0
        self._error: InercalError | None = None
        self._closed = False
        self._condition = Condition()
        with on_failure(link.close):
            while self.discarded_bytes < _MAX_STALE_BYTES and (stale := link.read(_MAX_BYTES, 0.0)):
                self.discarded_bytes += len(stale)
        self._thread: Thread | None = None
        if not synchronous:
            self._thread = Thread(target=self._read, name=f"reads {link.address}", daemon=True)
            self._thread.start()

    def take(
        self, total_bytes: int | None = None, timeout: float = 1.0
    ) -> list[tuple[float, bytes]]:
        """Return the bytes that arrived, in pieces with their arrival times.

        Parameters
        ----------
        total_bytes : int, optional
            Total number of bytes since opening, up to which bytes are taken. The method waits for
            bytes that have not arrived yet, and it keeps additional bytes for the next call.
        timeout : float
            Longest waiting time, s.

        Raises
        ------
        LinkLost
            The other end is gone and all received bytes have been taken, or the bytes up to
            `total_bytes` do not arrive in time.
        """
        if self._thread is None:
            self._read_now(total_bytes, timeout)
        with self._condition:
            upto = self.received_bytes if total_bytes is None else total_bytes
            left = 0.0 if self._thread is None else timeout
            if not self._condition.wait_for(
                lambda: self.received_bytes >= upto or self._error is not None, left
            ):
                raise LinkLost(
                    f"{self.address}: {upto - self.received_bytes} bytes that the IMU sent have "
                    f"not arrived within {timeout:g} s; check the connection",
                    key="total_bytes",
                    names=(self.address,),
                )
            pieces = self._pop_pieces(upto)
            if not pieces and not self._pieces and self._error is not None:
                raise LinkLost(str(self._error), names=(self.address,)) from self._error
            return pieces

    def close(self) -> None:
        """Stop reading and close the link; a second call does nothing."""
        self._closed = True
        if self._thread is not None:
            self._thread.join()
        self._link.close()

    def _pop_pieces(self, total_bytes: int) -> list[tuple[float, bytes]]:
        """Remove and return pieces up to a total number of bytes; split the last if necessary."""
        pieces: list[tuple[float, bytes]] = []
        while self._pieces and self._taken_bytes < total_bytes:
            time, data = self._pieces.popleft()
            if len(data) > total_bytes - self._taken_bytes:
                self._pieces.appendleft((time, data[total_bytes - self._taken_bytes :]))
                data = data[: total_bytes - self._taken_bytes]
            pieces.append((time, data))
            self._taken_bytes += len(data)
        return pieces

    def _read_now(self, total_bytes: int | None, timeout: float) -> None:
        """Read what is available, up to a number of bytes."""
        end = monotonic() + timeout
        if total_bytes is not None and self.received_bytes >= total_bytes:
            total_bytes = None  # no bytes are due, but the port is checked
        try:
            while self._error is None and (
                total_bytes is None or self.received_bytes < total_bytes
            ):
                left = 0.0 if total_bytes is None else end - monotonic()
                data = self._link.read(_MAX_BYTES, max(left, 0.0))
                if data:
                    self._pieces.append((self._now(), data))
                    self.received_bytes += len(data)
                elif left <= 0:
                    return
        except InercalError as error:
            self._error = error

    def _read(self) -> None:
        """Read until the port is closed; this runs in the thread."""
        while not self._closed:
            lost: InercalError | None = None
            time, data = nan, b""
            try:
                data = self._link.read(_MAX_BYTES, _WAIT)
                time = self._now()
                if len(data) == 1:
                    # A serial port reports data as soon as the first byte arrives.
                    data += self._link.read(_MAX_BYTES, 0.0)
            except InercalError as error:  # reading the clock may also fail
                lost = error
            except Exception as error:
                # Without this, nobody would notice the end of the thread, and the IMU would appear
                # silent.
                lost = LinkLost(
                    f"{self.address}: the connection is lost: {str(error) or type(error).__name__}"
                )
                lost.__cause__ = error
            if data or lost:
                with self._condition:
                    if data and not isnan(time):
                        self._pieces.append((time, data))
                        self.received_bytes += len(data)
                    self._error = lost
                    self._condition.notify_all()
            if lost:
                return


_SILENCE_LIMIT = 0.5  # s
_RECOVERY_TIME = 1.0  # s; a silent IMU must send bytes for this time to be trusted again
_RETRY_INTERVAL = 0.5  # s of wall time between two attempts to open a port
# Longest time of such an attempt, s. The run stands still during an attempt, which the watchdog
# tolerates for 1.5 s. The system's name lookup is not included in this time.
_REOPEN_TIMEOUT = 0.5


class ReceivedBytes(NamedTuple):
    """The bytes that arrived in one tick.

    Parameters
    ----------
    pieces : list of (float, bytes)
        Pieces of bytes, each with its arrival time (run time, s).
    reopened : bool
        Whether the port was opened again. If so, these bytes do not continue the earlier bytes.
    """

    pieces: list[tuple[float, bytes]]
    reopened: bool = False


class ImuReceiver:
    """Listens to an IMU, and opens its port again after the connection was lost.

    Parameters
    ----------
    opener : callable
        Function that opens the port within a given number of seconds, or raises `LinkLost`.
    tick : Tick
        Tick of the bench at which the port is first opened.

    Attributes
    ----------
    trouble : str or None
        Description of the problem; None while bytes arrive.
    trouble_since : float
        Run time at which the problem began, s.

    Raises
    ------
    LinkLost
        The port cannot be opened.
    """

    def __init__(self, opener: Callable[[float], ImuPort], tick: Tick):
        self._open = opener
        self._port: ImuPort | None = opener(CONNECT_TIMEOUT)
        # Bytes that a simulated bench sent before opening. None means that bytes are taken when
        # they arrive.
        self._sent_before_opening = tick.bytes_sent
        self._last_bytes_time, self._steady_since = tick.time, tick.time
        self._last_attempt_time, self._last_take_time = -inf, tick.time
        self.trouble: str | None = None
        self.trouble_since = tick.time

    def take(self, tick: Tick) -> ReceivedBytes:
        """Return the bytes that arrived before the tick; a simulated bench counts them exactly."""
        if tick.time - self._last_take_time > _SILENCE_LIMIT:
            # The host itself stood still, so it is unknown whether the IMU was silent meanwhile.
            self._last_bytes_time = max(self._last_bytes_time, tick.time)
        self._last_take_time = tick.time
        opened = self._port is None and self._try_to_reopen(tick)
        if self._port is None:
            return ReceivedBytes([])
        try:
            if tick.bytes_sent is None or self._sent_before_opening is None:
                pieces = self._port.take()
            else:
                # Bytes from a simulated bench get the time that the bench states, not their arrival
                # time.
                came = self._port.take(total_bytes=tick.bytes_sent - self._sent_before_opening)
                data = b"".join(piece for _, piece in came)
                pieces = [(tick.sent_time, data)] if data else []
        except LinkLost as error:
            self._port.close()
            self._port = None
            self.set_trouble(f"the IMU is gone: {error}", tick.time)
            return ReceivedBytes([])
        self._update_trouble(tick.time, bool(pieces))
        return ReceivedBytes(pieces, opened)

    @property
    def is_receiving(self) -> bool:
        """Return whether bytes arrive, even if they contain no packets."""
        return self._port is not None and self.trouble is None

    def close(self) -> None:
        """Close the port if it is open."""
        if self._port is not None:
            self._port.close()

    def _try_to_reopen(self, tick: Tick) -> bool:
        """Try to open the port, and return whether this worked."""
        if monotonic() - self._last_attempt_time < _RETRY_INTERVAL:
            return False
        try:
            self._port = self._open(_REOPEN_TIMEOUT)
        except LinkLost:
            return False
        finally:
            # The interval begins at the end of the attempt, which may take as long as the interval.
            self._last_attempt_time = monotonic()
        self._sent_before_opening = None  # the number of bytes sent before is unknown
        self._last_bytes_time = self._steady_since = tick.time
        return True

    def _update_trouble(self, now: float, some: bool) -> None:
        """Set or clear `trouble`, depending on whether bytes arrive as expected."""
        if now - self._last_bytes_time > _SILENCE_LIMIT and not some:
            self.set_trouble(f"the IMU has been silent for {_SILENCE_LIMIT:g} s", now)
        if some:
            if now - self._last_bytes_time > _SILENCE_LIMIT:
                self._steady_since = now
            self._last_bytes_time = now
            if self.trouble is not None and now - self._steady_since >= _RECOVERY_TIME:
                self.trouble = None

    def set_trouble(self, words: str, now: float) -> None:
        """Report a problem, which counts as solved 1 s after the last report."""
        self._steady_since = now
        if self.trouble is None:
            self.trouble, self.trouble_since = words, now
