"""Runs that read several IMUs: what each of them finds, and what becomes of a lost one."""

from collections.abc import Mapping
from concurrent.futures import Future
from contextlib import suppress
from pathlib import Path
from threading import Event
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.host.in_process_bench import ADDRESSES
from tests.host.several_imus import FURTHER, SeveralImus, drive_all, recorded
from tests.host.simulated_runs import SHORT, plan
from tests.host.soak_runs import CHAMBER, PATH, QuickChamber, soak_run
from tests.host.watched_runs import Killed, Watched, in_rotation
from tests.refusals import refused

from inercal.basics.errors import InputError
from inercal.host import run_execution as finishing
from inercal.host.bench_run import BenchRun
from inercal.host.bench_simulator import BenchSimulator
from inercal.host.further_imus import _BackgroundOpener
from inercal.host.journal import Journal, JournalEvent
from inercal.host.link import LinkLost
from inercal.host.run_execution import FinishedRun, finish_run
from inercal.host.run_folder import RunFolder, create_run, reopen_run
from inercal.pipeline import calibrate
from inercal.pipeline.outcome import true_coefficients
from inercal.runfile import Run, read

SLOW_RATE = ('rate = "200 Hz"', 'rate = "50 Hz"')


def written(_: object, path: Path, *__: object) -> Path:
    path.write_text("made")
    return path


