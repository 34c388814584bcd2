"""Runs at three temperatures on a bench within the test's process, in a quick chamber."""

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from tests.host.in_process_bench import ADDRESSES, InProcessBench
from tests.host.simulated_runs import HEAD
from tests.host.watched_runs import Act, Killed, Watched

from inercal.host.addresses import DeviceAddresses
from inercal.host.journal import JournalEvent
from inercal.host.run_folder import create_run, reopen_run
from inercal.host.sim.chamber import SimulatedChamber
from inercal.runfile import Run, read

EXAMPLE = Path(__file__).parents[2] / "examples" / "turntable" / "soaks.toml"
CHAMBER = "simulated:"
# All axes at rest up, down and slanted, and a turn about each: enough for every coefficient.
PATH = HEAD + (
    "warm-up,position,0,0,0,24,,,\n"
    "y up,position,0,90,0,5,,,\n"
    "z down,position,0,180,0,5,,,\n"
    "y down,position,0,270,0,5,,,\n"
    "x down,position,0,0,90,5,,,\n"
    "x up,position,0,0,-90,5,,,\n"
    "askew,position,180,-45,45,5,,,\n"
    "x+,rotation,0,0,0,,middle,360,30\n"
    "x-,rotation,,,,,middle,-360,30\n"
    "y+,rotation,,,,,inner,360,30\n"
    "z+,rotation,,,,,outer,360,30\n"
    "rest,position,0,0,0,5,,,\n"
)
# A chamber that goes from one soak to the next in a minute.
QUICK = (
    ('"5 min"', '"10 s"'),
    ('drift = "0.1 K/min"', 'drift = "2 K/min"'),
    ('"5 K/min"', '"100 K/min"'),
    ('"100 Hz"', '"50 Hz"'),
)


def soak_run(folder: Path, path: str = PATH, *replaced: tuple[str, str]) -> Run:
    """Write the example with a short path and a quick chamber."""
    text = EXAMPLE.read_text(encoding="utf-8")
    for old, new in (*QUICK, *replaced):
        assert old in text, old
        text = text.replace(old, new)
    folder.mkdir(parents=True)
    (folder / "path.csv").write_text(path, encoding="utf-8")
    (folder / "soaks.toml").write_text(text, encoding="utf-8")
    return read(folder / "soaks.toml")


class QuickChamber(SimulatedChamber):
    """A chamber that hears nothing from a host that was killed."""

    host_is_gone = False

    def stop(self) -> None:
        if not self.host_is_gone:
            super().stop()


def chamber_bench(run: Run, seed: int = 1) -> InProcessBench:
    """Return a bench in a quick chamber."""
    bench = InProcessBench(run, seed)
    bench.chamber = QuickChamber(lambda: bench.time, ramp=1.0, lag=2.0, case_lag=8.0)
    bench.restart_imu()
    return bench


@dataclass(frozen=True)
class Soaked:
    """What became of a run in a chamber that was begun or resumed."""

    done: bool
    trouble: str
    events: tuple[JournalEvent, ...]


def soak(
    folder: Path, run: Run | None = None, act: Act = lambda driven: None, poll: float = 0.05
) -> Soaked:
    """Begin a run, or resume the one in the folder, and act before each tick."""
    made, journal = (
        reopen_run(folder)
        if run is None
        else create_run(folder, run, ADDRESSES, poll, chamber=CHAMBER)
    )
    with journal:
        said = len(journal.events())
        with Watched(made, journal, DeviceAddresses(*ADDRESSES)) as driven:
            driven.act = act
            done = driven.execute_plan()
        return Soaked(done, driven.trouble, journal.events(said))


def soak_until(folder: Path, time: float, bench: InProcessBench, run: Run | None) -> bool:
    """Begin or resume a run and kill its host at a time; return whether it was killed."""
    chamber = bench.chamber
    assert isinstance(chamber, QuickChamber)
    chamber.host_is_gone = False

    def act(driven: Watched) -> None:
        if bench.time >= time:
            chamber.host_is_gone = True
            raise Killed

    with suppress(Killed):
        soak(folder, run, act)
        return False
    chamber.host_is_gone = False
    bench.stop()
    return True
