"""The register's verbs: what they print, and what they refuse in one line."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from tests.host.simulated_runs import plan
from tests.runfile.run_file_texts import SIX_POSITIONS, run_file
from tests.store.calibration_generator import ARCSEC, DRIFTING, G0, content, hashed, ten, write

from inercal.cli.app import main
from inercal.host.run_folder import create_run
from inercal.laboratory.store import Register
from inercal.physics.sensors import Noise, Readout, triad

NAME = DRIFTING.sensor


class Said(NamedTuple):
    status: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        return json.loads(self.out)


Program = Callable[..., Said]


@pytest.fixture
def program(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> Program:
    """Run the program within this process, with a register of its own, 140 columns wide."""
    monkeypatch.setenv("INERCAL_REGISTER", str(tmp_path / "register.db"))
    monkeypatch.setenv("COLUMNS", "140")

    def run(*arguments: str | Path) -> Said:
        monkeypatch.setattr("sys.argv", ["inercal", *map(str, arguments)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as stop:
            main()
        printed = capsys.readouterr()
        code = stop.value.code
        return Said(0 if code is None else int(code), printed.out, printed.err)

    return run


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a register of ten calibrations and of a sensor that has none, to be copied."""
    folder = tmp_path_factory.mktemp("filled")
    path = folder / "register.db"
    with Register(str(path)) as register:
        register.enter_calibrations(ten(folder))
        register.enter_sensor(triad("bare", "f", "a", Readout(1.0, 0.0, "g"), Noise()))
    return path


def refused(said: Said) -> str:
    assert said.status == 2
    assert said.err.startswith("inercal: ")
    assert said.err.count("\n") == 1
    assert "Traceback" not in said.err
    return said.err


def test_ten_calibrations_are_imported_listed_and_shown(program: Program, tmp_path: Path):
    said = program("store", "import", *ten(tmp_path), "--by", "Ada")
    assert (said.status, said.err) == (0, "")
    assert said.out.splitlines()[9] == f"{tmp_path / '9.calibration.json'}: calibration #10"
    assert "register.db" in said.out.splitlines()[-1]
    again = program("store", "import", tmp_path / "9.calibration.json", "--by", "Bob", "--json")
    assert again.json == {
        "register": f"sqlite:///{tmp_path / 'register.db'}",
        "entered": [
            {
                "path": str(tmp_path / "9.calibration.json"),
                "run": None,
                "calibrations": [10],
                "new": [],
            }
        ],
    }
    listed = program("store", "list")
    (row,) = [line for line in listed.out.splitlines() if NAME in line]
    cells = [cell.strip() for cell in row.strip("│").split("│")]
    assert cells[:5] == [NAME, "ax ay az gx gy gz", "10", "2024-08-31", "Ada"]
    (sensor,) = program("store", "list", "--json").json["sensors"]
    assert (sensor["id"], sensor["calibrations"], sensor["by"]) == (1, 10, "Ada")
    shown = program("store", "show", NAME)
    assert shown.out.count("turntable_kalman") == 10
    one = program("store", "show", NAME, "--json").json
    assert [c["id"] for c in one["calibrations"]] == list(range(1, 11))
    assert one["runs"] == []
    assert "content" not in one["calibrations"][0]


@pytest.mark.parametrize("number", ["3", "#3"])
def test_a_calibration_is_shown_with_units_hashes_and_who(
    program: Program, tmp_path: Path, number: str
):
    path = ten(tmp_path)[2]
    written = json.loads(path.read_text(encoding="utf-8"))
    program("store", "import", *ten(tmp_path), "--by", "Ada")
    out = program("store", "show", number).out
    assert "calibration #3 of MIMU № 17" in out
    assert f"calibration sha256: {written['sha256']}" in out
    assert f"recording sha256: {written['provenance']['recording sha256']}" in out
    assert "entered: by Ada, 20" in out
    (row,) = [line for line in out.splitlines() if "ax.k0" in line]
    cells = [cell.strip() for cell in row.strip("│").split("│")]
    value = written["coefficients"][0]["value"] / (1e-6 * G0)
    assert cells == ["ax.k0", "bias", f"{value:.0f}", "40", "µg"]
    shown = program("store", "show", number, "--json").json
    assert shown["content"] == written
    assert shown["coefficients"][0]["value"] == written["coefficients"][0]["value"]
    # The file comes out of the register as it went in.
    back = write(tmp_path / "back.calibration.json", shown["content"])
    assert program("store", "import", back, "--json").json["entered"][0]["new"] == []


