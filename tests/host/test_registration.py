"""A run's folder is entered into the register: while it goes on, when it is done, and later."""

import hashlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.host.simulated_runs import plan
from tests.refusals import refused
from tests.store.calibration_generator import DRIFTING, content, write

from inercal.basics.errors import InputError
from inercal.host import registration
from inercal.host.journal import Journal
from inercal.host.registration import RegisterSync, register_run
from inercal.host.run_folder import JOURNAL, RunFolder, create_run
from inercal.host.web.folders import Runs
from inercal.laboratory.store import Register

ADDRESSES = (
    "pmac://10.0.0.5:1025?motors=1,2,3&counts=3600000",
    "tcp://10.0.0.6:1?preset=fixed",
    "",
)
NAMED = ('kind = "turntable"', 'kind = "turntable"\nname = "table 2"')


@pytest.fixture
def register(tmp_path: Path) -> Iterator[Register]:
    with Register(str(tmp_path / "register.db"), by="Ada") as register:
        yield register


@pytest.fixture
def begun(tmp_path: Path) -> Iterator[tuple[RunFolder, Journal]]:
    """Give a run that goes on; nothing moves, its files are a few bytes."""
    folder, journal = create_run(
        tmp_path / "run", plan(tmp_path / "plan", replaced=[NAMED]), ADDRESSES
    )
    folder.log.write_bytes(b"what came")
    with journal:
        yield folder, journal


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def finished(folder: RunFolder, journal: Journal) -> None:
    """Leave what `finish` leaves."""
    recording = folder.path / "recording.h5"
    recording.write_bytes(b"samples")
    truth = replace(DRIFTING, sensor=folder.run.sensor.name)
    made = content(
        truth, 0.0, np.random.default_rng(1), provenance={"recording sha256": digest(recording)}
    )
    write(folder.output_path("calibration.json"), made)
    folder.output_path("report.html").write_text("<html>")
    for path in (folder.run.path, folder.log, recording, folder.output_path("calibration.json")):
        journal.record_file(path.name, path.stat().st_size, digest(path))
    journal.set_state("done")


def test_a_run_is_entered_as_it_begins_and_as_it_ends(
    register: Register, begun: tuple[RunFolder, Journal]
):
    folder, journal = begun
    number = register_run(register, folder.path)
    (run,) = register.runs()
    assert (run.state, run.files, run.kind, run.bench) == ("running", (), "turntable", "table 2")
    assert (run.table, run.imu) == ADDRESSES[:2]
    assert run.folder == str(folder.path)
    assert run.begun == journal.header().begun
    assert run.by == "Ada"
    journal.set_state("interrupted")
    assert register_run(register, folder.path) == number
    (run,) = register.runs()
    assert run.state == "interrupted"
    assert {one.name: one.sha256 for one in run.files} == {
        name: digest(folder.path / name) for name in ("run.log", "plan.toml")
    }
    finished(folder, journal)
    assert register_run(register, folder.path) == number
    (run,) = register.runs()
    assert run.state == "done"
    assert {one.name for one in run.files} == {
        "plan.toml", "run.log", "recording.h5", "plan.calibration.json",
    }  # fmt: skip
    (calibration,) = register.calibrations()
    assert (calibration.run, calibration.measured) == (number, run.begun)
    assert (calibration.kind, calibration.bench) == ("turntable", "table 2")


def test_a_folder_that_was_moved_is_the_same_run(
    register: Register, begun: tuple[RunFolder, Journal], tmp_path: Path
):
    folder, journal = begun
    finished(folder, journal)
    journal.close()
    number = register_run(register, folder.path)
    (before,), calibrations = register.runs(), register.calibrations()
    moved = folder.path.rename(tmp_path / "moved")
    assert register_run(register, moved) == number
    assert register.runs() == (replace(before, folder=str(moved)),)
    assert register.calibrations() == calibrations


