"""A run as a process of its own: `python -m inercal.host.web.worker`, told by its standard input.

The first line is the `RunRequest`. Then come commands, `pause`, `go on` and `abort`, for as long as
somebody gives any: at the end of the input the run goes on to its own end, and so it does where
nobody reads what it tells. SIGINT and SIGTERM stop the table, by the watchdog too; before anything
moves they end the process, and once all is done they are too late.
"""

import os
import signal
import sys
from collections.abc import Mapping
from threading import Thread
from typing import Any

from inercal.errors import InercalError
from inercal.host.web.carry import RunController
from inercal.host.web.control import Control
from inercal.host.web.order import RunRequest, cut_short
from inercal.host.web.publish import Publisher

_MOST = 1 << 16  # bytes of a line


class _Lines:
    """Lines of a descriptor, one by one; a line is complete or none."""

    def __init__(self, descriptor: int):
        self._descriptor, self._came = descriptor, b""

    def next(self) -> str | None:
        """Return the next line, when it is there; None at the end."""
        while b"\n" not in self._came:
            try:
                data = os.read(self._descriptor, _MOST)
            except OSError:
                data = b""
            if not data or len(self._came) > _MOST:
                return None
            self._came += data
        line, _, self._came = self._came.partition(b"\n")
        return line.decode("utf-8", "replace")


def main() -> int:
    """Carry out the order; return the status to exit with."""
    # What else is printed here must not get between the messages.
    told = os.dup(1)
    os.dup2(2, 1)
    lines, control = _Lines(0), Control()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, control.interrupt)
    try:
        order = RunRequest.of(lines.next() or "")
    except InercalError as error:
        print(f"inercal: {error}", file=sys.stderr)
        return 2

    def hear() -> None:
        while (line := lines.next()) is not None:
            control.command(line)

    Thread(target=hear, name="commands", daemon=True).start()
    with Publisher(told) as publisher:
        end = _end(order, publisher, control)
        publisher.tell("done", **end)
    return 0 if end["state"] == "done" else 1


def _end(order: RunRequest, publisher: Publisher, control: Control) -> Mapping[str, Any]:
    try:
        return RunController(order, publisher, control).carry_out()
    except InercalError as error:
        return cut_short(order, str(error))
    except KeyboardInterrupt:
        return cut_short(order, "stopped before anything moved")
    except Exception as error:
        # Told to who looks on; where it comes from stands in the server's log.
        sys.excepthook(*sys.exc_info())  # pyright: ignore[reportArgumentType]
        words = f"the run's process failed: {type(error).__name__}: {error}"
        return cut_short(order, words)


if __name__ == "__main__":
    sys.exit(main())
