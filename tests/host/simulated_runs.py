"""Runs on simulated benches, with things that go wrong at times of the bench."""

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from tests.host.journal_sections import sections_done

from inercal.host.bench_run import BenchRun
from inercal.host.bench_simulator import BenchSimulator
from inercal.host.journal import JournalEvent
from inercal.host.run_folder import RunFolder, create_run, reopen_run
from inercal.host.tasks import RunOptions
from inercal.runfile import Run, read

HEAD = "label,kind,outer [°],middle [°],inner [°],seconds [s],axis,angle [°],rate [°/s]\n"
# Too little to find everything, enough to begin filters, hold and turn.
SHORT = HEAD + (
    "warm-up,position,0,0,0,22,,,\n"
    "y up,position,0,90,0,3,,,\n"
    "z+,rotation,0,0,0,,outer,90,30\n"
    "rest,position,0,0,0,2,,,\n"
)
INERCAL = [sys.executable, "-m", "inercal"]
Act = Callable[["Interfered"], None]


def plan(folder: Path, path: str = SHORT, replaced: Sequence[tuple[str, str]] = ()) -> Run:
    """Write the demonstration's run file with a path of one's own, and what is replaced in it."""
    folder.mkdir(parents=True, exist_ok=True)
    text = files("inercal").joinpath("demo.toml").read_text(encoding="utf-8")
    for old, new in (('path = "fast"', 'path = "path.csv"'), *replaced):
        assert old in text
        text = text.replace(old, new)
    (folder / "path.csv").write_text(path, encoding="utf-8")
    (folder / "plan.toml").write_text(text, encoding="utf-8")
    return read(folder / "plan.toml")


def quick() -> str:
    """Return the demonstration's path of five minutes."""
    return files("inercal").joinpath("demo_path.csv").read_text(encoding="utf-8")


class Interfered(BenchRun):
    """A run during which things happen, each when the sequencer has got to a step and phase."""

    acts: list[tuple[str, str, Act]]

    def _tick(self) -> None:
        task = self.sequencer.task
        if self.acts and task and (task.label, self.sequencer.phase) == self.acts[0][:2]:
            self.acts.pop(0)[2](self)
        super()._tick()


@dataclass(frozen=True)
class Ended:
    """How a run ended."""

    done: bool
    run: BenchRun
    events: tuple[JournalEvent, ...]
    sections: tuple[tuple[str, float, float], ...]

    @property
    def words(self) -> str:
        """What was said of it that is no mere news."""
        return "\n".join(one.words for one in self.events if one.level != "info")


def carried_out(
    folder: Path,
    bench: BenchSimulator,
    run: Run | None = None,
    acts: Sequence[tuple[str, str, Act]] = (),
    options: RunOptions | None = None,
    poll: float = 0.05,
) -> Ended:
    """Begin a run in a folder, or resume the one in it; see how it ends.

    So seldom as it is polled here a run passes in a few seconds.
    """
    made, journal = (
        reopen_run(folder) if run is None else create_run(folder, run, bench.addresses, poll)
    )
    with journal:
        with Interfered(made, journal, bench.addresses, options or RunOptions()) as run_process:
            run_process.acts = list(acts)
            done = run_process.execute_plan()
        return Ended(done, run_process, journal.events(), sections_done(journal))


def made(folder: Path) -> RunFolder:
    """Return the folder of a run."""
    return RunFolder.open_existing(folder, "plan.toml")
