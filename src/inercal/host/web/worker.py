"""A run as a separate process, controlled by its standard input.

The first line is the `RunRequest`. The following lines are commands: `pause`, `go on` and `abort`.
The run continues if the input ends or nobody reads its output. SIGINT and SIGTERM stop the table,
also through the watchdog. Before anything moves, these signals end the process. After everything is
done, they have no effect.
"""

import json
import os
import sys
from collections.abc import Mapping
from contextlib import AbstractContextManager, ExitStack, nullcontext, suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from time import sleep
from typing import Any, Literal
from urllib.parse import quote

from inercal.basics.errors import InercalError
from inercal.estimation.kernel_options import on_compilation
from inercal.host import bench_simulator
from inercal.host.addresses import DeviceAddresses, layout_of_address
from inercal.host.bench_run import BenchRun
from inercal.host.clock import SimulatedClock
from inercal.host.journal import NOTE_LEVEL, Journal
from inercal.host.live_estimator import LiveEstimator
from inercal.host.preparation import check_plan, precompile_run
from inercal.host.registration import RegisterSync
from inercal.host.run_execution import RunInterrupted, execute_run, finish_run
from inercal.host.run_folder import JOURNAL, LOG, RunFolder, create_run, reopen_run
from inercal.host.run_log import read_frames
from inercal.host.web import page_messages, run_request
from inercal.host.web.telemetry import UPDATE_INTERVAL, RunTelemetry
from inercal.host.web.worker_process import LineReader, Publisher, serve_request
from inercal.laboratory.store import Register
from inercal.runfile import Run, read

_TIME_STEP, _TIME_MARGIN = 10.0, 2.0  # s of bench time, in a simulation
_RunCommand = Literal["pause", "go on", "stop"]
_COMMANDS: dict[str, _RunCommand] = {"pause": "pause", "go on": "go on", "abort": "stop"}


class CommandRelay:
    """Passes requests to the run, as soon as the run exists.

    Attributes
    ----------
    interruptible : bool
        Whether a signal ends the process. This is so while nothing moves and nothing is being
        written.
    """

    def __init__(self):
        self.interruptible = True
        self._run: BenchRun | None = None
        self._queue: SimpleQueue[_RunCommand] = SimpleQueue()
        self._notes: SimpleQueue[str] = SimpleQueue()

    def command(self, words: str) -> None:
        """Execute `pause`, `go on`, `abort`, a note or `mounted`; any thread may call this."""
        if words.startswith(run_request.NOTE):
            self._notes.put(words.removeprefix(run_request.NOTE))
        if words.startswith(run_request.MOUNTED) and self._run is not None:
            self._run.confirm_mounting(*json.loads(words.removeprefix(run_request.MOUNTED)))
        if (what := _COMMANDS.get(words)) is None:
            return
        self._queue.put(what)
        self._forward_commands()

    def take_notes(self) -> list[str]:
        """Return the notes since the last call; only for the thread that owns the journal."""
        notes: list[str] = []
        with suppress(Empty):
            while True:
                notes.append(self._notes.get_nowait())
        return notes

    def attach(self, run: BenchRun) -> None:
        """From now on, pass requests to a run, and signals as long as it does not handle them."""
        self._run, self.interruptible = run, False
        self._forward_commands()

    def interrupt(self, *_: object) -> None:
        """Handle a signal that the run does not handle itself: tell the run, if any, to stop.

        Raises
        ------
        KeyboardInterrupt
            An interruption does no harm at this time.
        """
        if self.interruptible:
            raise KeyboardInterrupt
        if self._run is not None:
            # A SimpleQueue never blocks here, whatever code the signal interrupts.
            self._run.request("stop")

    def _forward_commands(self) -> None:
        if self._run is None:
            return
        with suppress(Empty):  # another thread may already have forwarded it
            while True:
                self._run.request(self._queue.get_nowait())


