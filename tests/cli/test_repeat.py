"""`inercal repeat`: sessions from files, from a table and from a register."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.repeatability.laboratory import Laboratory, draw
from tests.repeatability.sessions import sessions_of
from typer.testing import CliRunner

from inercal.calibration.files import load, save
from inercal.cli.app import app
from inercal.laboratory.store import Register

DAYS = np.array([0, 0, 1, 1, 2, 2])


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with six calibrations of three days."""
    drawn = draw(Laboratory(), 6, np.random.default_rng(1), DAYS)
    for k, one in enumerate(sessions_of(drawn, DAYS)):
        save(one.calibration, tmp_path / f"{k}.calibration.json")
    return tmp_path


def run(*arguments: str | Path) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["repeat", *map(str, arguments)])
    return result.exit_code, result.output if result.exception is None else str(result.exception)


def table(folder: Path, *lines: str) -> Path:
    path = folder / "sessions.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def test_a_table_states_days_and_leaves_the_rest_to_each_session(folder: Path):
    rows = (f"{k}.calibration.json,day {day}" for k, day in enumerate(DAYS))
    status, output = run("--table", table(folder, "file,day", *rows), "--json")
    assert status == 0
    found = json.loads(output)
    assert [one["day"] for one in found["sessions"]] == [f"day {day}" for day in DAYS]
    assert {one["level"] for one in found["components"]} == {"day", "turn-on", "mount"}
    assert len({one["mount"] for one in found["sessions"]}) == 6


def test_days_are_those_of_the_measurement_however_they_are_written(folder: Path):
    files = [folder / f"{k}.calibration.json" for k in range(6)]
    for file, day in zip(files, DAYS, strict=True):
        save(replace(load(file), job={"measured": f"2026-03-0{day + 1}T08:0{day}:00Z"}), file)
    days = ["2026-03-01"] * 2 + ["2026-03-02"] * 2 + ["2026-03-03"] * 2
    sessions = json.loads(run(*files, "--json")[1])["sessions"]
    assert [one["day"] for one in sessions] == days
    assert run(*files[:2])[0] != 0
    words = ("Monday", "monday", '"monday "', "Tuesday", "tuesday", "TUESDAY")
    rows = (f"{k}.calibration.json,{word}" for k, word in enumerate(words))
    sessions = json.loads(run("--table", table(folder, "file,day", *rows), "--json")[1])["sessions"]
    assert len({one["day"] for one in sessions}) == 2


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        (("name,day", "0.calibration.json,1"), "no column 'file'"),
        (("file,week", "0.calibration.json,1"), "'week'"),
        (("file,day", "0.calibration.json,1,2"), "line 2 has 3 cells"),
        (("file,day", "0.calibration.json,"), "column day is empty"),
        (("file", "absent.json"), "absent.json"),
        (("file", "0.calibration.json"), "two or more"),
    ],
)
def test_wrong_tables_are_refused(folder: Path, lines: tuple[str, ...], words: str):
    status, output = run("--table", table(folder, *lines))
    assert status != 0
    assert words in output


def test_a_register_gives_the_days_of_measurement(folder: Path, monkeypatch: pytest.MonkeyPatch):
    path = str(folder / "r.db")
    with Register(path) as opened:
        for k, day in enumerate(DAYS):
            one = folder / f"{k}.calibration.json"
            opened.enter_calibrations([load(one)], f"2026-03-0{day + 1}")
    status, output = run("--register", path, "--sensor", "TRIAD-1", "--json")
    assert status == 0
    assert {one["day"] for one in json.loads(output)["sessions"]} == {
        "2026-03-01", "2026-03-02", "2026-03-03",
    }  # fmt: skip
    monkeypatch.setenv("INERCAL_REGISTER", path)
    assert run("--sensor", "TRIAD-1", "--json")[0] == 0


@pytest.mark.parametrize(
    "arguments",
    [(), ("0.calibration.json", "--sensor", "A"), ("0.calibration.json", "--register", "r.db")],
)
def test_sessions_come_in_one_way(arguments: tuple[str, ...]):
    assert run(*arguments)[0] != 0


def test_results_are_written_over_by_force_alone(folder: Path):
    files = [folder / f"{k}.calibration.json" for k in range(3)]
    assert run(*files, "--out", folder)[0] == 0
    kept = (folder / "TRIAD-1.repeatability.json").read_text()
    assert run(*files[:2], "--out", folder)[0] != 0
    assert (folder / "TRIAD-1.repeatability.json").read_text() == kept
    assert run(*files[:2], "--out", folder, "--force")[0] == 0
    assert load(folder / "TRIAD-1.next_use.calibration.json").method == "repeat"


def test_a_register_gives_the_result_of_the_files(folder: Path):
    path = str(folder / "r.db")
    files = [folder / f"{k}.calibration.json" for k in range(6)]
    with Register(path) as opened:
        for k, file in enumerate(files):
            opened.enter_calibration(file, measured=f"2026-03-0{k + 1}")
    from_files = json.loads(run(*files, "--json")[1])
    from_register = json.loads(run("--register", path, "--sensor", "TRIAD-1", "--json")[1])
    for one in (from_files, from_register):
        del one["sessions"], one["created"]
    assert from_register == from_files
