"""Runs within the test's process, with something done before each tick."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from tests.host.in_process_bench import ADDRESSES, InProcessBench
from tests.host.simulated_runs import SHORT

from inercal.host.addresses import DeviceAddresses
from inercal.host.bench_run import BenchRun
from inercal.host.journal import JournalEvent
from inercal.host.run_folder import create_run, reopen_run
from inercal.runfile import Run

PATH = SHORT.replace("0,0,0,22", "0,0,0,6").replace("outer,90,30", "outer,360,30")
Act = Callable[["Watched"], None]


class Killed(BaseException):
    """What ends a host as `kill -9` does: nothing more is recorded of its run."""


class Watched(BenchRun):
    """A run that does something before each tick."""

    act: Act

    def _tick(self) -> None:
        self.act(self)
        super()._tick()


@dataclass(frozen=True)
class Driven:
    """What became of a run that was begun or resumed."""

    done: bool
    trouble: str
    events: tuple[JournalEvent, ...]


def drive(folder: Path, act: Act, run: Run | None = None) -> Driven:
    """Begin a run, or resume the one in the folder; `act` is called before each tick."""
    made, journal = reopen_run(folder) if run is None else create_run(folder, run, ADDRESSES)
    with journal:
        said = len(journal.events())
        with Watched(made, journal, DeviceAddresses(*ADDRESSES)) as driven:
            driven.act = act
            done = driven.execute_plan()
        return Driven(done, driven.trouble, journal.events(said))


def kill_in_the_rotation(folder: Path, bench: InProcessBench, run: Run) -> None:
    """Leave a run whose host was killed 1 s after the rotation began."""

    def act(driven: Watched) -> None:
        if in_rotation(driven) and bench.device.controller.table.state.rate[0] > 0.2:
            raise Killed

    with suppress(Killed):
        drive(folder, act, run)


def in_rotation(driven: Watched) -> bool:
    task = driven.sequencer.task
    return task is not None and (task.label, driven.sequencer.phase) == ("z+", "work")
