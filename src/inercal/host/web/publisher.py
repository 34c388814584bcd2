"""What a run tells the server: JSON lines, written by a thread that alone waits for the reader.

A line is the kind of the message, a space, and the message, so that the server need not read it. A
reader that is slow misses pictures; one that is gone is told nothing any more. Neither keeps the
run waiting.
"""

import json
import os
import sys
from collections.abc import Mapping
from threading import Condition, Thread
from time import monotonic

from inercal.host.closeable import Closeable
from inercal.host.web.dropping_queue import DroppingQueue

DROPPABLE_KINDS = frozenset(("state", "samples", "estimates"))  # later ones say what these did


class Publisher(Closeable):
    """Writes messages to a descriptor; as a context manager it closes with the context.

    Parameters
    ----------
    descriptor : int
        Written to, and left open.
    """

    def __init__(self, descriptor: int):
        self._descriptor = descriptor
        self._queue: DroppingQueue[tuple[str, Mapping[str, object]]] = DroppingQueue()
        self._changed = Condition()
        self._closed = self._written = False
        Thread(target=self._write, name="publisher", daemon=True).start()

    def publish(self, kind: str, **content: object) -> None:
        """Have a message written, if somebody reads; never waits."""
        with self._changed:
            if not self._closed:
                self._queue.put((kind, content), must_keep=kind not in DROPPABLE_KINDS)
                self._changed.notify_all()

    def close(self, patience: float = 5.0) -> None:
        """Wait until all is written, or `patience` s; a second time does nothing."""
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
                # NaN, or half a surrogate pair: those that follow are to be told still.
                if kind not in unsaid:
                    unsaid.add(kind)
                    words = f"a message of kind {kind!r} could not be told"
                    print(f"inercal: {words}: {error}", file=sys.stderr, flush=True)
                continue
            try:
                while line:
                    line = line[os.write(self._descriptor, line) :]
            except OSError:  # nobody reads any more
                break
        with self._changed:
            self._closed = self._written = True
            self._changed.notify_all()

    def _next_message(self) -> tuple[str, Mapping[str, object]] | None:
        with self._changed:
            while (message := self._queue.take()) is None and not self._closed:
                self._changed.wait()
            return message
