import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.refusals import refused

from inercal.basics.atomic_files import atomic_write
from inercal.recordings import Recording
from inercal.recordings.io.read import read_recording
from inercal.recordings.io.write import write_recording


def recording(**changes: object) -> Recording:
    rng = np.random.default_rng(11)
    fields: dict[str, object] = {
        "time": np.cumsum(rng.uniform(0.01, 0.011, 25_000)),
        "data": rng.normal(size=(25_000, 2)) * [1e-300, 1e8],
        "channels": ("x", "y"),
        "units": ("g", "°/s"),
        "labels": np.where(np.arange(25_000) < 9000, 'up, "slow" # 1', ""),
        "temperature": rng.normal(300, 1, 25_000),
        "readback": {"table": rng.normal(size=25_000)},
    }
    return Recording(**(fields | changes))  # type: ignore[arg-type]


@pytest.mark.parametrize("suffix", [".csv", ".npz", ".parquet"])
def test_every_bit_comes_back(tmp_path: Path, suffix: str):
    path = tmp_path / f"run{suffix}"
    made = recording()
    columns = write_recording(made, path)
    read = read_recording(path, columns)
    np.testing.assert_array_equal(read.time, made.time - made.time[0])
    np.testing.assert_allclose(read.stamps, made.time, rtol=1e-15)
    np.testing.assert_array_equal(read.data, made.data)
    np.testing.assert_array_equal(read.labels, made.labels)
    np.testing.assert_array_equal(read.temperature, made.temperature)
    np.testing.assert_array_equal(read.readback["table"], made.readback["table"])
    assert (read.channels, read.units, read.source) == (made.channels, made.units, path.name)
    assert os.listdir(tmp_path) == [path.name]


def test_a_recording_without_extras_comes_back(tmp_path: Path):
    made = recording(labels=None, temperature=None, readback={})
    path = tmp_path / "run.csv"
    columns = write_recording(made, path)
    assert columns.names == ("time", "x", "y")
    assert path.read_text().startswith("time,x,y\n")
    np.testing.assert_array_equal(read_recording(path, columns).data, made.data)


@pytest.mark.parametrize(
    ("changes", "name", "data"),
    [
        ({}, "run.mat", {"file": "run.mat"}),
        ({"data": np.zeros((3, 25_000, 2))}, "run.csv", {"file": None, "names": ()}),
        ({"readback": {"x": np.zeros(25_000)}}, "run.csv", {"names": ["x"]}),
    ],
)
def test_a_recording_that_cannot_be_written_is_refused_and_leaves_no_file(
    tmp_path: Path, changes: dict[str, object], name: str, data: dict[str, Any]
):
    with refused(**data):
        write_recording(recording(**changes), tmp_path / name)
    assert os.listdir(tmp_path) == []


def test_a_block_that_fails_leaves_the_old_file(tmp_path: Path):
    path = tmp_path / "result.txt"
    path.write_text("old")

    def fail() -> None:
        with atomic_write(path) as temporary:
            temporary.write_text("half")
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == [path.name]


def test_a_folder_is_not_overwritten(tmp_path: Path):
    with refused(file=tmp_path), atomic_write(tmp_path):
        pass


def test_a_written_file_obeys_the_umask(tmp_path: Path):
    plain, path = tmp_path / "plain", tmp_path / "result.txt"
    plain.write_text("")
    with atomic_write(path) as temporary:
        temporary.write_text("new")
    assert path.stat().st_mode == plain.stat().st_mode
