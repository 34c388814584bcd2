"""The frame of a process that drives the bench for the page: a run, or a session by hand.

The first line of standard input is the request; commands follow, one a line. Messages go to
standard output, the last of them is the end.
"""

import os
import signal
import sys
from collections.abc import Callable, Mapping
from threading import Thread
from typing import Any, TypeVar

from inercal.basics.errors import InercalError
from inercal.host.web.publisher import Publisher
from inercal.host.web.run_request import ProcessRequest, premature_end_message

_MAX_LINE = 1 << 16  # bytes of a line
R = TypeVar("R", bound=ProcessRequest)


class LineReader:
    """Lines of a descriptor, one by one; a line is complete or none."""

    def __init__(self, descriptor: int):
        self._descriptor, self._buffer = descriptor, b""

    def next_line(self) -> str | None:
        """Return the next line, when it is there; None at the end."""
        while b"\n" not in self._buffer:
            try:
                data = os.read(self._descriptor, _MAX_LINE)
            except OSError:
                data = b""
            if not data or len(self._buffer) > _MAX_LINE:
                return None
            self._buffer += data
        line, _, self._buffer = self._buffer.partition(b"\n")
        return line.decode("utf-8", "replace")


def serve_request(
    parse: Callable[[str], R],
    execute: Callable[[R, Publisher], Mapping[str, Any]],
    hear: Callable[[LineReader], object],
    interrupt: Callable[..., object],
) -> Mapping[str, Any] | None:
    """Carry out the request of standard input; return its end, which was published.

    Parameters
    ----------
    parse : callable
        From the first line to the request.
    execute : callable
        Carries the request out and returns its end; an error becomes a premature end.
    hear : callable
        Called with the further lines in a thread of its own.
    interrupt : callable
        Called on SIGINT and SIGTERM.

    Returns
    -------
    end : mapping or None
        None where the first line is no request; standard error says so.
    """
    # Other output of this process must not mix with the messages.
    output = os.dup(1)
    os.dup2(2, 1)
    lines = LineReader(0)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, interrupt)
    try:
        request = parse(lines.next_line() or "")
    except InercalError as error:
        print(f"inercal: {error}", file=sys.stderr)
        return None
    Thread(target=hear, args=(lines,), name="commands", daemon=True).start()
    with Publisher(output) as publisher:
        end = _end(request, lambda: execute(request, publisher))
        publisher.publish("done", **end)
    return end


def _end(request: ProcessRequest, execute: Callable[[], Mapping[str, Any]]) -> Mapping[str, Any]:
    try:
        return execute()
    except InercalError as error:
        return premature_end_message(request, str(error))
    except KeyboardInterrupt:
        return premature_end_message(request, "stopped before anything moved")
    except Exception as error:
        # The viewers read the message; the server's log has the traceback.
        sys.excepthook(*sys.exc_info())  # pyright: ignore[reportArgumentType]
        words = f"the process failed: {type(error).__name__}: {error}"
        return premature_end_message(request, words)
