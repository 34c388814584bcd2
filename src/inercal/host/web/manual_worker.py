"""A manual session as a separate process: `python -m inercal.host.web.manual_worker`.

The first line of standard input is the `ManualRequest`. The following lines are the operator's
commands, and `abort` ends the session. Unlike a run, a session does not continue without the
server: at the end of the input, all axes are stopped, and the session ends. SIGINT and SIGTERM stop
the table, also through the watchdog.
"""

import os
import shutil
import sys
from contextlib import ExitStack
from functools import partial
from pathlib import Path

from inercal.basics.errors import InercalError
from inercal.host.addresses import DeviceAddresses
from inercal.host.assembly.table_polls import POLL_INTERVAL
from inercal.host.bench_simulator import COMPILATION_MESSAGE, STARTUP_MESSAGE, BenchSimulator
from inercal.host.journal import Journal
from inercal.host.manual.commands import HaltCommand
from inercal.host.manual.session import ManualSession
from inercal.host.run_log import os_errors_as_input_errors
from inercal.host.web import run_request
from inercal.host.web.telemetry import ManualTelemetry
from inercal.host.web.worker_process import LineReader, Publisher, serve_request
from inercal.runfile import read

_PATIENCE, _SIMULATED_PATIENCE = 600.0, 10.0  # s; the watchdog tries to reach a table


class SessionRelay:
    """Passes commands from standard input to the session, as soon as the session exists.

    Attributes
    ----------
    session : ManualSession or None
    """

    def __init__(self):
        self.session: ManualSession | None = None
        self._end_words = ""

    def attach(self, session: ManualSession) -> None:
        """From now on, pass commands to a session, including an earlier request to end."""
        self.session = session
        if self._end_words:
            session.end(self._end_words)

    def hear(self, lines: LineReader) -> None:
        """Pass on lines until the input ends; this means that the server is gone."""
        while (line := lines.next_line()) is not None:
            self.hear_line(line)
        self.end("the server of the page is gone")

    def hear_line(self, line: str) -> None:
        """Execute a line; before the session exists, only a request to end is remembered."""
        if line == run_request.END:
            self.end("ended by the operator")
        elif self.session is None:
            return
        elif line.startswith(run_request.HALT):
            self.session.request("the server", HaltCommand(line.removeprefix(run_request.HALT)))
        elif line.startswith(run_request.NOTE):
            self.session.write_note(line.removeprefix(run_request.NOTE))
        elif line.startswith(run_request.MANUAL):
            try:
                self.session.request(
                    *run_request.parse_manual_line(line.removeprefix(run_request.MANUAL))
                )
            except InercalError as error:
                print(f"inercal: {error}", file=sys.stderr, flush=True)

    def end(self, words: str) -> None:
        """End the session."""
        self._end_words = words
        if self.session is not None:
            self.session.end(words)

    def interrupt(self, *_: object) -> None:
        """Handle a signal that the session does not handle itself.

        Raises
        ------
        KeyboardInterrupt
            The session does not exist yet, so nothing is moving.
        """
        if self.session is None:
            raise KeyboardInterrupt
        self.session.end("stopped by the operator")


def main() -> int:
    """Carry out the session, and return the exit status."""
    relay = SessionRelay()
    end = serve_request(
        run_request.ManualRequest.from_json,
        lambda order, publisher: run_request.end_message(
            order, "manual", _operate(order, publisher, relay)
        ),
        relay.hear,
        relay.interrupt,
    )
    return 2 if end is None else 0


def _operate(order: run_request.ManualRequest, publisher: Publisher, relay: SessionRelay) -> str:
    """Operate the table until the session ends, and return the reason for its end."""
    folder, plan = Path(order.folder), Path(order.plan)
    run = read(plan)
    with ExitStack() as opened:
        addresses, simulated = DeviceAddresses(order.table, order.imu, order.clock), None
        if order.simulated is not None:
            publish_phase = partial(publisher.publish, "phase", run=order.name)
            publish_phase(words=STARTUP_MESSAGE)
            # The simulation runs in real time, because a person operates it.
            compiling = partial(publish_phase, words=COMPILATION_MESSAGE)
            bench = BenchSimulator(plan, order.seed, order.simulated, pace=1.0, compiling=compiling)
            opened.enter_context(bench)
            addresses = DeviceAddresses(bench.table, bench.imu if order.with_imu else "")
            simulated = run_request.SimulationRequest(order.simulated, order.seed)
        publisher.publish("phase", run=order.name, words="connecting to the table")
        with os_errors_as_input_errors(folder, "made"):
            folder.mkdir(parents=True)
            (folder / plan.name).write_bytes(plan.read_bytes())
        with ExitStack() as removed:
            removed.callback(shutil.rmtree, folder, ignore_errors=True)
            opened.callback(os.close, run_request.write_process_record(folder, simulated))
            journal = opened.enter_context(
                Journal.create(
                    folder / run_request.MANUAL_JOURNAL, plan.name, addresses, POLL_INTERVAL, 0
                )
            )
            journal.record_event("info", _begin_text(order))
            telemetry = ManualTelemetry(order, run, publisher, journal)
            opened.callback(telemetry.publish_events)
            # A simulated table ends together with this process, so the watchdog need not try for
            # long to reach it.
            patience = _SIMULATED_PATIENCE if simulated is not None else _PATIENCE
            session = opened.enter_context(
                ManualSession(run, journal, addresses, telemetry, patience)
            )
            # The devices have answered, so from now on, the folder is kept.
            removed.pop_all()
        telemetry.publish_plan(session)
        relay.attach(session)
        words = session.operate()
        journal.set_state("done")
        return words


def _begin_text(order: run_request.ManualRequest) -> str:
    by = order.requested_by or "an operator who gave no name"
    words = f"manual session, started from the page by {by}; limits of {Path(order.plan).name}"
    return f"{words}; simulated bench, seed {order.seed}" if order.simulated else words


if __name__ == "__main__":
    sys.exit(main())