def test_a_sensor_whose_name_is_a_number_is_shown_by_it(program: Program, tmp_path: Path):
    made = content(DRIFTING, 0.0, np.random.default_rng(1))
    made["sensor"]["name"] = "1"
    program("store", "import", write(tmp_path / "a.calibration.json", hashed(made)))
    assert program("store", "show", "1").out.startswith("1: ax, ay")
    assert program("store", "show", "#1").out.startswith("calibration #1 of 1")


@pytest.mark.slow
def test_the_history_says_what_drifts_and_by_how_much(program: Program, tmp_path: Path):
    program("store", "import", *ten(tmp_path))
    out = program("store", "history", NAME).out
    rows = {
        cells[0]: cells
        for line in out.splitlines()
        if line.startswith("│")
        for cells in [[cell.strip() for cell in line.strip("│").split("│")]]
    }
    assert set(rows) == set(DRIFTING.names)
    assert rows["ax.k0"][-1] == "drifts"
    drift, expanded = float(rows["ax.k0"][7]), float(rows["ax.k0"][8])
    assert abs(drift - 60) < expanded == 12.0
    assert rows["gz.scale"][-1] == "drifts"
    assert "About 9.8" in out
    assert "treated as independent" in out
    whole = program("store", "history", NAME, "ax.k0").out
    assert whole.count("│ #") == 10
    assert "ax.k0: drifts; drift" in whole
    assert " *" in whole
    found = program("store", "history", NAME, "ax.k0", "gz.scale", "--json").json
    first, second = found["coefficients"]
    assert (first["unit"], second["unit"]) == ("m/s²", "1")
    for one, true in ((first, 60e-6 * G0), (second, -25e-6)):
        assert abs(one["line"]["slope"] - true) < 2 * one["line"]["slope_std"]
        assert len(one["points"]) == 10
        assert one["points"][0]["en"] is None
        assert one["verdict"] == "drifts"
    assert first["line"]["time"].startswith("2022-0")


@pytest.mark.slow
def test_the_history_is_written_as_a_page(program: Program, tmp_path: Path):
    # Two figures are as good as six.
    program("store", "import", *ten(tmp_path, replace(DRIFTING, axes=("ax", "gx"))))
    out = tmp_path / "history.html"
    said = program("store", "history", NAME, "--out", out)
    assert said.out.endswith(f"wrote {out}\n")
    assert "<title>History of MIMU № 17</title>" in out.read_text(encoding="utf-8")
    assert program("store", "history", NAME, "-o", out, "--json").json["page"] == str(out)
    refused(program("store", "history", NAME, "--out", out / "x.html"))


@pytest.mark.slow
def test_verb_and_page_state_the_next_calibration(program: Program, tmp_path: Path):
    program("store", "import", *ten(tmp_path, replace(DRIFTING, axes=("ax", "gx"))))
    page = tmp_path / "history.html"
    limits = ("--limit", "bias=0.4 mg", "--limit", "scale=1 %")
    found = program("store", "history", NAME, "ax.k0", "ax.k1", *limits, "--json").json
    stated = found["next_calibration"]
    assert {one["name"] for one in stated["coefficients"]} == {"ax.k0", "ax.k1"}
    assert found["coefficients"][0]["next_use"]["next_use_U"] > 0
    text = program("store", "history", NAME, "ax.k0", "ax.k1", *limits, "-o", page).out
    assert f"next calibration by {stated['date']}" in text
    assert stated["date"] in page.read_text(encoding="utf-8")


@pytest.mark.slow
def test_two_calibrations_are_compared_by_number_and_by_file(program: Program, tmp_path: Path):
    paths = ten(tmp_path)
    program("store", "import", *paths)
    for first, second in (("1", "10"), ("#1", paths[9]), (paths[0], "10"), (paths[0], paths[9])):
        found = program("store", "diff", first, second, "--json").json
        (row,) = [c for c in found["coefficients"] if c["name"] == "ax.k0"]
        assert row["difference"] == pytest.approx(270e-6 * G0, abs=6 * 20e-6 * G0)
        u = np.hypot(row["first"]["std"], row["second"]["std"])
        assert row["en"] == pytest.approx(row["difference"] / (2 * u))
        assert row["en"] > 1
        assert found["joint"]["rank"] == 24
        assert found["by_chance"] == pytest.approx(24 * 0.0455, rel=1e-3)
    out = program("store", "diff", "1", "10").out
    assert "About 1.1" in out
    assert "all together: χ² = " in out


