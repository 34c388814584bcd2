"""A ship-model plan carried out: states at rates, mountings that an operator confirms."""

import subprocess
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.stats import chi2
from tests.host.in_process_bench import ADDRESSES, InProcessBench
from tests.host.simulated_runs import INERCAL
from tests.host.synthetic_log import LAYOUT
from tests.host.test_bench_kills import WATCHDOG, seconds_to_rest

from inercal.calibration import Calibration
from inercal.host.addresses import DeviceAddresses
from inercal.host.bench_run import BenchRun
from inercal.host.bench_simulator import BenchSimulator
from inercal.host.journal import Journal, JournalEvent
from inercal.host.recording_writer import write_recording
from inercal.host.run_execution import finish_run
from inercal.host.run_folder import create_run, reopen_run
from inercal.pipeline import calibrate
from inercal.runfile import Run, read

EXAMPLE = Path(__file__).parents[2] / "examples" / "rate_table" / "ship_bench.toml"
MOUNTINGS = ["XY", "YX", "ZY"]
DECELERATION = 516 / 100  # s from 86 r/min at 100 °/s²
Act = Callable[["Operated"], None]


def ship(folder: Path, seconds: str = "8 s") -> Run:
    """Write the example with short states."""
    text = EXAMPLE.read_text(encoding="utf-8")
    assert '"150 s"' in text
    folder.mkdir(parents=True)
    path = folder / "ship.toml"
    path.write_text(text.replace('"150 s"', f'"{seconds}"'), encoding="utf-8")
    return read(path)


class Killed(Exception):
    """The host is gone, without a word."""


class Operated(BenchRun):
    """A run with an operator, who acts before each tick and mounts what is asked for."""

    act: Act | None = None
    asked: list[str]
    bench: InProcessBench

    def _tick(self) -> None:
        if self.act is not None:
            self.act(self)
        request = self.mounting_request
        if request is not None and self.bench.device.mounting != request.mounting:
            assert abs(self.bench.device.controller.table.state.rate[0]) < 0.01
            self.asked.append(request.mounting)
            self.bench.device.mount(request.mounting)
            self.confirm_mounting(request.number, request.mounting, "Anna")
        super()._tick()


def drive(
    folder: Path, bench: InProcessBench, run: Run | None = None, act: Act | None = None
) -> list[str]:
    """Begin a run, or resume the one in the folder; return the mountings that were asked for."""
    made, journal = reopen_run(folder) if run is None else create_run(folder, run, ADDRESSES)
    asked: list[str] = []
    with journal, Operated(made, journal, DeviceAddresses(*ADDRESSES)) as driven:
        driven.act, driven.asked, driven.bench = act, asked, bench
        with suppress(Killed):
            assert driven.execute_plan(), driven.trouble
    return asked


def finished(folder: Path) -> tuple[Calibration, tuple[JournalEvent, ...]]:
    made, journal = reopen_run(folder)
    with journal:
        return finish_run(made, journal).outcome.calibration, journal.events()


def squared_error(found: Calibration, run: Run) -> float:
    """Return the error squared over the stated covariance."""
    off = found.values - np.array([run.truth[name] for name in found.sensor.coefficients])
    return float(off @ np.linalg.solve(found.covariance, off))


