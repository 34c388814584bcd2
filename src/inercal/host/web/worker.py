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
from inercal.host.web.command_relay import CommandRelay
from inercal.host.web.publisher import Publisher
from inercal.host.web.run_controller import RunController
from inercal.host.web.run_request import RunRequest, premature_end_message

_MAX_LINE = 1 << 16  # bytes of a line


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


def main() -> int:
    """Carry out the order; return the status to exit with."""
    # What else is printed here must not get between the messages.
    told = os.dup(1)
    os.dup2(2, 1)
    lines, control = LineReader(0), CommandRelay()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, control.interrupt)
    try:
        order = RunRequest.from_json(lines.next_line() or "")
    except InercalError as error:
        print(f"inercal: {error}", file=sys.stderr)
        return 2

    def hear() -> None:
        while (line := lines.next_line()) is not None:
            control.command(line)

    Thread(target=hear, name="commands", daemon=True).start()
    with Publisher(told) as publisher:
        end = _execute_request(order, publisher, control)
        publisher.publish("done", **end)
    return 0 if end["state"] == "done" else 1


def _execute_request(
    order: RunRequest, publisher: Publisher, control: CommandRelay
) -> Mapping[str, Any]:
    try:
        return RunController(order, publisher, control).execute()
    except InercalError as error:
        return premature_end_message(order, str(error))
    except KeyboardInterrupt:
        return premature_end_message(order, "stopped before anything moved")
    except Exception as error:
        # Told to who looks on; where it comes from stands in the server's log.
        sys.excepthook(*sys.exc_info())  # pyright: ignore[reportArgumentType]
        words = f"the run's process failed: {type(error).__name__}: {error}"
        return premature_end_message(order, words)


if __name__ == "__main__":
    sys.exit(main())