class RunController:
    """Carries out a run, from the request to the register, and publishes its progress.

    Parameters
    ----------
    order : RunRequest
    publisher : Publisher
    control : CommandRelay
    """

    def __init__(self, order: run_request.RunRequest, publisher: Publisher, control: CommandRelay):
        self._order, self._publisher, self._control = order, publisher, control
        self._folder = Path(order.folder)
        self._by = order.requested_by or "an operator who gave no name"
        self._activity: AbstractContextManager[None] = nullcontext()
        self._compiled = False

    def execute(self) -> Mapping[str, Any]:
        """Carry out the run as far as possible, and return the message about the end.

        Raises
        ------
        InercalError
            The run could not be started.
        """
        run = self._read_plan()
        with ExitStack() as opened:
            bench = _simulation_request(self._order)
            addresses = self._open_addresses(run, bench, opened)
            result, journal = self._open_folder(run, addresses)
            opened.enter_context(journal)
            undo = result.removed_on_failure(run_request.PROCESS_RECORD)
            with undo if self._order.plan is not None else nullcontext():
                opened.callback(os.close, run_request.write_process_record(result.path, bench))
                journal.record_event("info", self._start_text(bench))
                if self._order.filter and self._order.plan is not None:
                    journal.record_event("info", self._filter_text(self._order.filter))
                if self._order.ambient is not None and self._order.plan is not None:
                    words = f"{self._by}: the ambient temperature is {self._order.ambient:g} °C"
                    journal.record_event(NOTE_LEVEL, words)
                ending = _RunFinalizer(self._order, result, journal)
                teller = RunTelemetry(self._publisher, result.run, journal)
                told = self._complete_run(result, journal, teller, ending)
                teller.publish_events()
                return told

    def _complete_run(
        self, made: RunFolder, journal: Journal, teller: RunTelemetry, ending: "_RunFinalizer"
    ) -> Mapping[str, Any]:
        """Carry out the remaining steps of a run, and return the message about the end."""
        live = None
        if journal.header().state != "carried out":
            try:
                live = self._execute_plan(made, journal, teller, ending)
            except RunInterrupted as error:
                return ending.end("interrupted", str(error) or "interrupted")
            finally:
                teller.publish_events()
        self._control.interruptible = False
        self._record_notes(journal)
        self._publish_phase("finishing: recording, calibration, report")
        return ending.complete_run(live)

    def _read_plan(self) -> Run:
        """Return the requested run, and publish its plan."""
        order, clock = self._order, self._order.clock
        if order.plan is not None:
            run = read(order.plan)
        else:
            with Journal(self._folder / JOURNAL) as journal:
                was = journal.header()
            run, clock = read(self._folder / was.run_file), clock or was.clock
        told = page_messages.plan_message(run) | {"run": order.name}
        told["simulated"] = _simulation_request(order) is not None or bool(clock)
        told["sensor"] = order.sensor or told["sensor"]
        self._publisher.publish("plan", **told)
        return run

    def _open_addresses(
        self, run: Run, wanted: run_request.SimulationRequest | None, opened: ExitStack
    ) -> DeviceAddresses:
        order = self._order
        if wanted is None:
            return DeviceAddresses(order.table, order.imu, order.clock)
        self._publish_phase(bench_simulator.STARTUP_MESSAGE)
        bench = opened.enter_context(
            bench_simulator.start_bench_simulator(
                run, wanted.seed, wanted.preset, self._publish_compilation
            )
        )
        self._compiled = True
        if order.plan is None:
            _advance_past_log(bench, self._folder)
        if order.options.speed is None:
            self._activity = bench.run_context()
        return bench.addresses

    def _open_folder(self, run: Run, addresses: DeviceAddresses) -> tuple[RunFolder, Journal]:
        """Return the folder and the journal of the run; create them if necessary."""
        order = self._order
        if order.plan is None:
            return reopen_run(self._folder, addresses)
        content = run_request.changed_run_file(run.path, order.sensor, order.filter)
        warnings = check_plan(run)
        made, journal = create_run(self._folder, run, addresses, content=content)
        for words in warnings:
            journal.record_event("warning", words)
        return made, journal

    def _execute_plan(
        self, made: RunFolder, journal: Journal, teller: RunTelemetry, ending: "_RunFinalizer"
    ) -> LiveEstimator | None:
        """Carry out the plan, or the rest of the plan, and return the live estimate."""
        was = journal.header()
        if not self._compiled:
            with on_compilation(self._publish_compilation):
                precompile_run(made.run, layout_of_address(was.imu))
        self._publish_phase("connecting to table and IMU")

        def show(run: BenchRun) -> None:
            self._record_notes(journal, run.time)
            teller(run)
            if run.pause_reason and was.clock:
                sleep(UPDATE_INTERVAL)  # a simulated bench that waits need not be fast

        def beside(run: BenchRun) -> AbstractContextManager[None]:
            self._control.attach(run)
            return self._activity

        options, background_work = self._order.options, ending.register_sync.background_work
        run = execute_run(made, journal, options, show, UPDATE_INTERVAL, beside, background_work)
        return run.recorder.live_estimator

    def _record_notes(self, journal: Journal, time: float | None = None) -> None:
        for words in self._control.take_notes():
            journal.record_event(NOTE_LEVEL, words, time)

    def _publish_compilation(self) -> None:
        self._publish_phase(bench_simulator.COMPILATION_MESSAGE)

    def _publish_phase(self, words: str) -> None:
        self._publisher.publish("phase", run=self._order.name, words=words)

    def _filter_text(self, changes: Mapping[str, str]) -> str:
        listed = "; ".join(f"{key} {text or 'as by default'}" for key, text in changes.items())
        return f"{self._by} changed on the page: {listed}"

    def _start_text(self, bench: run_request.SimulationRequest | None) -> str:
        what = "begun" if self._order.plan is not None else "resumed"
        words = f"{what} from the page by {self._by}"
        return words if bench is None else f"{words}; simulated bench, seed {bench.seed}"