def test_a_history_counts_its_calibrations_and_says_what_is_tested_together(
    program: Program, tmp_path: Path
):
    first, second = ten(tmp_path)[:2]
    program("store", "import", first)
    assert f"{NAME}: 1 calibration, 20" in program("store", "history", NAME).out
    program("store", "import", second)
    out = program("store", "history", NAME, "ax.k0").out
    assert f"{NAME}: 2 calibrations, 20" in out
    assert "all 24 coefficients together: χ² = " in " ".join(out.split())


def test_files_are_compared_without_a_register(
    program: Program, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    paths = ten(tmp_path)
    monkeypatch.setenv("INERCAL_REGISTER", str(tmp_path / "none" / "r.db"))
    assert program("store", "diff", paths[0], paths[1]).status == 0


def test_what_is_compared_of_two_sensors_is_said_to_be(program: Program, tmp_path: Path):
    first, second = ten(tmp_path)[:2]
    other = json.loads(second.read_text(encoding="utf-8"))
    other["sensor"]["name"] = "another [bold]"
    write(second, hashed(other))
    out = program("store", "diff", first, second).out
    assert "MIMU № 17 and another [bold]" in out


def test_a_damaged_file_is_named_and_what_came_before_stays(program: Program, tmp_path: Path):
    paths = ten(tmp_path)
    paths[2].write_text("{}")
    said = program("store", "import", *paths[:5])
    assert said.status == 2
    assert said.out.count("calibration #") == 2
    assert said.err == (
        "inercal: 2 of 5 paths entered, 2 not read\n"
        f"inercal: {paths[2]}: not a calibration file that this version reads: it states no "
        "schema; it reads 'inercal/calibration/2'\n"
    )
    assert len(program("store", "show", NAME, "--json").json["calibrations"]) == 2
    again = program("store", "import", paths[0], paths[2], "--json")
    assert again.status == 2
    assert [one["calibrations"] for one in again.json["entered"]] == [[1]]


def test_a_date_that_is_stated_counts(program: Program, tmp_path: Path):
    path = ten(tmp_path)[0]
    program("store", "import", path, "--measured", "2019-12-24")
    shown = program("store", "show", "1", "--json").json
    assert shown["measured"] == "2019-12-24T00:00:00.000+00:00"
    assert "(as stated)" in program("store", "show", "1").out


def test_the_folder_of_a_run_is_imported_and_listed(program: Program, tmp_path: Path):
    addresses = ("pmac://h:1?motors=1,2,3&counts=3600000", "tcp://h:2?preset=fixed", "")
    folder, journal = create_run(tmp_path / "run", plan(tmp_path / "plan"), addresses)
    journal.set_state("interrupted")
    journal.close()
    said = program("store", "import", folder.path)
    assert (said.status, said.out) == (
        0,
        f"{folder.path}: run 1\ncreated the register sqlite:///{tmp_path / 'register.db'}\n",
    )
    (run,) = program("store", "list", "--runs", "--json").json["runs"]
    assert (run["state"], run["kind"], run["folder"]) == (
        "interrupted",
        "turntable",
        str(folder.path),
    )
    assert [one["name"] for one in run["files"]] == ["plan.toml"]
    assert "interrupted" in program("store", "list", "--runs").out
    assert "interrupted" in program("store", "show", "simulated MIMU").out


def test_of_a_folder_without_a_run_its_calibrations_are_imported(program: Program, tmp_path: Path):
    folder = tmp_path / "results"
    folder.mkdir()
    err = refused(program("store", "import", folder))
    assert "*.calibration.json" in err
    ten(folder)
    said = program("store", "import", folder)
    assert said.out.count("calibration #") == 10
    (folder / "5.calibration.json").write_text("")
    (folder / "extra.calibration.json").write_text(
        json.dumps(content(DRIFTING, 9.0, np.random.default_rng(1)), ensure_ascii=False)
    )
    refused(program("store", "import", folder))
    assert len(program("store", "show", NAME, "--json").json["calibrations"]) == 10


@pytest.mark.parametrize(
    ("arguments", "where"),
    [
        (["show", "x"], "sensor 'x'"),
        (["show", "99"], "#99"),
        (["show", "#x"], "sensor '#x'"),
        (["history", "x"], "sensor 'x'"),
        (["history", NAME, "k9"], "'k9'"),
        (["history", NAME, "k2"], "k2"),
        (["history", "bare"], "sensor 'bare'"),
        (["diff", "1", "99"], "#99"),
        (["diff", "1", "none.json"], "none.json"),
        (["diff", "1", "."], "is a folder"),
        (["import", "none.json"], "none.json"),
        (["import", "none.json", "--measured", "soon"], "'soon'"),
        (["import", "a", "b", "--measured", "2020-01-01"], "--measured"),
        (["import", "."], "*.calibration.json"),
        (["import", "none.json", "--by", " "], "--by"),
        (["list", "--register", "mysql://h/x"], "mysql://"),
        (["list", "--register", "/none/r.db"], "/none/r.db"),
        (["show", "\udcff"], "Unicode"),
    ],
)
def test_wrong_input_is_one_line(
    program: Program, tmp_path: Path, filled: Path, arguments: list[str], where: str
):
    shutil.copy(filled, tmp_path / "register.db")
    assert where in refused(program("store", *arguments))


def test_an_empty_register_says_how_it_is_filled(program: Program, tmp_path: Path):
    with Register(str(tmp_path / "register.db")) as register:
        assert register.sensors() == ()
    out = program("store", "list").out
    assert out.startswith(f"sqlite:///{tmp_path / 'register.db'} is empty")
    assert program("store", "list", "--json").json["sensors"] == []
    assert program("store", "list", "--runs", "--json").json["runs"] == []


@pytest.mark.slow
def test_a_calibration_is_entered_and_its_history_stands_in_the_report(
    program: Program, tmp_path: Path
):
    path = run_file(tmp_path, SIX_POSITIONS, ("[bench]", '[bench]\nname = "granite plate"'))
    for seed, page in (("1", ["--no-report"]), ("2", ["--no-report"]), ("3", [])):
        assert program("simulate", path, "--seed", seed, "--force").status == 0
        done = program("calibrate", path, "--out", tmp_path, "--register", "default", *page)
        assert done.status == 0, done.err
    shown = program("store", "show", "triad 3", "--json").json
    assert len(shown["calibrations"]) == 3
    assert {(c["kind"], c["bench"]) for c in shown["calibrations"]} == {("hand", "granite plate")}
    page = (tmp_path / "run.report.html").read_text(encoding="utf-8")
    assert 'id="over-time"' in page
    assert 'href="#over-time"' in page
    assert page.count('id="axis') > 3
    program("calibrate", path, "--out", tmp_path)
    page = (tmp_path / "run.report.html").read_text(encoding="utf-8")
    assert "over-time" not in page
    assert len(program("store", "show", "triad 3", "--json").json["calibrations"]) == 3


def test_a_register_that_is_not_there_is_said_before_anything_is_done(
    program: Program, tmp_path: Path
):
    path = run_file(tmp_path, SIX_POSITIONS)
    program("simulate", path)
    err = refused(program("calibrate", path, "--out", tmp_path, "--register", "/none/r.db"))
    assert "/none/r.db" in err
    assert not list(tmp_path.glob("*.calibration.json"))
    bench = ("bench", "run", path, "--table", "pmac://h:1", "--imu", "tcp://h:2")
    err = refused(program(*bench, "--out", tmp_path / "run", "--register", "/none/r.db"))
    assert "/none/r.db" in err
    assert not (tmp_path / "run").exists()


def test_units_of_the_file_are_si_and_of_the_tables_the_sensors(program: Program, tmp_path: Path):
    program("store", "import", *ten(tmp_path))
    (row,) = program("store", "history", NAME, "gx.bias", "--json").json["coefficients"]
    assert row["unit"] == "rad/s"
    assert row["points"][0]["value"] == pytest.approx(5 * ARCSEC, abs=0.5 * ARCSEC)
    assert "value, °/h" in program("store", "history", NAME, "gx.bias").out
