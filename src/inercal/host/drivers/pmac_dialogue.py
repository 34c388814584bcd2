"""Exchanges requests and replies with a Turbo PMAC, and never assigns a late reply wrongly.

Each request is a packet of its own, because a controller may take one packet for one request. The
next one is sent when the reply has arrived or the time limit has passed. A reply is read up to its
ACK. If it is not complete in time, or the bytes are not a valid reply, the controller is told to
discard it and the connection is closed. The next request opens a new connection, which bytes sent
to the old one cannot reach. A request is not repeated, because the command may have been executed.

Commands that stop the table wait neither for a late answer nor for the first answers on a new
connection; see `control` and `ask_now`.
"""

from collections.abc import Callable
from contextlib import suppress

from inercal.host.closeable import Closeable, on_failure
from inercal.host.drivers import pmac_codec as codec
from inercal.host.drivers.rotary_table import ProtocolError
from inercal.host.link import Link, LinkLost, open_link, read_until

# The codec needs ERRnnn after BELL (I6), no LF before lines and ACK after them (I3), and plain
# numbers with addresses as $hex (I9).
_REPLY_FORMAT_COMMAND = "i6=1 i3=2 i9=2"
STOP_TIMEOUT = 0.3  # s to wait for the answer to a stop command


class PmacDialogue(Closeable):
    """A connection to the controller at `address` (`tcp://HOST:1025`).

    Parameters
    ----------
    address : str
        Address of the controller.
    timeout : float
        Longest time for a complete reply, s.
    opener : callable
        Opens a link to an address; tests supply their own.
    """

    def __init__(
        self, address: str, timeout: float = 1.0, opener: Callable[[str], Link] = open_link
    ):
        self.address = address
        self._timeout = timeout
        self._opener = opener
        self._link: Link | None = None
        self._formatted = False
        self._connect()

    def ask(self, line: str, replies: int = 0) -> list[str]:
        """Send a command line, and return the `replies` lines that answer it.

        Raises
        ------
        CommandRefused
            The controller answers ERRnnn; the connection stays open.
        ProtocolError
            There is no complete reply in time, the bytes are not a valid reply, or the number of
            lines is wrong. Nothing from the reply is used, and the connection is closed. The
            command may have been executed.
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
        """As `ask`, within `STOP_TIMEOUT`, and even if an earlier request is unanswered.

        On a new connection, the line is sent before anything else is answered.

        After a `ProtocolError` the connection is kept, so that the next stop command need not wait
        for a new one; the caller drops it after the last command.
        """
        link = self._open()
        with on_failure(self.drop, LinkLost):
            return self._exchange(link, line, replies, STOP_TIMEOUT)

    def control(self, letter: str) -> bool:
        """Send a control character, "A" for ^A; return False without an answer in `STOP_TIMEOUT`.

        The manual does not say what answers a character that reports nothing. Any byte counts as an
        answer. Then a FLUSH, whose answer is known, ends whatever else arrives. Without an answer
        the connection is kept, so that the next stop command can be sent at once. On a new
        connection the character is sent first, because a controller with late or garbled replies
        may still obey.

        Raises
        ------
        LinkLost
            The connection is lost or cannot be opened; the next call opens a new one.
        """
        link = self._open()
        with on_failure(self.drop, LinkLost):
            link.read(codec.CHUNK_SIZE, 0.0)  # bytes that arrived before are not an answer
            link.write(codec.control_request(letter))
            if not read_until(link, lambda _: True, STOP_TIMEOUT):
                return False
            link.write(codec.FLUSH_REQUEST)
            if not read_until(link, lambda data: codec.FLUSH_ANSWER in data, STOP_TIMEOUT):
                self.drop()
        return True

    def drop(self) -> None:
        """Close a connection on which late replies may arrive; the next request opens a new one."""
        if self._link is not None:
            with suppress(LinkLost):
                self._link.write(codec.FLUSH_REQUEST)
        self.close()

    def close(self) -> None:
        """Close the connection, if there is one; the next request opens a new one."""
        if self._link is not None:
            self._link.close()
            self._link = None
            self._formatted = False

    def _exchange(self, link: Link, line: str, replies: int, timeout: float) -> list[str]:
        """Send a command line and return the lines that answer it."""
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

    def _open(self) -> Link:
        """Return the connection; if there is none, open one without sending anything on it."""
        if self._link is None:
            self._link = self._opener(self.address)
        return self._link

    def _connect(self) -> Link:
        """Return the connection after setting the reply format that the codec reads."""
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
            # A reply left over in the controller would arrive before the answer, and is dropped
            # here.
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
