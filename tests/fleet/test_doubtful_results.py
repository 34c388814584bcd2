"""Sensors that cannot be relied on, and recordings that are used twice, are named."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from tests.fleet.lines import make_line, readings, write_table
from tests.program import run_program

pytest.importorskip("pyarrow")


@pytest.fixture(scope="module")
def line(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a line: the z axis of S001 reads 0.6 of nominal, S003 has the recording of S002."""
    folder = make_line(tmp_path_factory.mktemp("line"), 4)
    columns, _ = readings(1)
    np.savez(
        folder / "recordings/S001.npz", allow_pickle=False, **columns | {"z": 0.6 * columns["z"]}
    )
    shutil.copyfile(folder / "recordings/S002.npz", folder / "recordings/S003.npz")
    return folder


def test_the_outputs_name_a_wrong_scale_factor_and_a_repeated_recording(line: Path, tmp_path: Path):
    made = run_program("fleet", "calibrate", line)
    assert made.status == 3
    page = tmp_path / "page.html"
    report = run_program("fleet", "report", line, "--out", page)
    for text in (made.output, run_program("fleet", "status", line).output, report.output,
                 page.read_text(encoding="utf-8")):  # fmt: skip
        assert all(name in text for name in ("S001 is", "S002 and S003"))
    for verb in ("calibrate", "status", "report"):
        found = json.loads(run_program("fleet", verb, line, "--json").output)
        assert found["unreliable"]["S001"].startswith("the scale factor of the z accelerometer")
        assert (list(found["unreliable"]), found["same_recording"]) == (
            ["S001"],
            [["S002", "S003"]],
        )


def test_the_export_of_one_unreliable_sensor_warns(line: Path, tmp_path: Path):
    run_program("fleet", "calibrate", line)
    for name in ("S000", "S001"):
        ended = run_program("fleet", "export", line, tmp_path / f"{name}.json", "--sensor", name)
        assert (ended.status, "S001" in ended.error) == (0, name == "S001")


def test_one_recording_may_contain_the_columns_of_several_sensors(tmp_path: Path):
    folder = make_line(tmp_path, 1)
    columns, _ = readings(0)
    path = folder / "recordings/S000.npz"
    np.savez(path, allow_pickle=False, **columns, u=columns["x"] + 0.01)
    text = (folder / "run.toml").read_text(encoding="utf-8").replace('"x", "y"', '"{first}", "y"')
    (folder / "run.toml").write_text(text, encoding="utf-8")
    rows = [(name, "recordings/S000.npz", first) for name, first in (("A", "x"), ("B", "u"))]
    write_table(folder, rows, ("first",))
    made = json.loads(run_program("fleet", "calibrate", folder, "--json").output)
    assert (made["done"], made["same_recording"]) == (2, [])
