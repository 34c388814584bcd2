"""Exchanges text lines with a controller whose replies end with a known byte.

If a reply is not complete in time, the link is closed and a new one is opened. Over TCP this is
sufficient, because bytes sent to the old connection cannot arrive on the new one. A serial port is
read until it has been silent for the timeout; an even later reply would be taken for the reply to
the next line, and nothing in such a protocol could show this.
"""

from collections.abc import Callable

from inercal.host.closeable import Closeable, on_failure
from inercal.host.drivers.rotary_table import ProtocolError
from inercal.host.link import Link, LinkLost, read_until

_MAX_STRAY_READS = 20  # reads of bytes that still arrive
_MAX_REPLY_SIZE = 1 << 16  # bytes; real replies are far shorter


class TextDialogue(Closeable):
    """A connection to the controller at `address`.

    Parameters
    ----------
    address : str
        An address as in `open_link`.
    ending : bytes
        The byte at the end of each reply.
    timeout : float
        Longest time for a complete reply, s.
    opener : callable
        Opens a link to an address; tests supply their own.
    """

    def __init__(self, address: str, ending: bytes, timeout: float, opener: Callable[[str], Link]):
        self.address = address
        self._ending, self._timeout, self._opener = ending, timeout, opener
        self._link: Link | None = opener(address)

    def ask(self, line: bytes, *, urgent: bool = False) -> str:
        """Send `line` unchanged, and return the reply without its ending and surrounding spaces.

        Bytes that arrived before the line was sent make the reply doubtful: they raise an error,
        and nothing is sent. An urgent line is sent nevertheless.

        Raises
        ------
        ProtocolError
            There is no complete reply in time, or the reply is not text. The reply is not used, and
            the link is replaced by a new one. The command may have been executed.
        LinkLost
            The link is lost and cannot be reopened; the next call tries again.
        """
        link = self._link or self._open(settle=not urgent)
        came = bytearray()

        def whole(data: bytes) -> bool:
            came.extend(data)
            if len(came) > _MAX_REPLY_SIZE:
                raise ProtocolError(
                    f"{self.address}: the reply to {line!r} has no end within {_MAX_REPLY_SIZE} "
                    "bytes; check the address and the baud rate"
                )
            return self._ending in data

        with on_failure(self._open, ProtocolError, LinkLost):
            if not urgent and (stray := link.read(_MAX_REPLY_SIZE, 0.0)):
                raise ProtocolError(
                    f"{self.address}: {stray[:20]!r} arrived before {line!r} was sent; check that "
                    "no other program uses the controller"
                )
            link.write(line)
            if not read_until(link, whole, self._timeout):
                raise ProtocolError(
                    f"{self.address}: no complete reply to {line!r} within {self._timeout:g} s "
                    f"({len(came)} bytes arrived); the controller may have executed it: check the "
                    "table"
                )
            text, behind = came.split(self._ending, 1)
            if behind or not text.isascii():
                raise ProtocolError(
                    f"{self.address}: {bytes(came[-40:])!r} is not one line of ASCII text in reply "
                    f"to {line!r}; check the baud rate"
                )
        return text.decode("ascii").strip()

    def close(self) -> None:
        """Close the link; the next request reopens it."""
        if self._link is not None:
            self._link.close()
            self._link = None

    def _open(self, *, settle: bool = True) -> Link:
        """Return a new link; with `settle`, wait until it is silent."""
        self.close()
        link = self._opener(self.address)
        if settle and link.address.startswith("serial:"):
            # Another program that uses the device would prevent it from ever being silent.
            for _ in range(_MAX_STRAY_READS):
                if not link.read(_MAX_REPLY_SIZE, self._timeout):
                    break
        self._link = link
        return link
