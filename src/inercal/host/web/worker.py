"""A run as a process of its own: `python -m inercal.host.web.worker`, told by its standard input.

The first line is the `RunRequest`. Then come commands, `pause`, `go on` and `abort`, for as long as
somebody gives any: at the end of the input the run goes on to its own end, and so it does where
nobody reads what it tells. SIGINT and SIGTERM stop the table, by the watchdog too; before anything
moves they end the process, and once all is done they are too late.
"""

import sys

from inercal.host.web.command_relay import CommandRelay
from inercal.host.web.run_controller import RunController
from inercal.host.web.run_request import RunRequest
from inercal.host.web.worker_process import LineReader, serve_request


def main() -> int:
    """Carry out the order; return the status to exit with."""
    control = CommandRelay()

    def hear(lines: LineReader) -> None:
        while (line := lines.next_line()) is not None:
            control.command(line)

    end = serve_request(
        RunRequest.from_json,
        lambda order, publisher: RunController(order, publisher, control).execute(),
        hear,
        control.interrupt,
    )
    return 0 if end is not None and end["state"] == "done" else 2 if end is None else 1


if __name__ == "__main__":
    sys.exit(main())
