"""Tables of the terminal: every name and every unit, whatever characters and room there are."""

import shutil
from pathlib import Path

import pytest
from tests.program import run_program

EXAMPLES = Path(__file__).parents[2] / "examples"


def test_square_brackets_in_a_name_are_no_markup(tmp_path: Path):
    folder = shutil.copytree(EXAMPLES / "six_position", tmp_path / "run")
    path = folder / "run.toml"
    text = path.read_text(encoding="utf-8").replace("accelerometer SN 0417", "[/x] IMU [red]7")
    path.write_text(text, encoding="utf-8")
    done = run_program("calibrate", path, "--out", tmp_path, "--no-report")
    assert done.status == 0
    assert "[/x] IMU [red]7" in done.output
    assert "[/x] IMU [red]7" in run_program("show", tmp_path / "run.calibration.json").output


def test_a_table_keeps_names_and_units_in_a_narrow_terminal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("COLUMNS", "60")
    done = run_program(
        "calibrate", EXAMPLES / "six_position" / "run.toml", "--out", tmp_path, "--no-report"
    )
    assert "…" not in done.output
    file = tmp_path / "run.calibration.json"
    assert "…" not in run_program("compare", file, file).output
