"""`init` of readings that no sensor gives: one line, with the place."""

from pathlib import Path

import numpy as np
import pytest
from tests.refusals import refused

from inercal.pipeline.drafts import draft_run_file

MEANS = "position,ax,ay,az\n" + "".join(
    f"{name},{x},{y},{z}\n"
    for name, x, y, z in (
        ("+x", 1, 0, 0), ("-x", -1, 0, 0), ("+y", 0, 1, 0), ("-y", 0, -1, 0), ("+z", 0, 0, 1),
        ("-z", 0, 0, -1),
    )
)  # fmt: skip


@pytest.mark.parametrize("cell", ["", "nan", "inf", "1e160", "-1e101"])
def test_a_mean_that_is_missing_or_absurd_is_named(tmp_path: Path, cell: str):
    path = tmp_path / "means.csv"
    path.write_text(MEANS.replace("+y,0,1,0", f"+y,0,{cell},0"))
    with refused(file=path, names=("ay",)) as caught:
        draft_run_file([path], tmp_path / "run.toml")
    assert caught.value.line == 4


@pytest.mark.parametrize("size", [0.0, 1e200])
def test_a_sensor_that_is_dead_or_overflows_is_refused(tmp_path: Path, size: float):
    path = tmp_path / "log.csv"
    data = size * np.random.default_rng(1).normal(size=(2000, 6))
    rows = np.column_stack([np.arange(2000) / 100, data])
    np.savetxt(path, rows, delimiter=",", header="t,ax,ay,az,gx,gy,gz", comments="")
    with refused(file=path):
        draft_run_file([path], tmp_path / "run.toml")


def test_means_of_a_dead_sensor_are_refused(tmp_path: Path):
    path = tmp_path / "means.csv"
    path.write_text(MEANS.replace("1", "0"))
    with refused(file=path, key="data.accelerometer"):
        draft_run_file([path], tmp_path / "run.toml")
