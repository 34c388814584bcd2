"""The main function of a process that drives the bench for a run or a manual session.

The first line of standard input is the request. Commands follow, one per line. Messages are written
to standard output, and the last message is about the end.

Messages to the server are lines of JSON. A separate thread writes them, so only this thread waits
for the reader. Each line contains the kind of the message, a space and the message, so the server
need not parse the message. A slow reader misses updates, and a lost reader gets no more messages.
Neither delays the run.
"""

import json
import os
import signal
import sys
from collections import deque
from collections.abc import Callable, Mapping
from threading import Condition, Thread
from time import monotonic
from typing import Any, TypeVar

from inercal.basics.closeable import Closeable
from inercal.basics.errors import InercalError
from inercal.host.web.run_request import ProcessRequest, premature_end_message

# Kinds of messages that are replaced by later messages of the same kind.
DROPPABLE_KINDS = frozenset(("state", "samples", "coarse", "estimates"))
MAX_DROPPABLE = 64  # largest number of waiting messages of these kinds


class Publisher(Closeable):
    """Writes messages to a descriptor, until it is closed at the end of its `with` block.

    Parameters
    ----------
    descriptor : int
        Descriptor for writing; it stays open.
    """

    def __init__(self, descriptor: int):
        self._descriptor = descriptor
        self._waiting: deque[tuple[str, Mapping[str, object]]] = deque()
        self._changed = Condition()
        self._closed = self._written = False
        Thread(target=self._write, name="publisher", daemon=True).start()

    def publish(self, kind: str, **content: object) -> None:
        """Queue a message for writing if there is a reader; this never waits."""
        with self._changed:
            if not self._closed:
                self._waiting.append((kind, content))
                self._drop_surplus()
                self._changed.notify_all()

    def close(self, patience: float = 5.0) -> None:
        """Wait at most `patience` s until all messages are written; a second call does nothing."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
            end = monotonic() + patience
            while not self._written and (left := end - monotonic()) > 0:
                self._changed.wait(left)

    def _write(self) -> None:
        unsaid = set[str]()
        while (message := self._next_message()) is not None:
            kind, content = message
            try:
                told = json.dumps({"kind": kind, **content}, ensure_ascii=False, allow_nan=False)
                line = f"{kind} {told}\n".encode()
            except (TypeError, ValueError) as error:
                # The message contains NaN or half of a surrogate pair. The following messages must
                # still be sent.
                if kind not in unsaid:
                    unsaid.add(kind)
                    words = f"a message of kind {kind!r} could not be sent"
                    print(f"inercal: {words}: {error}", file=sys.stderr, flush=True)
                continue
            try:
                while line:
                    line = line[os.write(self._descriptor, line) :]
            except OSError:  # the reader is gone
                break
        with self._changed:
            self._closed = self._written = True
            self._changed.notify_all()

    def _drop_surplus(self) -> None:
        """Drop the oldest message that may be dropped if nobody takes them."""
        droppable = [i for i, (kind, _) in enumerate(self._waiting) if kind in DROPPABLE_KINDS]
        if len(droppable) > MAX_DROPPABLE:
            del self._waiting[droppable[0]]

    def _next_message(self) -> tuple[str, Mapping[str, object]] | None:
        with self._changed:
            while not (self._waiting or self._closed):
                self._changed.wait()
            return self._waiting.popleft() if self._waiting else None


_MAX_LINE = 1 << 16  # largest number of bytes in a line
R = TypeVar("R", bound=ProcessRequest)


class LineReader:
    """Reads complete lines from a descriptor, one at a time."""

    def __init__(self, descriptor: int):
        self._descriptor, self._buffer = descriptor, b""

    def next_line(self) -> str | None:
        """Wait for the next complete line, and return it; None at the end of the input."""
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
    """Execute the request from standard input; publish and return the end message.

    Parameters
    ----------
    parse : callable
        Function that converts the first line to the request.
    execute : callable
        Function that executes the request and returns the end message. An error becomes a premature
        end.
    hear : callable
        Function that is called in a separate thread, with the reader of the following lines.
    interrupt : callable
        Function that is called on SIGINT and SIGTERM.

    Returns
    -------
    end : mapping or None
        End message; None if the first line is not a request, which standard error states.
    """
    # Other output of this process must not be mixed with the messages.
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
        # Viewers see the message, and the server's log contains the traceback.
        sys.excepthook(*sys.exc_info())  # pyright: ignore[reportArgumentType]
        words = f"the process failed: {type(error).__name__}: {error}"
        return premature_end_message(request, words)