@pytest.mark.parametrize("name", ["recording.h5", "run.log", "plan.toml"])
def test_raw_data_that_changed_since_is_refused_by_name(
    register: Register, begun: tuple[RunFolder, Journal], name: str
):
    folder, journal = begun
    finished(folder, journal)
    with (folder.path / name).open("ab") as file:
        file.write(b"\n# more")
    with refused(file=name):
        register_run(register, folder.path)
    assert register.runs() == register.sensors() == ()


def test_a_run_that_is_there_as_done_is_not_read_again(
    register: Register, begun: tuple[RunFolder, Journal], monkeypatch: pytest.MonkeyPatch
):
    folder, journal = begun
    runs = Runs(folder.path.parent)
    read: list[Path] = []
    monkeypatch.setattr(registration, "file_sha256", lambda path: read.append(path) or digest(path))
    journal.set_state("interrupted")
    address = str(folder.path.parent / "register.db")
    for _ in range(2):  # it may go on
        assert runs.enter(address) == []
    assert len(read) == 4
    finished(folder, journal)
    for _ in range(3):
        assert runs.enter(address) == []
    assert [one.state for one in register.runs()] == ["done"]
    assert len(read) == 7
    assert (
        register.calibration_numbers()
        == register.calibration_numbers(register.runs()[0].id)
        == (1,)
    )
    assert register.calibration_numbers(7) == ()


def test_a_damaged_calibration_leaves_the_run_out(
    register: Register, begun: tuple[RunFolder, Journal]
):
    folder, journal = begun
    finished(folder, journal)
    path = folder.output_path("calibration.json")
    path.write_text(path.read_text(encoding="utf-8").replace("generator", "forger"))
    with refused(file="plan.calibration.json", key="sha256"):
        register_run(register, folder.path)
    assert register.runs() == ()


def test_files_that_are_gone_since_and_a_report_made_anew_do_not_matter(
    register: Register, begun: tuple[RunFolder, Journal]
):
    folder, journal = begun
    finished(folder, journal)
    (folder.path / "recording.h5").unlink()
    folder.output_path("report.html").write_text("<html>anew")
    register_run(register, folder.path)
    assert "recording.h5" in {one.name for one in register.runs()[0].files}


def test_what_is_no_folder_of_a_run_is_one_line(register: Register, tmp_path: Path):
    with refused(file=JOURNAL):
        register_run(register, tmp_path)
    (tmp_path / JOURNAL).write_text("no database at all, but longer than a hundred " * 9)
    with refused(file=JOURNAL):
        register_run(register, tmp_path)


def test_a_keeper_enters_beside_what_is_done_and_gives_the_history(
    register: Register, begun: tuple[RunFolder, Journal]
):
    folder, journal = begun
    register_sync = RegisterSync(register, folder.path)
    with register_sync.background_work():
        pass
    assert [run.state for run in register.runs()] == ["running"]
    finished(folder, journal)
    history = register_sync.history(folder.run.sensor.name)
    assert history is not None
    assert len(history.entries) == 1
    assert register_sync.trouble == ""


def test_what_fails_is_kept_in_words_and_stops_nothing(
    register: Register, begun: tuple[RunFolder, Journal], monkeypatch: pytest.MonkeyPatch
):
    folder, _ = begun

    def fails(*_: object) -> int:
        raise InputError("register postgresql://h/lab: the server\nis gone")

    register_sync = RegisterSync(register, folder.path)
    monkeypatch.setattr(register, "enter_run", fails)
    with register_sync.background_work():
        pass
    assert register_sync.trouble == (
        "the run is not in the register: register postgresql://h/lab: the server is gone; enter it "
        f"later by `inercal store import {folder.path}`"
    )
    assert register_sync.history("x") is None
    monkeypatch.undo()
    register_sync.update()
    assert register_sync.trouble == ""


def test_no_register_is_told_nothing(begun: tuple[RunFolder, Journal]):
    register_sync = RegisterSync(None, begun[0].path)
    with register_sync.background_work():
        register_sync.update()
    assert (register_sync.trouble, register_sync.history("x")) == ("", None)
