"""The IMU's bytes tick by tick, and what becomes of the port: lost, silent, back again."""

from collections.abc import Callable
from math import inf
from time import monotonic
from typing import NamedTuple

from inercal.host.clock import Tick
from inercal.host.imu_port import ImuPort
from inercal.host.link import CONNECT_TIMEOUT, LinkLost

_SILENCE_LIMIT = 0.5  # s
_RECOVERY_TIME = 1.0  # s of bytes from one that was silent, before it is trusted again
_RETRY_INTERVAL = 0.5  # s of the wall's between two tries to open a port
# s that such a try may take: the run stands still meanwhile, which the watchdog allows for 1.5 s.
# To look up a name the system takes its own time.
_REOPEN_TIMEOUT = 0.5


class ReceivedBytes(NamedTuple):
    """What a tick brought.

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
        """Return the bytes that came by the tick: of a bench that counts them, to the last one."""
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
        """Bytes come, whatever is in them."""
        return self._port is not None and self.trouble is None

    def close(self) -> None:
        """Close the port, if it is open."""
        if self._port is not None:
            self._port.close()

    def _try_to_reopen(self, tick: Tick) -> bool:
        """Try to open the port; True where that was possible."""
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
        """Say whether bytes come as they should."""
        if now - self._last_bytes_time > _SILENCE_LIMIT and not some:
            self.set_trouble(f"the IMU has been silent for {_SILENCE_LIMIT:g} s", now)
        if some:
            if now - self._last_bytes_time > _SILENCE_LIMIT:
                self._steady_since = now
            self._last_bytes_time = now
            if self.trouble is not None and now - self._steady_since >= _RECOVERY_TIME:
                self.trouble = None

    def set_trouble(self, words: str, now: float) -> None:
        """State what is wrong, while it lasts: trouble ends 1 s after it was stated last."""
        self._steady_since = now
        if self.trouble is None:
            self.trouble, self.trouble_since = words, now
