"""Requests to a Turbo PMAC; a late reply is never taken for the reply to the next request.

A request is a packet of its own, and the next is sent when its reply has come or its time limit has
passed: a controller may take one packet for one request. A reply is read to its ACK. Where it does
not come whole in time, or what comes is no reply, the controller is told to forget it and the
connection is given up; the next request opens another, which bytes under way to the old one cannot
reach. A request is not repeated, as the command may have been executed.

Commands that stop the table wait for no answer that came late, and none of a new connection: see
`control` and `ask_now`.
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
STOP_TIMEOUT = 0.3  # s that the answer to a command of a stop is waited for


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
        self._formatted = False
        self._connect()

    def ask(self, line: str, replies: int = 0) -> list[str]:
        """Return the `replies` lines that answer a command line.

        Raises
        ------
        CommandRefused
            The controller answers ERRnnn; the connection stays.
        ProtocolError
            No whole reply in time, bytes that are no reply, or another number of lines: nothing of
            it is used, and the connection is given up. The command may have been executed.
        LinkLost
            The connection is lost, or cannot be opened; the next call opens another.
        """
        link = self._connect()
        try:
            if stray := link.read(codec.CHUNK_SIZE, 0.0):
                raise ProtocolError(
                    f"{self.address}: {stray[:20]!r} arrived before {line!r} was sent; check that "
                    "no other program uses the controller"
                )
            return self._exchange(link, line, replies, self._timeout)
        except (ProtocolError, LinkLost):
            self.drop()
            raise

    def ask_now(self, line: str, replies: int) -> list[str]:
        """As `ask`, within `STOP_TIMEOUT`, and though an earlier request is unanswered.

        The line is sent on a new connection before anything is answered there.

        After a `ProtocolError` the connection stays as it is, so that the next command of a stop
        need not wait for a new one; the caller drops it after the last command.
        """
        link = self._open()
        try:
            return self._exchange(link, line, replies, STOP_TIMEOUT)
        except LinkLost:
            self.drop()
            raise

    def control(self, letter: str) -> bool:
        """Send a control character, "A" for ^A; False where nothing answers in `STOP_TIMEOUT`.

        The manual leaves open what answers a character that reports nothing. Any byte counts; then
        a FLUSH, whose answer is known, ends whatever else comes. Without an answer the connection
        stays, so that the next command of a stop can be sent at once. On a new connection it is the
        first that is sent: a controller whose replies are late or garbled may still obey.

        Raises
        ------
        LinkLost
            The connection is lost, or cannot be opened; the next call opens another.
        """
        link = self._open()
        try:
            link.read(codec.CHUNK_SIZE, 0.0)  # what has arrived before is no answer
            link.write(codec.control_request(letter))
            if not read_until(link, lambda _: True, STOP_TIMEOUT):
                return False
            link.write(codec.FLUSH_REQUEST)
            if not read_until(link, lambda data: codec.FLUSH_ANSWER in data, STOP_TIMEOUT):
                self.drop()
        except LinkLost:
            self.drop()
            raise
        return True

    def drop(self) -> None:
        """Close a connection on which replies may be under way; the next request opens another."""
        if self._link is not None:
            with suppress(LinkLost):
                self._link.write(codec.FLUSH_REQUEST)
        self.close()

    def close(self) -> None:
        """Close the connection, if there is one; the next request opens another."""
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
                f"({reader.size} bytes came); the controller may have executed it: check the table"
            )
        if len(lines) != replies:
            raise ProtocolError(
                f"{self.address}: the reply to {line!r} has {len(lines)} lines, expected "
                f"{replies}; check that no other program uses the controller"
            )
        return lines

    def _open(self) -> Link:
        """Return the connection. If there is none, open one, on which nothing was sent yet."""
        if self._link is None:
            self._link = self._opener(self.address)
        return self._link

    def _connect(self) -> Link:
        """Return the connection, with replies in the format that the codec reads."""
        link = self._open()
        if self._formatted:
            return link
        came = bytearray()
        reader = codec.ReplyReader(_REPLY_FORMAT_COMMAND)

        def flushed(data: bytes) -> bool:
            came.extend(data)
            return codec.FLUSH_ANSWER in came

        try:
            link.write(codec.FLUSH_REQUEST)
            # A reply left over in the controller would come before the answer, and ends there.
            if not read_until(link, flushed, self._timeout) or not came.endswith(
                codec.FLUSH_ANSWER
            ):
                raise LinkLost(
                    f"{self.address}: no Turbo PMAC answered FLUSH there; check the address, the "
                    "cable and the power"
                )
            link.write(codec.response_request(_REPLY_FORMAT_COMMAND))
            if not read_until(link, lambda data: reader.feed(data) is not None, self._timeout):
                raise LinkLost(
                    f"{self.address}: no Turbo PMAC answered {_REPLY_FORMAT_COMMAND!r} there; "
                    "check the address, the cable and the power"
                )
        except BaseException:
            self.close()
            raise
        self._formatted = True
        return link
