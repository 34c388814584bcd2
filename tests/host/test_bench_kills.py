"""A host that is killed or frozen at any moment: the table comes to rest, and the run goes on."""

import json
import os
import signal
import subprocess
from pathlib import Path
from time import monotonic
from typing import Any

import h5py
import numpy as np
import pytest
from tests.host.journal_sections import sections_done
from tests.host.simulated_runs import INERCAL, SHORT, plan, quick

from inercal.host.addresses import open_table
from inercal.host.bench_simulator import BenchSimulator
from inercal.host.journal import Journal
from inercal.host.preparation import precompile_run
from inercal.runfile import Run, read

SEED = 3
DECELERATION = 30 / 15  # s from 30 °/s at 15 °/s²
WATCHDOG = 2.0  # s


class Unbroken:
    """A run that nothing happens to: how long its log is, and what it finds."""

    def __init__(self, folder: Path):
        self.run = plan(folder / "plan", quick())
        precompile_run(self.run)
        with BenchSimulator(self.run.path, SEED) as bench:
            told = command(self.run, bench, folder / "run")
            done = subprocess.run(told, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        self.found = found(done.stdout)
        self.size = (folder / "run" / "run.log").stat().st_size


@pytest.fixture(scope="module")
def unbroken(tmp_path_factory: pytest.TempPathFactory) -> Unbroken:
    return Unbroken(tmp_path_factory.mktemp("unbroken"))


def command(run: Run, bench: BenchSimulator, folder: Path) -> list[str]:
    where = ["--table", bench.table, "--imu", bench.imu, "--clock", str(bench.clock)]
    return [*INERCAL, "bench", "run", str(run.path), *where, "--out", str(folder), "--json"]


def started(run: Run, bench: BenchSimulator, folder: Path) -> "subprocess.Popen[str]":
    pipe = subprocess.PIPE
    return subprocess.Popen(command(run, bench, folder), stdout=pipe, stderr=pipe, text=True)


def found(printed: str) -> dict[str, tuple[float, float]]:
    content: dict[str, Any] = json.loads(printed)
    return {one["name"]: (one["value"], one["std"]) for one in content["coefficients"]}


def until_log_is(folder: Path, size: int, host: "subprocess.Popen[str]") -> None:
    """Wait until the log has so many bytes, or the host ends."""
    log = folder / "run.log"
    while not (log.exists() and log.stat().st_size >= size) and host.poll() is None:
        try:
            host.wait(0.002)
        except subprocess.TimeoutExpired:
            continue


def seconds_to_rest(bench: BenchSimulator) -> float:
    """Return how long the table still turns by its own clock and the wall's, whichever is more."""
    begun = monotonic()
    with open_table(bench.table, None) as table:
        first = state = table.read()
        while any(abs(axis.rate) > 1e-3 or axis.moving for axis in state.axes):
            assert monotonic() - begun < 60
            state = table.read()
        return max(monotonic() - begun, state.time - first.time)


def require_whole(folder: Path, run: Run) -> None:
    """No sample is lost or doubled in a section that is done; each step was done once, whole."""
    file: Any
    with h5py.File(folder / "recording.h5") as file:
        time, label = file["time"][:], file["step"].asstr()[:]
        hold = file["hold"][:]
    step = np.diff(time)
    assert np.all(step > 0)
    np.testing.assert_allclose(step * 200, np.round(step * 200), atol=1e-6)
    sections = read(folder / "plan.toml").steps
    for one in sections:
        at = np.flatnonzero(label == one.label)
        assert at.size, one.label
        assert np.all(np.diff(at) == 1), one.label
        assert np.all(np.round(step[at[:-1]] * 200) == 1), one.label
    with Journal(folder / "run.journal") as journal:
        assert [done for done, _, _ in sections_done(journal)] == [one.label for one in sections]
        for name, (size, _) in journal.files().items():
            assert (folder / name).stat().st_size == size
        for done, begin, end in sections_done(journal):
            n = np.count_nonzero(label == done)
            assert abs(n - (end - begin) * 200) <= 2, done
    # Numbers of holds never return.
    changes = hold[np.flatnonzero(np.diff(hold)) + 1]
    numbers = changes[changes >= 0]
    assert np.all(np.diff(numbers) > 0)


def killed_and_resumed(folder: Path, unbroken: Unbroken, share: float) -> None:
    run = unbroken.run
    with BenchSimulator(run.path, SEED) as bench:
        with started(run, bench, folder) as host:
            until_log_is(folder, round(share * unbroken.size), host)
            host.send_signal(signal.SIGKILL)
            assert seconds_to_rest(bench) < WATCHDOG + DECELERATION
        done = subprocess.run(
            [*INERCAL, "bench", "resume", str(folder), "--json"],
            capture_output=True,
            text=True,
            check=False,
        )
    assert done.returncode == 0, done.stderr
    require_whole(folder, run)
    again = found(done.stdout)
    for name, (value, std) in unbroken.found.items():
        other, its = again[name]
        assert abs(other - value) < 5 * np.hypot(std, its), name


MOMENTS = np.random.default_rng(20).uniform(0.01, 1.0, 20).round(4).tolist()


@pytest.mark.evidence
@pytest.mark.parametrize(
    "share",
    MOMENTS[:8],
)
def test_a_run_killed_at_any_moment_is_finished_by_resume(
    tmp_path: Path, unbroken: Unbroken, share: float
):
    killed_and_resumed(tmp_path / "run", unbroken, share)


@pytest.mark.evidence
@pytest.mark.parametrize("share", MOMENTS[8:])
def test_a_run_killed_at_twelve_more_moments_is_finished_by_resume(
    tmp_path: Path, unbroken: Unbroken, share: float
):
    killed_and_resumed(tmp_path / "run", unbroken, share)


@pytest.mark.evidence
def test_a_host_that_freezes_has_its_table_stopped_and_repeats_the_step(tmp_path: Path):
    run = plan(tmp_path / "plan", SHORT.replace("outer,90,30", "outer,1080,30"))
    precompile_run(run)
    folder = tmp_path / "run"
    with BenchSimulator(run.path, SEED) as bench, started(run, bench, folder) as host:
        until_turning(folder, bench, host)
        host.send_signal(signal.SIGSTOP)
        seconds_to_rest(bench)
        host.send_signal(signal.SIGCONT)
        host.communicate()
    with Journal(folder / "run.journal") as journal:
        words = [event.words for event in journal.events()]
        assert [label for label, _, _ in sections_done(journal)] == [
            "warm-up",
            "y up",
            "z+",
            "rest",
        ]
    assert any("silent" in one and "repeated" in one for one in words), words
    assert os.path.getsize(folder / "recording.h5") > 0


def until_turning(folder: Path, bench: BenchSimulator, host: "subprocess.Popen[str]") -> None:
    """Wait until the table turns in the rotation z+: the journal says it when it is commanded."""
    while host.poll() is None and not rotation_has_begun(folder / "run.journal"):
        pass
    with open_table(bench.table, None) as table:
        while host.poll() is None and all(abs(axis.rate) < 0.1 for axis in table.read().axes):
            pass


def rotation_has_begun(path: Path) -> bool:
    if not path.exists():
        return False
    with Journal(path) as journal:
        return any("z+" in event.words for event in journal.events())
