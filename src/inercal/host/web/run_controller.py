"""One run, from the order to the register, told while it goes on."""

import os
from collections.abc import Mapping
from contextlib import AbstractContextManager, ExitStack, nullcontext
from pathlib import Path
from time import sleep
from typing import Any

from inercal.benches.turntable import require_turntable
from inercal.host.addresses import DeviceAddresses, layout_of_address
from inercal.host.bench_run import BenchRun
from inercal.host.bench_simulator import STARTUP_MESSAGE, start_bench_simulator
from inercal.host.journal import Journal
from inercal.host.live_estimator import LiveEstimator
from inercal.host.precompilation import precompile_run
from inercal.host.run_execution import RunInterrupted, execute_run
from inercal.host.run_folder import JOURNAL, RunFolder, create_run, reopen_run
from inercal.host.web import page_messages, run_simulation
from inercal.host.web.command_relay import CommandRelay
from inercal.host.web.finalizer import RunFinalizer
from inercal.host.web.publisher import Publisher
from inercal.host.web.run_request import (
    PROCESS_RECORD,
    RunRequest,
    SimulationRequest,
    rename_sensor,
    write_process_record,
)
from inercal.host.web.telemetry import UPDATE_INTERVAL, RunTelemetry
from inercal.runfile import Run, read


class RunController:
    """A run as it is ordered.

    Parameters
    ----------
    order : RunRequest
    publisher : Publisher
    control : CommandRelay
    """

    def __init__(self, order: RunRequest, publisher: Publisher, control: CommandRelay):
        self._order, self._publisher, self._control = order, publisher, control
        self._folder = Path(order.folder)
        self._activity: AbstractContextManager[None] = nullcontext()
        self._compiled = False

    def execute(self) -> Mapping[str, Any]:
        """Carry out the run as far as that is possible; return what is told of its end.

        Raises
        ------
        InercalError
            Nothing was begun.
        """
        run = self._read_plan()
        with ExitStack() as opened:
            bench = run_simulation.simulation_request(self._order)
            addresses = self._open_addresses(run, bench, opened)
            result, journal = self._open_folder(run, addresses)
            opened.enter_context(journal)
            with (
                result.removed_on_failure(PROCESS_RECORD)
                if self._order.plan is not None
                else nullcontext()
            ):
                opened.callback(os.close, write_process_record(result.path, bench))
                journal.record_event("info", self._start_text(bench))
                ending = RunFinalizer(self._order, result, journal)
                teller = RunTelemetry(self._publisher, result.run, require_turntable(run), journal)
                told = self._complete_run(result, journal, teller, ending)
                teller.publish_events()
                return told

    def _complete_run(
        self, made: RunFolder, journal: Journal, teller: RunTelemetry, ending: RunFinalizer
    ) -> Mapping[str, Any]:
        """Have done what is left of a run; return what is told of its end."""
        live = None
        if journal.header().state != "carried out":
            try:
                live = self._execute_plan(made, journal, teller, ending)
            except RunInterrupted as error:
                return ending.interruption_message(str(error))
            finally:
                teller.publish_events()
        self._control.interruptible = False
        self._publish_phase("finishing: recording, calibration, report")
        return ending.complete_run(live)

    def _read_plan(self) -> Run:
        """Return the run file that is wanted, and tell what is in it."""
        order, clock = self._order, self._order.clock
        if order.plan is not None:
            run = read(order.plan)
        else:
            with Journal(self._folder / JOURNAL) as journal:
                was = journal.header()
            run, clock = read(self._folder / was.run_file), clock or was.clock
        told = page_messages.plan_message(run, require_turntable(run)) | {"run": order.name}
        told["simulated"] = run_simulation.simulation_request(order) is not None or bool(clock)
        told["sensor"] = order.sensor or told["sensor"]
        self._publisher.publish("plan", **told)
        return run

    def _open_addresses(
        self, run: Run, wanted: SimulationRequest | None, opened: ExitStack
    ) -> DeviceAddresses:
        order = self._order
        if wanted is None:
            return DeviceAddresses(order.table, order.imu, order.clock)
        self._publish_phase(STARTUP_MESSAGE)
        bench = opened.enter_context(start_bench_simulator(run, wanted.seed, wanted.preset))
        self._compiled = True
        if order.plan is None:
            run_simulation.advance_past_log(bench, self._folder)
        if order.speed is None:
            self._activity = bench.run_context()
        return bench.addresses

    def _open_folder(self, run: Run, addresses: DeviceAddresses) -> tuple[RunFolder, Journal]:
        """Return the run's folder and its journal, both made if need be."""
        order = self._order
        if order.plan is None:
            return reopen_run(self._folder, addresses)
        content = None if order.sensor is None else rename_sensor(run.path, order.sensor)
        return create_run(self._folder, run, addresses, content=content)

    def _execute_plan(
        self, made: RunFolder, journal: Journal, teller: RunTelemetry, ending: RunFinalizer
    ) -> LiveEstimator | None:
        """Have the plan carried out, or what is left of it; return what was found meanwhile."""
        was = journal.header()
        if not self._compiled:
            self._publish_phase("compiling what a run needs, once on each machine")
            precompile_run(made.run, layout_of_address(was.imu))
        self._publish_phase("connecting to table and IMU")

        def show(run: BenchRun) -> None:
            teller(run)
            if run.pause_reason and was.clock:
                sleep(UPDATE_INTERVAL)  # a simulated bench has no reason to hurry while it waits

        def beside(run: BenchRun) -> AbstractContextManager[None]:
            self._control.attach(run)
            return self._activity

        options, background_work = self._order.options, ending.register_sync.background_work
        run = execute_run(made, journal, options, show, UPDATE_INTERVAL, beside, background_work)
        return run.recorder.live_estimator

    def _publish_phase(self, words: str) -> None:
        self._publisher.publish("phase", run=self._order.name, words=words)

    def _start_text(self, bench: SimulationRequest | None) -> str:
        what = "begun" if self._order.plan is not None else "resumed"
        words = (
            f"{what} from the page by {self._order.requested_by or 'an operator without a name'}"
        )
        return words if bench is None else f"{words}; simulated bench, seed {bench.seed}"
