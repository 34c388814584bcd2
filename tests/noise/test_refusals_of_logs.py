"""What `inercal noise` refuses before the work: all that a log lacks, and two run files."""

import json
from pathlib import Path

import numpy as np
import pytest
from tests.program import run_program
from tests.refusals import refused

from inercal.basics.errors import InputError
from inercal.methods import METHODS
from inercal.pipeline.drafts.log_files import read_logs
from inercal.pipeline.drafts.rest_recording import read_rest_recording


def unnamed_log(folder: Path) -> Path:
    path = folder / "log.csv"
    rows = np.random.default_rng(1).standard_normal((200, 6))
    table = np.column_stack([np.arange(200) * 0.01, rows])
    np.savetxt(path, table, "%.6g", ",", header="uhr,F1,F2,F3,R1,R2,R3", comments="")
    return path


def test_all_that_a_log_lacks_is_said_at_once_by_its_own_columns(tmp_path: Path):
    done = run_program("noise", unnamed_log(tmp_path))
    assert done.status == 2
    assert done.error.count("\n") == 1
    for text in ("data.accelerometer=F1,F2,F3", "data.gyro=R1,R2,R3", "sensor.gyro.unit="):
        assert text in done.error


@pytest.mark.parametrize(("unit", "step"), [("s", 0.01), ("ms", 10)])
def test_a_unit_of_time_that_nobody_stated_is_said(tmp_path: Path, unit: str, step: float):
    path = unnamed_log(tmp_path)
    stated = {
        "data.time": "uhr",
        "data.accelerometer": "F1,F2,F3",
        "sensor.accelerometer.unit": "g",
    }
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    table[:, 0] = np.arange(200) * step
    np.savetxt(path, table, "%.6g", ",", header="uhr,F1,F2,F3,R1,R2,R3", comments="")
    told = [one.what for one in read_rest_recording(path, stated).findings]
    assert ("time unit" in told) == (unit == "ms")
    stated["data.time_unit"] = unit
    assert not [
        one for one in read_rest_recording(path, stated).findings if one.what == "time unit"
    ]


def test_two_run_files_to_write_are_refused_and_none_is_written(tmp_path: Path):
    log, files = unnamed_log(tmp_path), (tmp_path / "a.toml", tmp_path / "b.toml")
    done = run_program("noise", log, "--write", files[0], "--write", files[1])
    assert done.status == 2
    assert "--write" in done.error
    assert not any(one.exists() for one in files)


def test_a_mistyped_method_has_its_nearest_name():
    with pytest.raises(InputError, match="did you mean ferraris"):
        METHODS.find("feraris")


@pytest.mark.parametrize("first", ["", "1"])
def test_labels_that_begin_later_are_skipped_and_a_damaged_cell_is_refused(
    tmp_path: Path, first: str
):
    rng, path = np.random.default_rng(2), tmp_path / "log.csv"
    readings = np.hstack([rng.normal([0, 0, 9.81], 0.01, (400, 3)), rng.normal(0, 1e-3, (400, 3))])
    rows = [[f"{x:.5f}" for x in row] + [first] for row in readings]
    for k in range(200, 300):
        rows[k][6] = "z_p"
    path.write_text("\n".join(map(",".join, [["ax", "ay", "az", "gx", "gy", "gz", "step"], *rows])))
    stated = {"data.rate": "100 Hz", "sensor.gyro.unit": "rad/s"}
    np.testing.assert_allclose(
        read_rest_recording(path, stated).data, np.round(readings, 5), atol=1e-12
    )
    shown = json.loads(run_program("show", path, "--json").output)
    assert shown["columns"][6]["median"] == ""
    rows[250][1] = "O.01"
    path.write_text("\n".join(map(",".join, [["ax", "ay", "az", "gx", "gy", "gz", "step"], *rows])))
    for read in (lambda: read_rest_recording(path, stated), lambda: read_logs([path], {})):
        with refused(line=252, names=("ay",)):
            read()
