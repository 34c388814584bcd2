"""Exchanges lines of text with a controller whose replies have a known ending.

If a reply is not complete in time, the link is closed and a new link is opened. Over TCP, this is
sufficient, because bytes for the old connection cannot arrive on the new connection. A serial port
is read until it has been silent for the timeout. A reply that arrives even later would be mistaken
for the reply to the next line, and no such protocol could detect this.
"""

from inercal.basics.closeable import on_failure
from inercal.host.drivers.rotary_table import ProtocolError
from inercal.host.link import Link, LinkLost, ReopenedLink, read_until

_MAX_STRAY_READS = 20  # largest number of reads of late bytes
_MAX_REPLY_SIZE = 1 << 16  # bytes; real replies are far shorter


class TextDialogue(ReopenedLink):
    """A connection to a controller.

    Parameters
    ----------
    address : str
        Address of the controller; see `open_link`.
    ending : bytes
        The bytes at the end of each reply. For replies that end with CR LF, both LF and CR LF are
        possible.
    timeout : float
        Longest time for a complete reply, s.
    """

    def __init__(self, address: str, ending: bytes, timeout: float):
        super().__init__(address)
        self._ending, self._timeout = ending, timeout
        self._open()

    def ask(self, line: bytes, *, urgent: bool = False) -> str:
        """Send a line unchanged, and return the reply without its ending and outer spaces.

        If bytes have arrived before the line is sent, the reply would be doubtful. An error is then
        raised, and nothing is sent. An urgent line is sent nevertheless.

        Raises
        ------
        ProtocolError
            The reply is not complete in time or is not text. It is not used, and the link is
            replaced by a new link. The command may have been executed.
        LinkLost
            The link is lost and cannot be reopened; the next call tries again.
        """
        link = self._link or self._reopen(settle=not urgent)
        came = bytearray()

        def whole(data: bytes) -> bool:
            came.extend(data)
            if len(came) > _MAX_REPLY_SIZE:
                raise ProtocolError(
                    f"{self.address}: the reply to {line!r} has no end within {_MAX_REPLY_SIZE} "
                    "bytes; check the address and the baud rate"
                )
            return self._ending in data

        with on_failure(self._reopen, ProtocolError, LinkLost):
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
                    "device"
                )
            text, behind = came.split(self._ending, 1)
            if behind or not text.isascii():
                raise ProtocolError(
                    f"{self.address}: {bytes(came[-40:])!r} is not one line of ASCII text in reply "
                    f"to {line!r}; check the baud rate"
                )
        return text.decode("ascii").strip()

    def _reopen(self, *, settle: bool = True) -> Link:
        """Open a new link; if `settle` is true, wait until it is silent."""
        self.close()
        link = self._open()
        if settle and link.address.startswith("serial:"):
            with on_failure(self.close):
                # If another program uses the device, it is never silent.
                for _ in range(_MAX_STRAY_READS):
                    if not link.read(_MAX_REPLY_SIZE, self._timeout):
                        break
        return link
