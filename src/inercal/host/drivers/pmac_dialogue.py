"""One question, one answer with a Turbo PMAC: a reply that comes too late is never the next one's.

A reply is read to its ACK. Where it does not come whole in time, or what comes is no reply, the
controller is told to forget it, the connection is given up and a new one opened: bytes under way
to the old one can no longer arrive. The question is not repeated, as the command may have been
executed.
"""

from collections.abc import Callable
from contextlib import suppress

from inercal.host.closeable import Closeable
from inercal.host.drivers import pmac_codec as codec
from inercal.host.drivers.rotary_table import ProtocolError
from inercal.host.link import Link, LinkLost, open_link, read_until

# ERRnnn behind BELL (I6), no LF before lines and ACK behind them (I3): what the codec reads; bare
# numbers, addresses as $hex (I9).
_REPLY_FORMAT_COMMAND = "i6=1 i3=2 i9=2"


class PmacDialogue(Closeable):
    """A connection to the controller at `address` (`tcp://HOST:1025`).

    Parameters
    ----------
    address : str
        Where the controller is.
    timeout : float
        s that a whole reply may take.
    opener : callable
        Opens a link to an address; tests give their own.
    """

    def __init__(
        self, address: str, timeout: float = 1.0, opener: Callable[[str], Link] = open_link
    ):
        self.address = address
        self._timeout = timeout
        self._opener = opener
        self._link: Link | None = None
        self._connect()

    def ask(self, line: str, replies: int = 0) -> list[str]:
        """Return the `replies` lines that answer a command line.

        Raises
        ------
        Refused
            The controller says ERRnnn; the connection stays.
        ProtocolError
            No whole reply in time, one that is none, or another number of lines: nothing of it is
            used, and the connection is a new one. The command may have been carried out.
        LinkLost
            The connection is lost and cannot be made anew; the next call tries again.
        """
        link = self._link or self._connect()
        reader = codec.ReplyReader(line)
        lines: list[str] = []

        def take(data: bytes) -> bool:
            got = reader.feed(data)
            if got is None:
                if reader.awaits_request:
                    link.write(codec.buffer_request())
                return False
            lines.extend(got)
            return True

        try:
            if stray := link.read(codec.CHUNK_SIZE, 0.0):
                raise ProtocolError(f"{self.address}: {stray[:20]!r} came unasked before {line!r}")
            link.write(codec.response_request(line))
            if not read_until(link, take, self._timeout, codec.CHUNK_SIZE):
                raise ProtocolError(
                    f"{self.address}: no whole reply to {line!r} within {self._timeout:g} s "
                    f"({reader.size} bytes came); the command may have been executed"
                )
            if len(lines) != replies:
                raise ProtocolError(
                    f"{self.address}: {len(lines)} lines answer {line!r}, {replies} were due"
                )
        except (ProtocolError, LinkLost):
            self._connect()
            raise
        return lines

    def control(self, letter: str) -> None:
        """Send a control character, "A" for ^A.

        The manual leaves open what answers one that reports nothing: a FLUSH behind it, whose
        answer is known, ends whatever does.
        """
        link = self._link or self._connect()
        try:
            link.write(codec.control_request(letter) + codec.flush_request())
            if not read_until(link, lambda data: codec.FLUSH_ANSWER in data, self._timeout):
                raise ProtocolError(
                    f"{self.address}: no answer to ^{letter}; it may have been heard"
                )
        except (ProtocolError, LinkLost):
            self._connect()
            raise

    def close(self) -> None:
        """Close the connection; a later question opens it anew."""
        if self._link is not None:
            self._link.close()
            self._link = None

    def _connect(self) -> Link:
        """Give up the connection there is, open another, and bring it into the form we read."""
        if self._link is not None:
            # Lost is what it is about to be.
            with suppress(LinkLost):
                self._link.write(codec.flush_request())
            self.close()
        link = self._opener(self.address)
        came = bytearray()
        reader = codec.ReplyReader(_REPLY_FORMAT_COMMAND)

        def flushed(data: bytes) -> bool:
            came.extend(data)
            return codec.FLUSH_ANSWER in came

        try:
            link.write(codec.flush_request())
            # A reply left over in the controller would come before the answer, and ends there.
            if not read_until(link, flushed, self._timeout) or not came.endswith(
                codec.FLUSH_ANSWER
            ):
                raise LinkLost(f"{self.address}: no Turbo PMAC answers there (to FLUSH)")
            link.write(codec.response_request(_REPLY_FORMAT_COMMAND))
            if not read_until(link, lambda data: reader.feed(data) is not None, self._timeout):
                raise LinkLost(
                    f"{self.address}: no Turbo PMAC answers there (to {_REPLY_FORMAT_COMMAND!r})"
                )
        except BaseException:
            link.close()
            raise
        self._link = link
        return link
