"""A connection on which a simulated controller is told lines, each answered at once."""

from collections.abc import Callable


class LineSession:
    """Splits what arrives at `ending`, and hands each line to `answer`."""

    def __init__(self, ending: bytes, answer: Callable[[str], str]):
        self._ending, self._answer = ending, answer
        self._buffer = b""

    def feed(self, data: bytes) -> bytes:
        """As `server.Session.feed`."""
        *lines, self._buffer = (self._buffer + data).split(self._ending)
        return "".join(self._answer(line.decode("latin-1").strip()) for line in lines).encode()