@pytest.fixture
def begun(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[[int], tuple[Run, InProcessBench]]:
    def begin(seed: int) -> tuple[Run, InProcessBench]:
        run = ship(tmp_path / f"plan{seed}")
        bench = InProcessBench(run, seed)
        bench.install(monkeypatch)
        return run, bench

    return begin


@pytest.mark.slow
def test_a_ship_plan_finds_the_truth_in_mountings_that_an_operator_confirmed(
    tmp_path: Path, begun: Callable[[int], tuple[Run, InProcessBench]]
):
    run, bench = begun(1)
    assert drive(tmp_path / "run", bench, run) == MOUNTINGS
    found, events = finished(tmp_path / "run")
    assert squared_error(found, run) < chi2.ppf(0.999, found.values.size)
    assert found.verdict is not None
    assert found.verdict.grade == "consistent"
    # Who confirmed what stands in the journal, with the time of the run.
    confirmed = [one for one in events if one.words.startswith("Anna")]
    assert len(confirmed) == len(MOUNTINGS)
    assert all(one.time is not None for one in confirmed)
    again = calibrate(read(tmp_path / "run" / "ship.toml")).calibration
    assert again.values.tobytes() == found.values.tobytes()


@pytest.mark.evidence
@pytest.mark.parametrize("seeds", [range(2, 14)])
def test_errors_of_many_ship_runs_are_as_stated(
    tmp_path: Path, begun: Callable[[int], tuple[Run, InProcessBench]], seeds: range
):
    total, count = 0.0, 0
    for seed in seeds:
        run, bench = begun(seed)
        drive(tmp_path / f"run{seed}", bench, run)
        found, _ = finished(tmp_path / f"run{seed}")
        total, count = total + squared_error(found, run), count + found.values.size
    assert chi2.ppf(0.001, count) < total < chi2.ppf(0.999, count)


@pytest.mark.slow
def test_a_killed_run_repeats_its_state_and_asks_for_no_mounting_again(
    tmp_path: Path, begun: Callable[[int], tuple[Run, InProcessBench]]
):
    run, bench = begun(1)

    working: list[float] = []

    def kill_in_the_second_state(driven: Operated) -> None:
        task = driven.sequencer.task
        if task and (task.label, driven.sequencer.phase) == ("XY_46", "work"):
            working.append(bench.time)
            if working[-1] - working[0] > 3.0:
                raise Killed

    folder = tmp_path / "run"
    assert drive(folder, bench, run, kill_in_the_second_state) == ["XY"]
    bench.stop()

    def kill_in_the_next_mounting(driven: Operated) -> None:
        task = driven.sequencer.task
        if task and (task.label[:2], driven.sequencer.phase) == ("YX", "work"):
            raise Killed

    assert drive(folder, bench, act=kill_in_the_next_mounting) == ["YX"]
    left, journal = reopen_run(folder)
    journal.close()
    file: Any
    with h5py.File(write_recording(left.run, LAYOUT, left.log, left.path)) as file:
        label, rpm = file["mounting"].asstr()[:], file["rpm"][:]
    # The state that was interrupted is there once, whole; what was before has no label.
    at_46 = (label == "XY") & (np.abs(rpm - 46) < 1)
    first, last = np.flatnonzero(at_46)[[0, -1]]
    assert at_46[first:last].all()
    assert (last - first) / 50 == pytest.approx(8.0, abs=0.2)
    assert np.any((label == "") & (np.abs(rpm - 46) < 1))


def test_a_confirmation_from_before_the_request_has_no_table_turn(
    tmp_path: Path, begun: Callable[[int], tuple[Run, InProcessBench]]
):
    """Every tick the step that will wait is confirmed, while nobody has been asked yet."""
    run, bench = begun(1)
    rates: list[float] = []

    def confirm_early(driven: Operated) -> None:
        if driven.mounting_request is None:
            driven.confirm_mounting(driven.sequencer.number, "XY", "Eve")
            return
        rates.append(float(bench.device.controller.table.state.rate[0]))
        driven.bench.device.mounting = "XY"  # the operator of `Operated` has nothing to do
        if len(rates) > 100:
            raise Killed

    drive(tmp_path / "run", bench, run, confirm_early)
    assert len(rates) > 100
    assert max(np.abs(rates)) < 1e-3
    with Journal(tmp_path / "run" / "run.journal") as journal:
        assert journal.mounting() == ""


@pytest.mark.slow
def test_without_a_terminal_real_hardware_needs_a_file_of_answers(tmp_path: Path):
    run, folder = ship(tmp_path / "plan"), tmp_path / "run"
    words = ["bench", "run", str(run.path), "--table", "motor:tcp://127.0.0.1:9"]
    words += ["--imu", "tcp://127.0.0.1:9?preset=fixed", "--out", str(folder)]
    done = subprocess.run(
        [*INERCAL, *words], input="mounted XY\n", capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert "--answers" in done.stderr
    assert not folder.exists()


@pytest.mark.slow
def test_a_confirmation_of_another_step_has_no_table_turn(
    tmp_path: Path, begun: Callable[[int], tuple[Run, InProcessBench]]
):
    run, bench = begun(1)
    rates: list[float] = []

    def confirm_another(driven: Operated) -> None:
        request = driven.mounting_request
        if request is not None and request.mounting == "XY":
            rates.append(float(bench.device.controller.table.state.rate[0]))
            driven.bench.device.mounting = "XY"  # the operator of `Operated` has nothing to do
            driven.confirm_mounting(request.number + 1, "XY", "Ben")
            driven.confirm_mounting(request.number, "YX", "Ben")
            if len(rates) > 100:
                raise Killed

    drive(tmp_path / "run", bench, run, confirm_another)
    assert max(np.abs(rates)) < 1e-3
    with Journal(tmp_path / "run" / "run.journal") as journal:
        assert journal.mounting() == ""
        assert any(one.level == "warning" and "Ben" in one.words for one in journal.events())


def command(run: Run, bench: BenchSimulator, folder: Path) -> list[str]:
    where = ["--table", bench.table, "--imu", bench.imu, "--clock", str(bench.clock)]
    return [*INERCAL, "bench", "run", str(run.path), *where, "--out", str(folder), "--json"]


@pytest.mark.evidence
def test_the_command_asks_hears_and_goes_on_after_a_kill(tmp_path: Path):
    run, folder = ship(tmp_path / "plan"), tmp_path / "run"
    answers = tmp_path / "answers.txt"
    answers.write_text("".join(f"mounted {name}\n" for name in MOUNTINGS))
    with BenchSimulator(run.path, 1) as bench:
        pipe = subprocess.PIPE
        with subprocess.Popen(
            command(run, bench, folder), stdin=pipe, stdout=pipe, stderr=pipe, text=True
        ) as host:
            assert host.stdin
            assert host.stderr
            host.stdin.write("yes\nmounted XY Eve\n")  # before anybody has asked
            host.stdin.flush()
            for line in host.stderr:
                if "then confirm the mounting" in line:
                    host.stdin.write("yes\nmounted YX Eve\nmounted XY Anna\n")
                    host.stdin.flush()
                if "XY_86" in line:
                    host.kill()
        # The watchdog goes by the wall's time, and the host that follows faster than that.
        assert seconds_to_rest(bench) < WATCHDOG + DECELERATION
        done = subprocess.run(
            [
                *INERCAL,
                "bench",
                "resume",
                str(folder),
                "--operator",
                "Ben",
                "--json",
                "--answers",
                str(answers),
            ],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            check=False,
        )
    assert done.returncode == 0, done.stderr
    with Journal(folder / "run.journal") as journal:
        words = [one.words for one in journal.events() if "confirms" in one.words]
        assert [one.split()[0] for one in words] == ["Anna", "Ben", "Ben"]
        assert journal.completed_steps() == len(run.steps)


@pytest.mark.slow
def test_a_run_whose_input_ends_stops_and_can_go_on(tmp_path: Path):
    run, folder = ship(tmp_path / "plan"), tmp_path / "run"
    with BenchSimulator(run.path, 1) as bench:
        done = subprocess.run(
            command(run, bench, folder), input="no\n", capture_output=True, text=True, check=False
        )
    assert done.returncode == 130, done.stderr
    with Journal(folder / "run.journal") as journal:
        assert journal.header().state == "interrupted"
        assert journal.mounting() == ""
