"""`inercal bench run --register`: a run on a simulated bench is in the register, or goes on."""

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from tests.host.simulated_runs import plan, quick

from inercal.basics.errors import InputError
from inercal.calibration.calibration import SIMULATED
from inercal.cli.app import main
from inercal.host.bench_simulator import BenchSimulator
from inercal.host.journal import Journal
from inercal.laboratory.store import Register, RunFacts

Program = Callable[..., int]


@pytest.fixture
def program(monkeypatch: pytest.MonkeyPatch) -> Program:
    def run(*arguments: str | Path) -> int:
        monkeypatch.setattr(sys, "argv", ["inercal", *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            main()
        return int(stop.value.code or 0)

    return run


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[BenchSimulator]:
    run = plan(tmp_path_factory.mktemp("bench"), quick())
    with BenchSimulator(run.path, seed=1) as made:
        yield made


def at(bench: BenchSimulator) -> tuple[str, ...]:
    return ("--table", bench.table, "--imu", bench.imu, "--clock", bench.clock or "")


@pytest.mark.slow
def test_a_run_is_entered_as_it_begins_and_with_its_calibration_at_the_end(
    tmp_path: Path, program: Program, bench: BenchSimulator, monkeypatch: pytest.MonkeyPatch
):
    # As little as finds all coefficients.
    path = quick().replace(",10,,,", ",4,,,").replace("360", "90")
    run, address = plan(tmp_path / "plan", path), tmp_path / "register.db"
    states: list[str] = []
    enter_run = Register.enter_run

    def seen(self: Register, facts: RunFacts, calibration: Path | None = None) -> int:
        states.append(facts.state)
        return enter_run(self, facts, calibration)

    monkeypatch.setattr(Register, "enter_run", seen)
    out = ("--out", tmp_path / "run", "--register", address)
    assert program("bench", "run", run.path, *at(bench), *out) == 0
    # Beside the run, before its report, when all is done.
    assert states == ["running", "carried out", "done"]
    with Register(str(address)) as register:
        (entered,) = register.runs()
        (calibration,) = register.calibrations()
    assert (entered.state, entered.folder) == ("done", str(tmp_path / "run"))
    assert {one.name for one in entered.files} >= {"run.log", "recording.h5", "plan.report.html"}
    with Journal(tmp_path / "run" / "run.journal") as journal:
        assert {one.name: (one.size, one.sha256) for one in entered.files} == journal.files()
        assert calibration.measured == entered.begun == journal.header().begun
    assert calibration.run == entered.id
    assert bench.clock
    assert bench.clock in calibration.calibration.provenance[SIMULATED]
    report = (tmp_path / "run" / "plan.report.html").read_text(encoding="utf-8")
    assert 'id="over-time"' in report


@pytest.mark.slow
def test_a_register_that_goes_away_does_not_stop_a_run(
    tmp_path: Path,
    program: Program,
    bench: BenchSimulator,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    def gone(*_: object) -> int:
        raise InputError("register postgresql://h/lab: the server is gone")

    monkeypatch.setattr(Register, "enter_run", gone)
    run, folder = plan(tmp_path / "plan"), tmp_path / "run"
    out = ("--out", folder, "--register", tmp_path / "register.db")
    program("bench", "run", run.path, *at(bench), *out)
    with Journal(folder / "run.journal") as journal:
        assert journal.header().state == "carried out"
    errors = capsys.readouterr().err
    told = [line for line in errors.splitlines() if "not in the register" in line]
    assert told == [
        "inercal: the run is not in the register: register postgresql://h/lab: the server is gone; "
        f"enter it later by `inercal store import {folder}`"
    ]
    monkeypatch.undo()
    monkeypatch.setenv("INERCAL_REGISTER", str(tmp_path / "register.db"))
    assert program("store", "import", folder) == 0


@pytest.mark.slow
def test_of_devices_that_are_not_there_nothing_is_entered(tmp_path: Path, program: Program):
    run, address = plan(tmp_path / "plan"), tmp_path / "register.db"
    nowhere = (
        "--table", "pmac://127.0.0.1:1?motors=1,2,3&counts=3600000",
        "--imu", "tcp://127.0.0.1:1?preset=fixed",
    )  # fmt: skip
    out = ("--out", tmp_path / "run", "--register", address)
    assert program("bench", "run", run.path, *nowhere, *out) == 2
    with Register(str(address)) as register:
        assert register.runs() == register.sensors() == ()
