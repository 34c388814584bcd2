"""The host's date is set back and forward by an hour before a run is resumed.

The programs are those of a user, on a simulated bench whose time nobody grants; libfaketime tells
them the date, and shifts their monotonic clock too. Where it is not installed (Debian: `faketime`),
these tests are skipped. `test_run_time` sets the date during a run.
"""

import shutil
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event
from time import monotonic

import pytest
from tests.host.simulated_runs import INERCAL, SHORT, plan

from inercal.host.addresses import open_table
from inercal.host.bench_simulator import BenchSimulator
from inercal.host.journal import Journal, JournalEvent
from inercal.host.preparation import precompile_run
from inercal.host.run_log import read_frames

FAKETIME = shutil.which("faketime")
pytestmark = [
    pytest.mark.evidence,
    pytest.mark.skipif(FAKETIME is None, reason="faketime is not installed"),
]
PATH = SHORT.replace("outer,90,30", "outer,360,30")
PATIENCE = 180.0  # s until the table turns: to home takes 40 s
LOOK = 0.02  # s between two looks at a run


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[BenchSimulator]:
    run = plan(tmp_path / "plan", PATH)
    precompile_run(run)
    with BenchSimulator(run.path, seed=3, pace=1.0) as bench:
        yield bench


@contextmanager
def program(*words: str, wrapper: tuple[str, ...] = ()) -> Iterator["subprocess.Popen[str]"]:
    """Run `inercal bench`, and end it with the context."""
    pipe = subprocess.PIPE
    host = subprocess.Popen(
        [*wrapper, *INERCAL, "bench", *words], stdout=pipe, stderr=pipe, text=True
    )
    try:
        yield host
    finally:
        if host.poll() is None:
            host.terminate()
        host.communicate()


def begin(bench: BenchSimulator, folder: Path) -> tuple[str, ...]:
    run_file = str(folder.parent / "plan" / "plan.toml")
    return ("run", run_file, "--table", bench.table, "--imu", bench.imu, "--out", str(folder))


def events(folder: Path) -> tuple[JournalEvent, ...]:
    if not (folder / "run.journal").exists():
        return ()
    with Journal(folder / "run.journal") as journal:
        return journal.events()


def until_turning(bench: BenchSimulator, folder: Path, begun: int) -> None:
    """Wait until the rotation has begun once more than `begun` times, and the table turns."""
    end = monotonic() + PATIENCE
    while sum("z+" in one.words for one in events(folder)) <= begun:
        assert monotonic() < end, [one.words for one in events(folder)]
        Event().wait(LOOK)
    with open_table(bench.table, None) as table:
        while abs(table.read().axes[0].rate) < 0.3:
            assert monotonic() < end
            Event().wait(LOOK)


def seconds_to_the_alarm(bench: BenchSimulator, folder: Path) -> float:
    """Freeze the encoder of the axis that turns; return how long the run goes on, s."""
    bench.inject_fault("table", "fault frozen 1")
    frozen = monotonic()
    while not any(one.level == "alarm" for one in events(folder)):
        assert monotonic() - frozen < 10.0
        Event().wait(LOOK)
    return monotonic() - frozen


@pytest.mark.parametrize("step", ["-1h", "+1h"])
def test_a_run_that_is_resumed_an_hour_off_finds_a_frozen_encoder_within_a_second(
    tmp_path: Path, bench: BenchSimulator, step: str
):
    folder = tmp_path / "run"
    with program(*begin(bench, folder)) as host:
        until_turning(bench, folder, 0)
        host.send_signal(signal.SIGKILL)
        host.wait()
    assert FAKETIME is not None
    with program("resume", str(folder), wrapper=(FAKETIME, "-f", step)):
        until_turning(bench, folder, 1)
        took = seconds_to_the_alarm(bench, folder)
    assert took <= 1.0
    times = [frame.time for frame in read_frames(folder / "run.log")]
    assert 0.0 <= min(times) < max(times) < 120.0
