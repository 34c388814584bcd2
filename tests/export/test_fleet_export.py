"""One file per sensor of a production line."""

from pathlib import Path

import numpy as np
import pytest
from tests.fleet.lines import make_line, readings, write_table
from tests.program import run_program

from inercal.fleet import results

pytest.importorskip("pyarrow")


@pytest.fixture(scope="module")
def line(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = make_line(tmp_path_factory.mktemp("line"), 5)
    table = [(f"S{k:03d}", f"recordings/S{k:03d}.npz", str(1000 + k)) for k in range(5)]
    write_table(folder, table, ["device_id"])
    (folder / "recordings" / "S002.npz").write_bytes(b"")
    # Gravity of S004 is 1.1 g in one of the positions.
    columns, _ = readings(4)
    columns["y"] = np.where(columns["face"] == "y_p", 1.1 * columns["y"], columns["y"])
    columns["x"] = np.where(columns["face"] == "y_p", columns["x"] + 0.1, columns["x"])
    np.savez(folder / "recordings" / "S004.npz", allow_pickle=False, **columns)
    run_program("fleet", "calibrate", folder)
    assert (folder / results.FOLDER).is_dir()
    return folder


@pytest.mark.slow
def test_each_sensor_has_a_file_with_the_device_id_of_its_row(line: Path, tmp_path: Path):
    out = tmp_path / "boards"
    arguments = ("fleet", "export", line, out, "--to", "px4", "--column", "acc_id=device_id")
    ended = run_program(*arguments)
    assert ended.status == 0, ended.error
    assert "S002" in ended.output
    names = [f"S00{k}.px4.params" for k in (0, 1, 3, 4)]
    assert [f"S00{k}" in ended.error for k in range(5)] == [False] * 4 + [True]
    assert "NOT TO BE RELIED ON" in (out / names[3]).read_text(encoding="utf-8")
    assert sorted(path.name for path in out.iterdir()) == names
    for k in (0, 1, 3):
        text = (out / f"S00{k}.px4.params").read_text(encoding="utf-8")
        known = {x.split("\t")[2]: x.split("\t")[3] for x in text.splitlines() if x[0] != "#"}
        assert known["CAL_ACC0_ID"] == str(1000 + k)
        bias = [float(known[f"CAL_ACC0_{a}OFF"]) for a in "XYZ"]
        np.testing.assert_allclose(bias, 9.80665 * readings(k)[1], atol=2e-3)
    assert run_program(*arguments).status == 2
    assert run_program(*arguments, "--force").status == 0


def test_nothing_is_written_where_a_sensor_is_refused(line: Path, tmp_path: Path):
    out = tmp_path / "boards"
    for more in (
        ["--to", "px4"],
        ["--to", "px4", "--column", "acc_id=serial"],
        ["--to", "nothing"],
        ["--to", "ros2-node"],
        ["--to", "csv", "--sensor", "S000"],
        ["--set", "acc_id=1"],
        ["--axes", "x -y -z"],
    ):
        assert run_program("fleet", "export", line, out, *more).status == 2
    assert not out.exists()
