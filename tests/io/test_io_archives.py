"""Tables in .npz and Parquet files."""

import sys
import time
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from tests.refusals import refused

from inercal.basics.errors import MissingExtra
from inercal.recordings.io.read import read_table

T, X = np.arange(3.0), np.array([1, 2, 3], dtype=np.int16)


def test_npz_holds_columns_by_name(tmp_path: Path):
    path = tmp_path / "run.npz"
    np.savez(path, t=T, x=X, part=np.array(["a", "b", "b"]), picture=np.zeros((4, 4)))
    table = read_table(path, wanted=["t", "x", "part"], text=["part"])
    assert table.names == ("t", "x", "part", "picture")
    assert table.numbers("x").dtype == np.float64
    assert table.numbers("x").tolist() == [1, 2, 3]
    assert table.columns["part"].tolist() == ["a", "b", "b"]
    assert (table.first_line, len(table.sha256)) == (0, 64)


def test_npz_may_hold_one_matrix_with_names(tmp_path: Path):
    path = tmp_path / "run.npz"
    np.savez_compressed(path, data=np.stack([T, X], -1), columns=np.array(["t", "x"]))
    table = read_table(path, wanted=["x"])
    assert table.names == ("t", "x")
    assert table.columns["x"].tolist() == [1, 2, 3]


def test_numbers_serve_as_labels(tmp_path: Path):
    np.savez(tmp_path / "run.npz", part=X)
    pq.write_table(pa.table({"part": X}), tmp_path / "run.parquet")
    for name in ("run.npz", "run.parquet"):
        labels = read_table(tmp_path / name, text=["part"]).columns["part"]
        assert labels.tolist() == ["1", "2", "3"]


@pytest.mark.parametrize(
    ("arrays", "names"),
    [
        ({"t": np.array([{}, 1], dtype=object)}, ("t",)),
        ({"t": T, "x": X[:2]}, ("t", "x")),
        ({"t": np.zeros((3, 2))}, ("t",)),
        ({"t": T + 1j}, ("t",)),
        ({"t": T[:0]}, ()),
        ({"data": T, "columns": np.array(["t"])}, ("data", "columns")),
    ],
)
def test_arrays_that_form_no_table_are_refused(
    tmp_path: Path, arrays: dict[str, np.ndarray], names: tuple[str, ...]
):
    path = tmp_path / "run.npz"
    np.savez(path, allow_pickle=True, **arrays)
    with refused(file=path, names=names):
        read_table(path)


def test_a_matrix_without_names_is_read_in_the_way_that_its_refusal_states(tmp_path: Path):
    matrix = np.stack([T, X], -1)
    np.savez(tmp_path / "run.npz", matrix)
    with refused(file=tmp_path / "run.npz", names=("arr_0",)) as refusal:
        read_table(tmp_path / "run.npz")
    assert "numpy.save" in str(refusal.value)
    np.save(tmp_path / "run.npy", matrix)
    assert read_table(tmp_path / "run.npy").columns["2"].tolist() == X.tolist()


@pytest.mark.parametrize("suffix", [".npz", ".parquet"])
@pytest.mark.parametrize("damage", ["cut", "overwritten", "empty"])
def test_a_damaged_archive_is_refused_in_one_line(tmp_path: Path, suffix: str, damage: str):
    path = tmp_path / f"run{suffix}"
    many = np.random.default_rng(0).normal(size=100_000)
    if suffix == ".npz":
        np.savez_compressed(path, t=many)
    else:
        pq.write_table(pa.table({"t": many}), path, write_page_checksum=True)
    content = bytearray(path.read_bytes())
    if damage == "cut":
        content = content[: len(content) // 2]
    elif damage == "empty":
        content = bytearray()
    else:
        content[200:5000] = b"\xff" * 4800
    path.write_bytes(content)
    start = time.perf_counter()
    with refused(file=path) as caught:
        read_table(path)
    assert time.perf_counter() - start < 1
    assert len(str(caught.value)) < 200


def test_parquet_tables_are_read_with_missing_numbers_as_nan(tmp_path: Path):
    path = tmp_path / "run.parquet"
    part = pa.array(["a", "b", None]).dictionary_encode()
    pq.write_table(pa.table({"t": T, "x": pa.array([1, None, 3]), "part": part}), path)
    table = read_table(path)
    np.testing.assert_array_equal(table.numbers("x"), [1, np.nan, 3])
    assert table.columns["part"].tolist() == ["a", "b", ""]


def test_parquet_columns_of_dates_are_refused(tmp_path: Path):
    path = tmp_path / "run.parquet"
    pq.write_table(pa.table({"t": np.array([0, 1], dtype="datetime64[ns]")}), path)
    with refused(file=path, names=["t"]):
        read_table(path)


def test_without_pyarrow_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path = tmp_path / "run.parquet"
    pq.write_table(pa.table({"t": T}), path)
    for name in [name for name in sys.modules if name.partition(".")[0] == "pyarrow"]:
        monkeypatch.setitem(sys.modules, name, None)
    with refused(MissingExtra, names=("io",)):
        read_table(path)
