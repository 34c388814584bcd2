"""Exchanges requests and replies with a Turbo PMAC; a late reply is never misassigned.

Each request is a separate packet, because a controller may treat a packet as one request. The next
request is sent when the reply has arrived or the time limit has passed. A reply is read up to its
ACK. If a reply is not complete in time or not valid, the controller is told to discard it, and the
connection is closed. The next request opens a new connection, on which replies to old requests
cannot arrive. A request is not repeated, because the command may have been executed.

Commands that stop the table do not wait for late answers or for the first answers on a new
connection; see `control` and `ask_now`.
"""

from contextlib import suppress

from inercal.basics.closeable import on_failure
from inercal.host.drivers import pmac_codec as codec
from inercal.host.drivers.rotary_table import ProtocolError
from inercal.host.link import Link, LinkLost, ReopenedLink, read_until

# The codec needs ERRnnn after BELL (I6), ACK but no LF (I3), and plain numbers with addresses as
# $hex (I9).
_REPLY_FORMAT_COMMAND = "i6=1 i3=2 i9=2"
STOP_TIMEOUT = 0.3  # s to wait for the answer to a stop command


class PmacDialogue(ReopenedLink):
    """A connection to a Turbo PMAC controller.

    Parameters
    ----------
    address : str
        Address of the controller, `tcp://HOST:1025`.
    timeout : float
        Longest time for a complete reply, s.
    """

    def __init__(self, address: str, timeout: float = 1.0):
        super().__init__(address)
        self._timeout, self._formatted = timeout, False
        self._connect()

    def ask(self, line: str, replies: int = 0) -> list[str]:
        """Send a command line, and return the lines of the reply.

        Raises
        ------
        CommandRefused
            The controller answers ERRnnn; the connection stays open.
        ProtocolError
            The reply is not complete in time, is not valid, or does not have `replies` lines. It is
            not used, and the connection is closed. The command may have been executed.
        LinkLost
            The connection is lost or cannot be opened; the next call opens a new one.
        """
        link = self._connect()
        with on_failure(self.drop, ProtocolError, LinkLost):
            if stray := link.read(codec.CHUNK_SIZE, 0.0):
                raise ProtocolError(
                    f"{self.address}: {stray[:20]!r} arrived before {line!r} was sent; check that "
                    "no other program uses the controller"
                )
            return self._exchange(link, line, replies, self._timeout)

    def ask_now(self, line: str, replies: int) -> list[str]:
        """Send a line like `ask`, but within `STOP_TIMEOUT` and despite unanswered requests.

        On a new connection, the line is sent before any other answer has arrived.

        After a `ProtocolError`, the connection stays open, so the next stop command need not wait
        for a new connection. The caller drops the connection after the last command.
        """
        link = self._open()
        with on_failure(self.drop, LinkLost):
            return self._exchange(link, line, replies, STOP_TIMEOUT)

    def control(self, letter: str) -> bool:
        """Send a control character, "A" for ^A; return whether it was answered in `STOP_TIMEOUT`.

        The manual does not say what the answer is if a character reports nothing. Any byte
        therefore counts as an answer. A FLUSH, whose answer is known, then discards everything else
        that arrives. Without an answer, the connection stays open, so the next stop command can be
        sent at once. On a new connection, the character is sent first, because a controller with
        late or garbled replies may still obey.

        Raises
        ------
        LinkLost
            The connection is lost or cannot be opened; the next call opens a new one.
        """
        link = self._open()
        with on_failure(self.drop, LinkLost):
            link.read(codec.CHUNK_SIZE, 0.0)  # bytes that arrived earlier are not an answer
            link.write(codec.control_request(letter))
            if not read_until(link, lambda _: True, STOP_TIMEOUT):
                return False
            link.write(codec.FLUSH_REQUEST)
            if not read_until(link, lambda data: codec.FLUSH_ANSWER in data, STOP_TIMEOUT):
                self.drop()
        return True

    def drop(self) -> None:
        """Close a connection on which late replies may arrive; the next request opens another."""
        if self._link is not None:
            with suppress(LinkLost):
                self._link.write(codec.FLUSH_REQUEST)
        self.close()

    def close(self) -> None:
        """Close the connection, if it is open; the next request opens a new connection."""
        super().close()
        self._formatted = False

    def _exchange(self, link: Link, line: str, replies: int, timeout: float) -> list[str]:
        """Send a command line, and return the lines of the reply."""
        reader = codec.ReplyReader(line)
        lines: list[str] = []

        def take(data: bytes) -> bool:
            got = reader.feed(data)
            if got is None:
                if reader.awaits_request:
                    link.write(codec.BUFFER_REQUEST)
                return False
            lines.extend(got)
            return True

        link.write(codec.response_request(line))
        if not read_until(link, take, timeout, codec.CHUNK_SIZE):
            raise ProtocolError(
                f"{self.address}: no complete reply to {line!r} within {timeout:g} s "
                f"({reader.size} bytes arrived); the controller may have executed it: check the "
                "table"
            )
        if len(lines) != replies:
            raise ProtocolError(
                f"{self.address}: the reply to {line!r} has {len(lines)} lines, expected "
                f"{replies}; check that no other program uses the controller"
            )
        return lines

    def _connect(self) -> Link:
        """Return the connection, after setting the reply format that the codec needs."""
        link = self._open()
        if self._formatted:
            return link
        came = bytearray()
        reader = codec.ReplyReader(_REPLY_FORMAT_COMMAND)

        def flushed(data: bytes) -> bool:
            came.extend(data)
            return codec.FLUSH_ANSWER in came

        with on_failure(self.close):
            link.write(codec.FLUSH_REQUEST)
            # An old reply in the controller would arrive before the answer. It is dropped here.
            if not read_until(link, flushed, self._timeout) or not came.endswith(
                codec.FLUSH_ANSWER
            ):
                raise LinkLost(
                    f"{self.address}: no Turbo PMAC answered FLUSH at this address; check the "
                    "address, the cable and the power"
                )
            link.write(codec.response_request(_REPLY_FORMAT_COMMAND))
            if not read_until(link, lambda data: reader.feed(data) is not None, self._timeout):
                raise LinkLost(
                    f"{self.address}: no Turbo PMAC answered {_REPLY_FORMAT_COMMAND!r} at this "
                    "address; check the address, the cable and the power"
                )
        self._formatted = True
        return link
