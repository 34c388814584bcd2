"""Sends lines of text to a controller; a known byte ends each reply.

Where a reply does not come whole in time, the link is given up and another opened. Over TCP that
is all: bytes under way to the old connection cannot arrive. A serial port is read until it has been
silent for the timeout; a reply later than that would be taken for the next one's, and nothing in
such a protocol could tell.
"""

from collections.abc import Callable

from inercal.host.closeable import Closeable
from inercal.host.drivers.rotary_table import ProtocolError
from inercal.host.link import Link, LinkLost, read_until

_MAX_STRAY_READS = 20  # pieces of what is still under way
_MAX_REPLY_SIZE = 1 << 16  # bytes; no reply of a table comes near


class TextDialogue(Closeable):
    """A connection to the controller at `address`.

    Parameters
    ----------
    address : str
        As `open_link` takes it.
    ending : bytes
        The byte that ends a reply.
    timeout : float
        s that a whole reply may take.
    opener : callable
        Opens a link to an address; tests give their own.
    """

    def __init__(self, address: str, ending: bytes, timeout: float, opener: Callable[[str], Link]):
        self.address = address
        self._ending, self._timeout, self._opener = ending, timeout, opener
        self._link: Link | None = opener(address)

    def ask(self, line: bytes, *, urgent: bool = False) -> str:
        """Return the reply to `line`, sent as it is, without its ending and spaces around.

        Bytes that arrived before make the reply doubtful: they are an error, and nothing is sent.
        An urgent line is sent all the same.

        Raises
        ------
        ProtocolError
            No whole reply in time, or a reply that is not text: it is not used, and the link is
            a new one. The command may have been carried out.
        LinkLost
            The link is lost and cannot be opened anew; the next call tries again.
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

        try:
            if not urgent and (stray := link.read(_MAX_REPLY_SIZE, 0.0)):
                raise ProtocolError(
                    f"{self.address}: {stray[:20]!r} arrived before {line!r} was sent; check that "
                    "no other program uses the controller"
                )
            link.write(line)
            if not read_until(link, whole, self._timeout):
                raise ProtocolError(
                    f"{self.address}: no complete reply to {line!r} within {self._timeout:g} s "
                    f"({len(came)} bytes came); the controller may have executed it: check the "
                    "table"
                )
            text, behind = came.split(self._ending, 1)
            if behind or not text.isascii():
                raise ProtocolError(
                    f"{self.address}: {bytes(came[-40:])!r} is not one line of ASCII text in reply "
                    f"to {line!r}; check the baud rate"
                )
        except (ProtocolError, LinkLost):
            self._open()
            raise
        return text.decode("ascii").strip()

    def close(self) -> None:
        """Close the link; a later question opens it anew."""
        if self._link is not None:
            self._link.close()
            self._link = None

    def _open(self, *, settle: bool = True) -> Link:
        """Return a new link; one that settles is silent before anything is sent on it."""
        self.close()
        link = self._opener(self.address)
        if settle and link.address.startswith("serial:"):
            # Another program that talks there would keep it from ever being silent.
            for _ in range(_MAX_STRAY_READS):
                if not link.read(_MAX_REPLY_SIZE, self._timeout):
                    break
        self._link = link
        return link
