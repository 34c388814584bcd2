"""Whole ns since 1970 are read to the last digit from every format; files share an origin."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from tests.io.log_files import six_positions

from inercal.recordings.io.frames import recording_from_frame
from inercal.recordings.io.read import read_readback, read_recording
from inercal.recordings.io.table_recording import Columns
from inercal.recordings.io.write import write_recording

N, STEP = 60, 3_333_333  # samples, ns
START = 1_700_000_000_123_456_789  # ns since 1970; float64 has every 256th
NS = START + STEP * np.arange(N, dtype=np.int64)
TIME = STEP * np.arange(N) / 1e9
X = np.sin(np.arange(N))
COLUMNS = Columns((("x", "x", "g"),), time="t", time_unit="ns")

Table = dict[str, NDArray[Any]]


def text(path: Path, table: Table) -> None:
    rows = zip(*(column.tolist() for column in table.values()), strict=True)
    lines = [",".join(table), *(",".join(map(repr, row)) for row in rows)]
    path.write_text("\n".join(lines), encoding="utf-8")


def hdf5(path: Path, table: Table) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        for name, column in table.items():
            file[name] = column


def mat(path: Path, table: Table) -> None:
    pytest.importorskip("scipy.io").savemat(path, table)


WRITERS: dict[str, Callable[[Path, Table], None]] = {
    ".csv": text,
    ".npz": lambda path, table: np.savez(path, allow_pickle=False, **table),
    ".parquet": lambda path, table: pd.DataFrame(table).to_parquet(path),
    ".h5": hdf5,
    ".mat": mat,
}


@pytest.mark.parametrize("suffix", WRITERS)
def test_every_ns_is_read(suffix: str, tmp_path: Path):
    path = tmp_path / f"run{suffix}"
    WRITERS[suffix](path, {"t": NS, "x": X})
    read = read_recording(path, COLUMNS)
    np.testing.assert_array_equal(read.time, TIME)
    np.testing.assert_array_equal(read.data[:, 0], X)
    assert read.origin == START
    np.testing.assert_allclose(read.stamps, NS / 1e9, rtol=1e-15)


@pytest.mark.parametrize("kind", ["int64", "uint64", "Int64", "object"])
def test_every_ns_of_a_table_in_memory_is_read(kind: str):
    frame = pd.DataFrame({"t": pd.Series(NS).astype(kind), "x": X})
    np.testing.assert_array_equal(recording_from_frame(frame, COLUMNS).time, TIME)


def test_text_with_quoted_cells_comments_and_white_space(tmp_path: Path):
    path = tmp_path / "run.txt"
    for before, row in (("# logger\n", "{} {}"), ("", '"{}";"{}"')):
        name = "t x\n" if " " in row else '"t";"x"\n'
        rows = [row.format(t, x) for t, x in zip(NS.tolist(), X.tolist(), strict=True)]
        rows.insert(7, "")
        path.write_text(before + name + "\n".join(rows), encoding="utf-8")
        np.testing.assert_array_equal(read_recording(path, COLUMNS).time, TIME)


def test_numbers_that_are_not_whole_are_read_as_before(tmp_path: Path):
    path = tmp_path / "run.csv"
    path.write_text("t,x\n" + "\n".join(f"{t + 0.5},{x}" for t, x in zip(NS / 1e3, X, strict=True)))
    read = read_recording(path, Columns((("x", "x", "g"),), time="t", time_unit="us"))
    np.testing.assert_allclose(read.time, TIME, atol=1e-6)
    assert read.time[0] == 0


def test_files_of_one_clock_share_the_first_stamp(tmp_path: Path):
    first, late = 10, STEP // 3  # the gyros begin ten samples later, a third of a step apart
    np.savez(tmp_path / "acc.npz", allow_pickle=False, t=NS, x=X)
    np.savez(tmp_path / "gyr.npz", allow_pickle=False, u=NS[first:] + late, y=X[first:])
    columns = replace(COLUMNS, second=(("y", "y", "rad/s"),), second_time="u")
    joined = read_recording(tmp_path / "acc.npz", columns, None, tmp_path / "gyr.npz")
    np.testing.assert_array_equal(joined.data[:, 0], joined.data[:, 1])
    np.testing.assert_array_equal(joined.data[:, 0], X[first:])
    # A table of another unit, which began 1.5 s earlier.
    table = {"t": (NS[0] - 1_500_000_000) / 1e9 + np.arange(N) / 20, "x": X}
    text(tmp_path / "table.csv", table)
    other = Columns((("x", "x", "1"),), time="t", origin=joined.origin)
    found = read_readback(tmp_path / "table.csv", other)
    np.testing.assert_allclose(found.time, np.arange(N) / 20 - 1.5, atol=3e-7)


@pytest.mark.slow
def test_bags_share_the_first_stamp(tmp_path: Path):
    pytest.importorskip("rosbags")
    from tests.io.ros_files import EPOCH_NS, RAW, messages, write_bag

    samples, later = six_positions(), 7
    sent = [one for one in messages(samples, first=True) if one[0] == RAW]
    begin = EPOCH_NS + int(samples.ns[later] - samples.ns[0])
    acc = write_bag(tmp_path / "acc.bag", sent)
    gyr = write_bag(tmp_path / "gyr.bag", [one for one in sent if one[1] >= begin])
    columns = Columns(
        (("ax", f"{RAW}.linear_acceleration.x", "m/s²"),),
        time="time",
        second=(("gx", f"{RAW}.angular_velocity.x", "rad/s"),),
        second_time="time",
    )
    joined = read_recording(acc, columns, None, gyr)
    np.testing.assert_allclose(joined.data[:, 0], samples.acc[later:, 0])
    np.testing.assert_allclose(joined.data[:, 1], samples.gyr[later:, 0])


@pytest.mark.parametrize("suffix", [".csv", ".npz", ".parquet"])
def test_a_written_recording_keeps_its_absolute_times(suffix: str, tmp_path: Path):
    text(tmp_path / "log.csv", {"t": NS / 1e9, "x": X})
    columns = Columns((("x", "x", "g"),), time="t")
    read = read_recording(tmp_path / "log.csv", columns)
    again = read_recording(
        tmp_path / f"run{suffix}", write_recording(read, tmp_path / f"run{suffix}")
    )
    np.testing.assert_array_equal(again.stamps, NS / 1e9)
    np.testing.assert_array_equal(again.time, read.time)