@pytest.fixture
def no_report(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw no figures, which takes longer than everything else."""
    monkeypatch.setattr(finishing, "write_report", written)


@pytest.fixture
def only_recorded(monkeypatch: pytest.MonkeyPatch, no_report: None) -> None:
    """Let nothing be calibrated from plans that are too short for it."""

    def calibrated(run: Run) -> SimpleNamespace:
        if not {b"warm-up", b"rest"} <= set(recorded(run.path.parent / run.data.file)["step"]):
            raise InputError("steps are missing")
        return SimpleNamespace(calibration=None)

    monkeypatch.setattr(finishing, "calibrate", calibrated)
    monkeypatch.setattr(finishing, "save", written)


def finished(folder: Path, plan: str = "plan.toml") -> FinishedRun:
    with Journal(folder / "run.journal") as journal:
        return finish_run(RunFolder.open_existing(folder, plan), journal)


def warnings(events: tuple[JournalEvent, ...]) -> list[str]:
    return [one.words for one in events if one.level == "warning"]


def of_table(columns: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return the columns that do not depend on the sensor."""
    names = set(columns) - {"ax", "ay", "az", "gx", "gy", "gz"}
    return {name: columns[name] for name in names}


def require_same_table(folder: Path, name: str, recording: str = "recording.h5") -> None:
    main, other = (of_table(recorded(folder / place / recording)) for place in ("", name))
    assert main.keys() == other.keys()
    for column, values in main.items():
        assert np.array_equal(values, other[column], equal_nan=values.dtype.kind == "f"), column


@pytest.mark.usefixtures("no_report")
@pytest.mark.evidence
@pytest.mark.parametrize("killed", [True, False])
def test_each_imu_of_a_run_finds_its_own_truth_even_after_a_kill(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, killed: bool
):
    run, folder = plan(tmp_path / "plan", PATH, [SLOW_RATE]), tmp_path / "run"
    bench = SeveralImus(run)
    bench.install(monkeypatch)

    def act(driven: Watched) -> None:
        if in_rotation(driven) and bench.device.controller.table.state.rate[0] > 0.2:
            raise Killed

    if killed:
        with suppress(Killed):
            drive_all(folder, act, run)
        bench.stop()
    ended = drive_all(folder, lambda _: None, None if killed else run)
    assert ended.done, ended.trouble
    assert "imu" not in "\n".join(warnings(ended.events))
    done = finished(folder)
    assert [*done.further] == [*FURTHER]
    for number, outcome in enumerate((done.outcome, *done.further.values()), start=1):
        calibration = outcome.calibration
        true = true_coefficients(calibration, {k: v / number for k, v in run.truth.items()})
        error = calibration.values - [true[name] for name in calibration.sensor.coefficients]
        assert np.all(np.abs(error) < 5 * calibration.std), number
    for name in done.further:
        require_same_table(folder, name)
        run_of_it = read(folder / name / "plan.toml")
        assert (run_of_it.sensor.name, dict(run_of_it.truth)) == (name, {})
    # Anybody can repeat the calibration from the folder of this sensor.
    again = calibrate(read(folder / "imu3" / "plan.toml")).calibration
    assert again.values.tolist() == done.further["imu3"].calibration.values.tolist()


@pytest.mark.slow
@pytest.mark.usefixtures("only_recorded")
def test_a_lost_further_imu_gives_one_warning_and_a_gap_only_in_its_own_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    run, folder = plan(tmp_path / "plan", SHORT, [SLOW_RATE]), tmp_path / "run"
    bench = SeveralImus(run)
    bench.install(monkeypatch)

    def act(driven: Watched) -> None:
        task = driven.sequencer.task
        bench.further[FURTHER["imu2"]].gone = task is not None and task.label in ("y up", "z+")

    ended = drive_all(folder, act, run)
    assert ended.done, ended.trouble
    (warning,) = warnings(ended.events)
    assert warning.startswith("imu2: ")
    finished(folder)
    require_same_table(folder, "imu3")
    for number, place in enumerate(("", "imu2", "imu3"), start=1):
        columns = recorded(folder / place / "recording.h5")
        bias = np.mean(columns["gz"][columns["step"] == b"warm-up"])  # °/s, with the Earth's rate
        assert abs(bias - 0.14 / number) < 0.01
    main, gap = recorded(folder / "recording.h5"), recorded(folder / "imu2" / "recording.h5")
    assert np.array_equal(main["bench/time"], gap["bench/time"])
    assert set(gap["step"]) - {b""} == {b"warm-up", b"rest"}
    # The samples before and after the gap are those that the main IMU has at these times.
    at = np.searchsorted(main["time"], gap["time"])
    for name in ("time", "outer", "middle", "inner", "step"):
        assert np.array_equal(main[name][at], gap[name]), name
    assert np.max(np.diff(gap["time"])) > 5.0
    assert np.max(np.diff(main["time"])) < 0.03


@pytest.mark.slow
@pytest.mark.usefixtures("only_recorded")
def test_a_killed_run_goes_on_without_a_further_imu_that_is_gone_for_good(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    run, folder = plan(tmp_path / "plan", SHORT, [SLOW_RATE]), tmp_path / "run"
    bench = SeveralImus(run)
    bench.install(monkeypatch)

    def kill(driven: Watched) -> None:
        bench.further[FURTHER["imu2"]].gone = driven.time > 3.0
        if driven.sequencer.number == 1 and driven.sequencer.phase == "work":
            raise Killed

    with suppress(Killed):
        drive_all(folder, kill, run)
    bench.stop()
    again = drive_all(folder, lambda _: None)
    assert again.done, again.trouble
    about_imus = [words for words in warnings(again.events) if "imu" in words]
    assert [words.split()[0] for words in about_imus] == ["imu2"]
    done = finished(folder)
    assert [*done.further] == ["imu3"]
    require_same_table(folder, "imu3")
    with Journal(folder / "run.journal") as journal:
        assert "imu2 is not calibrated" in "\n".join(warnings(journal.events()))
        assert {"imu3/recording.h5", "imu3/plan.calibration.json"} < journal.files().keys()


@pytest.mark.slow
@pytest.mark.usefixtures("only_recorded")
def test_in_a_chamber_each_recording_has_the_temperatures_of_the_chamber(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    run, folder = soak_run(tmp_path / "plan", SHORT), tmp_path / "run"
    bench = SeveralImus(run)
    bench.chamber = QuickChamber(lambda: bench.time, ramp=1.0, lag=2.0, case_lag=8.0)
    bench.restart_imu()
    bench.install(monkeypatch)
    ended = drive_all(folder, lambda _: None, run, CHAMBER)
    assert ended.done, ended.trouble
    finished(folder, "soaks.toml")
    columns = recorded(folder / "imu2" / "soaks.h5")
    assert np.ptp(columns["bench/chamber_temperature"]) > 50.0
    require_same_table(folder, "imu2", "soaks.h5")


@pytest.mark.slow
@pytest.mark.usefixtures("only_recorded")
def test_three_imus_of_a_simulated_bench_are_read_and_one_may_be_unplugged(tmp_path: Path):
    run, folder = plan(tmp_path / "plan", SHORT, [SLOW_RATE]), tmp_path / "run"
    with BenchSimulator(run.path, seed=1, imus=3) as bench:
        one = {"imu2": bench.further_imus["imu2"]}
        made, journal = create_run(tmp_path / "one", run, bench.addresses, further_imus=one)
        with journal, refused(key="--also-imu"):
            BenchRun(made, journal, bench.addresses)
        made, journal = create_run(
            folder, run, bench.addresses, 0.05, further_imus=bench.further_imus
        )
        with journal:
            with BenchRun(made, journal, bench.addresses) as driven:
                assert bench.further_imus.keys() == FURTHER.keys()
                bench.inject_fault("imu", "2 fault unplug")
                assert driven.execute_plan(), driven.trouble
            (warning,) = warnings(journal.events())
            assert warning.startswith("imu2: ")
            assert [*finish_run(made, journal).further] == ["imu3"]
    require_same_table(folder, "imu3")


@pytest.mark.parametrize(
    "further",
    [
        {"a/b": "tcp://127.0.0.1:2?preset=fixed"},
        {"..": "tcp://127.0.0.1:2?preset=fixed"},
        {"simulated MIMU": "tcp://127.0.0.1:2?preset=fixed"},
        {"b": ADDRESSES[1]},
        {"b": FURTHER["imu2"], "c": FURTHER["imu2"]},
    ],
)
def test_a_name_or_an_address_that_cannot_be_used_leaves_no_folder(
    tmp_path: Path, further: dict[str, str]
):
    run = plan(tmp_path / "plan", SHORT)
    with refused(key="--also-imu"):
        create_run(tmp_path / "run", run, ADDRESSES, further_imus=further)
    assert not (tmp_path / "run").exists()


def test_a_resumed_run_accepts_another_address_only_of_an_imu_that_it_has(tmp_path: Path):
    run, folder = plan(tmp_path / "plan", SHORT), tmp_path / "run"
    create_run(folder, run, ADDRESSES, further_imus=FURTHER)[1].close()
    for further in ({"other": FURTHER["imu2"]}, {"imu2": "tcp://127.0.0.1:2?preset=novatel"}):
        with refused(key="--also-imu"):
            reopen_run(folder, further_imus=further)
    moved = "tcp://127.0.0.1:77?preset=fixed"
    with reopen_run(folder, further_imus={"imu2": moved})[1] as journal:
        assert list(journal.further_imus().items()) == [("imu2", moved), ("imu3", FURTHER["imu3"])]


def test_a_lost_port_is_opened_in_a_thread_so_that_the_table_need_not_wait():
    answers, waits = Event(), Event()
    port: Any = object()

    def opener(timeout: float) -> Any:
        if waits.is_set():
            answers.wait()
        return port

    background = _BackgroundOpener(opener)
    assert background(1.0) is port
    waits.set()
    for _ in range(2):
        with pytest.raises(LinkLost):
            background(0.5)
    attempt = background._attempt
    assert isinstance(attempt, Future)
    answers.set()
    attempt.result()
    assert background(0.5) is port
    background.close()
