"""One run, from the order to the register, told while it goes on."""

import os
from collections.abc import Mapping
from contextlib import AbstractContextManager, ExitStack, nullcontext
from pathlib import Path
from time import sleep
from typing import Any

from inercal.benches.turntable import turntable_of
from inercal.host.addresses import Addresses, layout_of_address
from inercal.host.compile import compiled
from inercal.host.execute import Interrupted, carried_out
from inercal.host.folder import JOURNAL, POLL, Folder, begin, resumed
from inercal.host.journal import Journal
from inercal.host.live import Live
from inercal.host.run import BenchRun
from inercal.host.simulated import POLL as SIMULATED_POLL
from inercal.host.simulated import STARTING, started
from inercal.host.web import pictures, simulating
from inercal.host.web.control import Control
from inercal.host.web.finalizer import RunFinalizer
from inercal.host.web.order import NOTE, RunRequest, Simulated, note, renamed
from inercal.host.web.publish import Publisher
from inercal.host.web.telemetry import EVERY, RunTelemetry
from inercal.runfile import Run, read


class RunController:
    """A run as it is ordered.

    Parameters
    ----------
    order : RunRequest
    publisher : Publisher
    control : Control
    """

    def __init__(self, order: RunRequest, publisher: Publisher, control: Control):
        self._order, self._publisher, self._control = order, publisher, control
        self._folder = Path(order.folder)
        self._beside: AbstractContextManager[None] = nullcontext()
        self._compiled = False

    def carry_out(self) -> Mapping[str, Any]:
        """Carry out the run as far as that is possible; return what is told of its end.

        Raises
        ------
        InercalError
            Nothing was begun.
        """
        run = self._planned()
        with ExitStack() as opened:
            bench = simulating.wanted(self._order)
            addresses = self._addresses(run, bench, opened)
            made, journal = self._made(run, addresses)
            opened.enter_context(journal)
            with made.kept_if_begun(NOTE) if self._order.plan is not None else nullcontext():
                opened.callback(os.close, note(made.path, bench))
                journal.event("info", self._words(bench))
                ending = RunFinalizer(self._order, made, journal)
                teller = RunTelemetry(self._publisher, made.run, turntable_of(run), journal)
                told = self._to_its_end(made, journal, teller, ending)
                teller.events()
                return told

    def _to_its_end(
        self, made: Folder, journal: Journal, teller: RunTelemetry, ending: RunFinalizer
    ) -> Mapping[str, Any]:
        """Have done what is left of a run; return what is told of its end."""
        live = None
        if journal.header().state != "carried out":
            try:
                live = self._carried_out(made, journal, teller, ending)
            except Interrupted as error:
                return ending.interrupted(str(error))
            finally:
                teller.events()
        self._control.interruptible = False
        self._phase("finishing: recording, calibration, report")
        return ending.finished(live)

    def _planned(self) -> Run:
        """Return the run file that is wanted, and tell what is in it."""
        order, clock = self._order, self._order.clock
        if order.plan is not None:
            run = read(order.plan)
        else:
            with Journal(self._folder / JOURNAL) as journal:
                was = journal.header()
            run, clock = read(self._folder / was.run_file), clock or was.clock
        told = pictures.plan(run, turntable_of(run)) | {"run": order.name}
        told["simulated"] = simulating.wanted(order) is not None or bool(clock)
        told["sensor"] = order.sensor or told["sensor"]
        self._publisher.tell("plan", **told)
        return run

    def _addresses(self, run: Run, wanted: Simulated | None, opened: ExitStack) -> Addresses:
        order = self._order
        if wanted is None:
            return Addresses(order.table, order.imu, order.clock)
        self._phase(STARTING)
        bench = opened.enter_context(started(run, wanted.seed, wanted.preset))
        self._compiled = True
        if order.plan is None:
            simulating.let_pass(bench, self._folder)
        if order.speed is None:
            self._beside = bench.beside()
        return bench.addresses

    def _made(self, run: Run, addresses: Addresses) -> tuple[Folder, Journal]:
        """Return the run's folder and its journal, both made if need be."""
        order = self._order
        if order.plan is None:
            return resumed(self._folder, addresses)
        content = None if order.sensor is None else renamed(run.path, order.sensor)
        poll = POLL if simulating.wanted(order) is None else SIMULATED_POLL
        return begin(self._folder, run, addresses, poll, content)

    def _carried_out(
        self, made: Folder, journal: Journal, teller: RunTelemetry, ending: RunFinalizer
    ) -> Live | None:
        """Have the plan carried out, or what is left of it; return what was found meanwhile."""
        was = journal.header()
        if not self._compiled:
            self._phase("compiling what a run needs, once on each machine")
            compiled(made.run, layout_of_address(was.imu))
        self._phase("connecting to table and IMU")

        def show(run: BenchRun) -> None:
            teller(run)
            if run.paused and was.clock:
                sleep(EVERY)  # a simulated bench has no reason to hurry while it waits

        def beside(run: BenchRun) -> AbstractContextManager[None]:
            self._control.attach(run)
            return self._beside

        options, meanwhile = self._order.options, ending.keeper.meanwhile
        run = carried_out(made, journal, options, show, EVERY, beside, meanwhile)
        return run.account.live

    def _phase(self, words: str) -> None:
        self._publisher.tell("phase", run=self._order.name, words=words)

    def _words(self, bench: Simulated | None) -> str:
        what = "begun" if self._order.plan is not None else "resumed"
        words = f"{what} from the page by {self._order.by or 'an operator without a name'}"
        return words if bench is None else f"{words}; simulated bench, seed {bench.seed}"
