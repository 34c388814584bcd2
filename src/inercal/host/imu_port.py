"""Reads the IMU's bytes in a separate thread, with the time at which they arrive.

A port holds 4 kB, at 921600 baud 45 ms: whatever the host does meanwhile, they are taken off it.
Their times serve to tie the IMU's clock to the table's at the start of a run, and nothing else.

`ImuReceiver` hands the bytes out tick by tick, and says what becomes of the port: lost, silent,
back again.
"""

from collections import deque
from collections.abc import Callable
from math import inf, isnan, nan
from threading import Condition, Thread
from time import monotonic
from typing import NamedTuple

from inercal.basics.errors import InercalError
from inercal.host.clock import Tick
from inercal.host.closeable import Closeable
from inercal.host.link import CONNECT_TIMEOUT, Link, LinkLost
from inercal.host.packets import PacketLayout

_MAX_BYTES = 1 << 16  # bytes at a time
_WAIT = 0.2  # s after which the thread looks whether it shall end
_MAX_STALE_BYTES = 1 << 20  # bytes; a link that gives as many at once gives without end


class ImuPort(Closeable):
    """The bytes that arrive over `link`.

    Parameters
    ----------
    link : Link
        Closed with the port. What waits in it already is thrown away: when that came is not known.
    layout : PacketLayout
        Of the packets.
    now : callable
        Returns the time of what comes, s.
    synchronous : bool
        The other end waits for the host, as a simulated bench does whose time is granted: no thread
        is needed, and `take` reads by itself.

    Attributes
    ----------
    address : str
        The link's.
    received_bytes : int
        Bytes that came since opening, whether or not they were taken.
    discarded_bytes : int
        Bytes that were thrown away on opening.

    Raises
    ------
    LinkLost
        The other end is gone already.
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
        try:
            while self.discarded_bytes < _MAX_STALE_BYTES and (stale := link.read(_MAX_BYTES, 0.0)):
                self.discarded_bytes += len(stale)
        except BaseException:
            link.close()
            raise
        self._thread: Thread | None = None
        if not synchronous:
            self._thread = Thread(target=self._read, name=f"reads {link.address}", daemon=True)
            self._thread.start()

    def take(
        self, total_bytes: int | None = None, timeout: float = 1.0
    ) -> list[tuple[float, bytes]]:
        """Return what arrived, with the time of arrival of each piece.

        Parameters
        ----------
        total_bytes : int, optional
            How many bytes in all since opening: exactly those are handed out. What is still under
            way is waited for; what is beyond stays for the next time.
        timeout : float
            s to wait at most.

        Raises
        ------
        LinkLost
            The other end is gone, and all that came before is handed out; or the bytes up to
            `total_bytes` do not come in time.
        """
        if self._thread is None:
            self._read_now(total_bytes, timeout)
        with self._condition:
            if (
                total_bytes is not None
                and self.received_bytes < total_bytes
                and self._error is None
            ):
                left = 0.0 if self._thread is None else timeout
                self._condition.wait_for(
                    lambda: self.received_bytes >= total_bytes or self._error is not None, left
                )
                if self.received_bytes < total_bytes and self._error is None:
                    missing = total_bytes - self.received_bytes
                    raise LinkLost(
                        f"{self.address}: {missing} bytes that the IMU sent have not arrived "
                        f"within {timeout:g} s; check the connection",
                        key="total_bytes",
                        names=(self.address,),
                    )
            upto = self.received_bytes if total_bytes is None else total_bytes
            pieces = self._pop_pieces(upto)
            if not pieces and not self._pieces and self._error is not None:
                raise LinkLost(str(self._error), names=(self.address,)) from self._error
            return pieces

    def close(self) -> None:
        """Stop reading, and close the link; a second call does nothing."""
        self._closed = True
        if self._thread is not None:
            self._thread.join()
        self._link.close()

    def _pop_pieces(self, total_bytes: int) -> list[tuple[float, bytes]]:
        """Hand out pieces up to so many bytes in all, the last one cut where it goes beyond."""
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
            total_bytes = (
                None  # nothing is due: whether the port is still there is asked all the same
            )
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
        """Read until the end, in the thread."""
        while not self._closed:
            lost: InercalError | None = None
            time, data = nan, b""
            try:
                data = self._link.read(_MAX_BYTES, _WAIT)
                time = self._now()
                if len(data) == 1:
                    # By its first byte a serial port says that there is something.
                    data += self._link.read(_MAX_BYTES, 0.0)
            except InercalError as error:  # the clock may be lost too
                lost = error
            except Exception as error:
                # Nobody would hear of a thread that ends otherwise: the IMU would be silent.
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
_RECOVERY_TIME = 1.0  # s of bytes from one that was silent, before it is trusted again
_RETRY_INTERVAL = 0.5  # s of the wall's between two tries to open a port
# s that such a try may take: the run stands still meanwhile, which the watchdog allows for 1.5 s.
# To look up a name the system takes its own time.
_REOPEN_TIMEOUT = 0.5


class ReceivedBytes(NamedTuple):
    """What arrived in a tick.

    Parameters
    ----------
    pieces : list of (float, bytes)
        With the run's time of each.
    reopened : bool
        The port was opened anew: these bytes do not follow those before.
    """

    pieces: list[tuple[float, bytes]]
    reopened: bool = False


class ImuReceiver:
    """Listens to an IMU, and opens its port again when it was lost.

    Parameters
    ----------
    opener : callable
        Opens the port within the s that it is given; raises `LinkLost` where it is not there.
    tick : Tick
        Of the bench when the port is opened first.

    Attributes
    ----------
    trouble : str or None
        What is wrong, in words; None while bytes come.
    trouble_since : float
        The run's time since when that is so.

    Raises
    ------
    LinkLost
        The port cannot be opened.
    """

    def __init__(self, opener: Callable[[float], ImuPort], tick: Tick):
        self._open = opener
        self._port: ImuPort | None = opener(CONNECT_TIMEOUT)
        # What a simulated bench had sent before; None: its bytes are taken as they come.
        self._sent_before_opening = tick.bytes_sent
        self._last_bytes_time, self._steady_since = tick.time, tick.time
        self._last_attempt_time, self._last_take_time = -inf, tick.time
        self.trouble: str | None = None
        self.trouble_since = tick.time

    def take(self, tick: Tick) -> ReceivedBytes:
        """Return the bytes that arrived by the tick; all of them, if the bench counts its bytes."""
        if tick.time - self._last_take_time > _SILENCE_LIMIT:
            # The host itself stood still: whether the IMU was silent meanwhile nobody knows.
            self._last_bytes_time = max(self._last_bytes_time, tick.time)
        self._last_take_time = tick.time
        opened = self._port is None and self._try_to_reopen(tick)
        if self._port is None:
            return ReceivedBytes([])
        try:
            if tick.bytes_sent is None or self._sent_before_opening is None:
                pieces = self._port.take()
            else:
                # Bytes of a simulated bench are of the time that the bench says, however they came.
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
        """Whether bytes arrive, whatever they contain."""
        return self._port is not None and self.trouble is None

    def close(self) -> None:
        """Close the port, if it is open."""
        if self._port is not None:
            self._port.close()

    def _try_to_reopen(self, tick: Tick) -> bool:
        """Try to open the port; return whether it worked."""
        if monotonic() - self._last_attempt_time < _RETRY_INTERVAL:
            return False
        try:
            self._port = self._open(_REOPEN_TIMEOUT)
        except LinkLost:
            return False
        finally:
            # From its end: a try may take as long as the time between two.
            self._last_attempt_time = monotonic()
        self._sent_before_opening = None  # how much of what was sent came before, nobody knows
        self._last_bytes_time = self._steady_since = tick.time
        return True

    def _update_trouble(self, now: float, some: bool) -> None:
        """Report whether bytes arrive as expected."""
        if now - self._last_bytes_time > _SILENCE_LIMIT and not some:
            self.set_trouble(f"the IMU has been silent for {_SILENCE_LIMIT:g} s", now)
        if some:
            if now - self._last_bytes_time > _SILENCE_LIMIT:
                self._steady_since = now
            self._last_bytes_time = now
            if self.trouble is not None and now - self._steady_since >= _RECOVERY_TIME:
                self.trouble = None

    def set_trouble(self, words: str, now: float) -> None:
        """Report a problem while it lasts: it counts as over 1 s after the last report."""
        self._steady_since = now
        if self.trouble is None:
            self.trouble, self.trouble_since = words, now