class _RunFinalizer:
    """Writes the results of a run and enters the run in the register.

    If the register cannot be reached, this is reported, but the run does not fail. No run is lost,
    because the server enters all its runs when it is started the next time.

    Parameters
    ----------
    order : RunRequest
    made : RunFolder
    journal : Journal
    """

    def __init__(self, order: run_request.RunRequest, made: RunFolder, journal: Journal):
        self._order, self._folder, self._journal = order, made, journal
        self._register: Register | None = None
        try:
            self._register = Register(order.register, order.requested_by or None)
        except InercalError as error:
            journal.record_event("warning", f"the run is not in the register: {error}")
        self.register_sync = RegisterSync(self._register, made.path)

    def end(self, state: str, words: str, **more: object) -> run_request.EndMessage:
        """Enter the run in the register, and return the message about its end."""
        history = self._enter_in_register()
        return run_request.end_message(self._order, state, words, history=history, **more)

    def complete_run(self, live: LiveEstimator | None) -> run_request.EndMessage:
        """Write recording, calibration and report, and return the message about the end."""
        sensor = self._folder.run.sensor.name
        try:
            outcome, *_ = finish_run(
                self._folder, self._journal, live, lambda: self.register_sync.history(sensor)
            )
        except InercalError as error:
            self._journal.record_event("alarm", str(error))
            return self.end("carried out", str(error))
        name = quote(self._order.name, safe="")
        links = {what: f"/runs/{name}/{what}" for what in ("report", "calibration")}
        verdict = {
            "level": outcome.verdict.tone,
            "words": outcome.verdict.word,
            "reasons": list(outcome.verdict.reasons),
        }
        final = page_messages.final_estimates(outcome.calibration)
        return self.end("done", outcome.verdict.lines[0], verdict=verdict, final=final, **links)

    def _enter_in_register(self) -> str | None:
        """Enter the run in the register; return the address of the sensor's history, if any."""
        self.register_sync.update()
        if self.register_sync.trouble:
            self._journal.record_event("warning", self.register_sync.trouble)
        if self.register_sync.trouble or self._register is None:
            return None
        try:
            sensor = self._register.sensor(self._folder.run.sensor.name)
        except InercalError:
            return None
        return f"/history/{sensor.id}" if sensor.calibrations else None


def _simulation_request(order: run_request.RunRequest) -> run_request.SimulationRequest | None:
    """Return the settings of the simulated bench; None for a real bench.

    A resumed run keeps the settings of its simulated bench.
    """
    note = run_request.read_process_record(Path(order.folder)) if order.plan is None else None
    was = note.simulated if note is not None else None
    if order.simulated is None:
        return None if order.table or order.imu else was
    return run_request.SimulationRequest(
        order.simulated, was.seed if was is not None else order.seed
    )


def _advance_past_log(bench: bench_simulator.BenchSimulator, folder: Path) -> None:
    """Advance the simulated bench past the end of a run's log.

    Raises
    ------
    InputError
        The log is damaged.
    LinkLost
        The bench has ended.
    """
    log = folder / LOG
    if not log.exists() or bench.clock is None:
        return
    until = max((frame.time for frame in read_frames(log)), default=0.0) + _TIME_MARGIN
    clock = SimulatedClock(bench.clock)
    now = clock.now()
    while now < until:
        now = min(now + _TIME_STEP, until)
        clock.begin(now)
        clock.end()
    clock.close()


def main() -> int:
    """Carry out the request, and return the exit status."""
    control = CommandRelay()

    def hear(lines: LineReader) -> None:
        while (line := lines.next_line()) is not None:
            control.command(line)

    end = serve_request(
        run_request.RunRequest.from_json,
        lambda order, publisher: RunController(order, publisher, control).execute(),
        hear,
        control.interrupt,
    )
    return 0 if end is not None and end["state"] == "done" else 2 if end is None else 1


if __name__ == "__main__":
    sys.exit(main())
