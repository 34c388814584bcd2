"""Tables in MATLAB files of all versions, and in HDF5 files."""

import struct
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
from tests.refusals import refused

from inercal.basics.errors import MissingExtra
from inercal.recordings.io.column_table import ReadRequest
from inercal.recordings.io.read import read_table
from inercal.recordings.io.variables import table_from_variables

h5py = pytest.importorskip("h5py", reason="HDF5 files need the extra inercal[io]")

N = 5
T = np.arange(float(N))
ACC = np.arange(3.0 * N).reshape(N, 3) + 100
LABELS = ["up", "up", "", "down", "x_rot"]
# The variables of each file of this test, as MATLAB shows them.
CONTENT: dict[str, Any] = {
    "t": T[:, None],
    "flat": T[None, :] * 2,
    "acc": ACC,
    "wide": ACC.T,
    "count": np.arange(N, dtype=np.int16)[:, None],
    "on": np.array([True, False, True, True, False])[:, None],
    "imu": {"gyr": ACC + 50, "deep": {"T": T[:, None] + 20}},
    "part": LABELS,
    "rate": np.array([[100.0]]),
    "R": np.eye(3),
}
NAMES = {
    "t",
    "flat",
    *(f"{matrix}({k})" for matrix in ("acc", "wide", "imu.gyr") for k in (1, 2, 3)),
    "count",
    "on",
    "imu.deep.T",
    "part",
}


def save_v5(path: Path, content: dict[str, Any], **options: Any) -> None:
    cells = {k: np.array(v, dtype=object)[:, None] for k, v in content.items() if type(v) is list}
    scipy.io.savemat(path, content | cells, appendmat=False, **options)


def save_v7(path: Path, content: dict[str, Any]) -> None:
    save_v5(path, content, do_compression=True)


def save_v73(path: Path, content: dict[str, Any]) -> None:
    """Write a file as MATLAB does for -v7.3: reversed axes, UTF-16 text, cells as references."""
    with h5py.File(path, "w", userblock_size=512) as file:
        _group_v73(file, file, content)
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\0\2IM")


def _group_v73(file: Any, group: Any, content: dict[str, Any]) -> None:
    for name, value in content.items():
        if isinstance(value, dict):
            group.create_group(name).attrs["MATLAB_class"] = np.bytes_("struct")
            _group_v73(file, group[name], value)
            continue
        kind = "logical" if getattr(value, "dtype", None) == np.bool_ else "double"
        if isinstance(value, list):
            refs = file.require_group("#refs#")
            cells = [_letters_v73(refs, f"{name}{k}", text) for k, text in enumerate(value)]
            value, kind = np.array([cells], dtype=h5py.ref_dtype).T, "cell"
        elif isinstance(value, np.ndarray) and value.dtype.kind == "U":
            _letters_v73(group, name, *value.tolist())
            continue
        stored = value.astype(np.uint8) if kind == "logical" else value
        group.create_dataset(name, data=stored.T).attrs["MATLAB_class"] = np.bytes_(kind)


def _letters_v73(group: Any, name: str, *rows: str) -> Any:
    codes = [np.frombuffer(row.encode("utf-16-le"), "<u2") for row in rows]
    if not codes[0].size:
        data = group.create_dataset(name, data=np.zeros(2, np.uint64))
        data.attrs["MATLAB_empty"] = np.uint8(1)
    else:
        data = group.create_dataset(name, data=np.stack(codes, axis=-1))
    data.attrs["MATLAB_class"] = np.bytes_("char")
    return data.ref


def save_hdf5(path: Path, content: dict[str, Any]) -> None:
    with h5py.File(path, "w") as file:
        for name, value in content.items():
            if isinstance(value, dict):
                for inner, array in {"gyr": value["gyr"], "deep/T": value["deep"]["T"]}.items():
                    file[f"{name}/{inner}"] = array
            else:
                file[name] = value.ravel() if name == "t" else value


SAVED: dict[str, Callable[[Path, dict[str, Any]], None]] = {
    "v6.mat": save_v5,
    "v7.mat": save_v7,
    "v73.mat": save_v73,
    "plain.h5": save_hdf5,
    "content.dat": save_v73,
}


@pytest.mark.parametrize("name", SAVED)
def test_vectors_matrices_structs_and_labels_are_columns(tmp_path: Path, name: str):
    SAVED[name](tmp_path / name, CONTENT)
    table = read_table(tmp_path / name)
    assert set(table.names) == set(table.columns) == NAMES
    assert table.numbers("t").tolist() == T.tolist()
    assert table.numbers("flat").tolist() == (2 * T).tolist()
    for k in range(3):
        for matrix, shift in (("acc", 0), ("wide", 0), ("imu.gyr", 50)):
            column = table.numbers(f"{matrix}({k + 1})")
            assert column.tolist() == (ACC[:, k] + shift).tolist()
            assert column.dtype == np.float64
    assert table.numbers("count").tolist() == [0, 1, 2, 3, 4]
    assert table.numbers("on").tolist() == [1, 0, 1, 1, 0]
    assert table.numbers("imu.deep.T").tolist() == (T + 20).tolist()
    assert table.columns["part"].tolist() == LABELS
    assert (table.source, table.first_line, len(table.sha256)) == (name, 0, 64)


def test_version_4_is_read(tmp_path: Path):
    path = tmp_path / "old.mat"
    scipy.io.savemat(path, {"t": T[:, None], "acc": ACC, "part": LABELS[:1] * N}, format="4")
    table = read_table(path)
    assert table.numbers("acc(3)").tolist() == ACC[:, 2].tolist()
    assert table.columns["part"].tolist() == ["up"] * N


@pytest.mark.parametrize("save", [save_v5, save_v73])
def test_a_square_matrix_has_its_samples_in_rows(
    tmp_path: Path, save: Callable[[Path, dict[str, Any]], None]
):
    square = np.arange(9.0).reshape(3, 3)
    save(tmp_path / "run.mat", {"a": square})
    assert read_table(tmp_path / "run.mat").numbers("a(2)").tolist() == [1, 4, 7]
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file["a"] = square
    assert read_table(tmp_path / "run.h5").numbers("a(2)").tolist() == [1, 4, 7]


@pytest.mark.parametrize("name", SAVED)
def test_parameters_are_read_where_they_are_wanted(tmp_path: Path, name: str):
    SAVED[name](tmp_path / name, CONTENT)
    assert read_table(tmp_path / name, wanted=["rate"]).numbers("rate").tolist() == [100]
    with refused(names=["t", "rate"]):
        read_table(tmp_path / name, wanted=["t", "rate"])


@pytest.mark.parametrize("save", [save_v5, save_v73])
def test_whole_numbers_and_rows_of_letters_serve_as_labels(
    tmp_path: Path, save: Callable[[Path, dict[str, Any]], None]
):
    letters = np.array(["up   ", "up   ", "down ", "x_rot", "x_rot"])
    content = {"t": T[:, None], "part": np.array([[1.0, 1, 2, 2, 3]]), "rows": letters}
    save(tmp_path / "run.mat", content)
    table = read_table(tmp_path / "run.mat", text=["part"])
    assert table.columns["part"].tolist() == ["1", "1", "2", "2", "3"]
    assert table.columns["rows"].tolist() == ["up", "up", "down", "x_rot", "x_rot"]


def test_compressed_chunks_are_read_whole(tmp_path: Path):
    n = 200_001
    acc = np.random.default_rng(2).normal(size=(3, n)).astype(np.float32)
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file.create_dataset("acc", data=acc, chunks=(1, 70_001), compression="gzip", shuffle=True)
        file.create_dataset("t", data=np.arange(n), chunks=(n,), compression="lzf")
    table = read_table(tmp_path / "run.h5")
    for k in range(3):
        np.testing.assert_array_equal(table.numbers(f"acc({k + 1})"), acc[k])
    np.testing.assert_array_equal(table.numbers("t"), np.arange(n))


def test_a_mat_file_of_ascii_is_text(data_dir: Path, tmp_path: Path):
    table = read_table(data_dir / "xsens_mti_multiposition" / "xsens_acc.mat")
    assert table.names == ("1", "2", "3", "4")
    (tmp_path / "run.mat").write_text("0 1.5\n1 2.5\n")
    assert read_table(tmp_path / "run.mat").numbers("2").tolist() == [1.5, 2.5]


def test_a_group_that_holds_itself_and_links_elsewhere_are_passed_over(tmp_path: Path):
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file["imu/t"] = T
        file["imu/again"] = file["imu"]
        file["lost"] = h5py.SoftLink("/nowhere")
        file["other"] = h5py.ExternalLink("other.h5", "/t")
    assert read_table(tmp_path / "run.h5").names == ("imu.t",)


def element(kind: int, payload: bytes) -> bytes:
    """Return a data element of a version 5 file."""
    return struct.pack("<II", kind, len(payload)) + payload + b"\0" * (-len(payload) % 8)


def table_v5() -> bytes:
    """Return the variable T that MATLAB 7 writes for a table object, without its contents."""
    words = [element(1, word) for word in (b"T", b"MCOS", b"table")]
    ids = np.array([0xDD000000, 2, 1, 1, 1, 1], "<u4").tobytes()
    dims = element(5, struct.pack("<ii", 6, 1))
    inside = element(6, struct.pack("<II", 13, 0)) + dims + element(1, b"") + element(6, ids)
    return element(
        14, element(6, struct.pack("<II", 17, 0)) + b"".join(words) + element(14, inside)
    )


def add_table(path: Path) -> None:
    path.write_bytes(path.read_bytes() + table_v5())


def test_plain_arrays_beside_an_object_are_read(tmp_path: Path):
    path = tmp_path / "run.mat"
    save_v5(path, {"t": T[:, None], "s": {"x": T}})
    add_table(path)
    assert read_table(path, wanted=["t", "s.x"]).numbers("s.x").tolist() == T.tolist()
    with refused(file="run.mat", names=["T"]):
        read_table(path, wanted=["t", "T.x"])


def no_columns_v73(kind: str) -> Callable[[Path], None]:
    def save(path: Path) -> None:
        save_v73(path, {"T": np.zeros((1, 6))})
        with h5py.File(path, "r+") as file:
            file["T"].attrs["MATLAB_class"] = np.bytes_(kind)
            file["T"].attrs["MATLAB_object_decode"] = np.int32(3)

    return save


def saved(save: Callable[[Path, dict[str, Any]], None], **content: Any) -> Callable[[Path], None]:
    return lambda path: save(path, content)


def cells_v73(path: Path) -> None:
    save_v73(path, {"T": ["a", "bc"]})
    with h5py.File(path, "r+") as file:
        file["#refs#/T1"].attrs["MATLAB_class"] = np.bytes_("double")


def sparse_v73(path: Path) -> None:
    save_v73(path, {"T": {"data": T[:, None]}})
    with h5py.File(path, "r+") as file:
        file["T"].attrs["MATLAB_class"] = np.bytes_("double")
        file["T"].attrs["MATLAB_sparse"] = np.uint64(5)


def empty_v5(path: Path) -> None:
    save_v5(path, {})


def object_v5(path: Path) -> None:
    save_v5(path, {})
    add_table(path)


def unwritten(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file.create_dataset("T", shape=(10**12,), dtype="f8", chunks=(1000,))


def content(raw: bytes) -> Callable[[Path], None]:
    def save(path: Path) -> None:
        path.write_bytes(raw)

    return save


# Each variable is T, but for the file's own damage: then no name is known.
UNUSABLE: dict[str, Callable[[Path], None]] = {
    "complex v5": saved(save_v5, T=T + 1j),
    "complex v7.3": saved(save_hdf5, T=T + 1j),
    "three axes": saved(save_v5, T=np.zeros((2, 3, 4))),
    "empty array": saved(save_v5, T=np.zeros((0, 3))),
    "empty array v7.3": saved(save_hdf5, T=np.zeros((0, 3))),
    "single number": saved(save_hdf5, T=np.float64(1)),
    "big matrix": saved(save_v5, T=np.zeros((1001, 1001))),
    "structs": saved(save_v5, T=np.array([({},)] * 2, dtype=[("x", object)])),
    "cells": saved(save_v5, T=["a", 1.0]),
    "cells v7.3": cells_v73,
    "sparse v5": saved(save_v5, T=scipy.sparse.eye_array(5, format="csc")),
    "sparse v7.3": sparse_v73,
    "object v5": object_v5,
    "object v7.3": no_columns_v73("table"),
    "function v7.3": no_columns_v73("function_handle"),
    "unwritten": unwritten,
}
DAMAGED: dict[str, Callable[[Path], None]] = {
    "nothing v5": empty_v5,
    "nothing v7.3": saved(save_v73),
    "no file content": content(b""),
    "title only": content(b"MATLAB 5.0 MAT-file, Platform: PCWIN64".ljust(100)),
    "junk": content(bytes(range(256)) * 8),
}


@pytest.mark.parametrize("name", UNUSABLE)
@pytest.mark.parametrize("wanted", [None, ["T"]], ids=["all", "one"])
def test_a_variable_that_is_not_a_column_is_refused_by_name(
    tmp_path: Path, name: str, wanted: list[str] | None
):
    path = tmp_path / "run.mat"
    UNUSABLE[name](path)
    with refused(file=path, names=["T"]) as caught:
        read_table(path, wanted)
    assert len(str(caught.value)) < 200


def test_a_field_that_is_not_a_column_is_refused_by_name(tmp_path: Path):
    save_v5(tmp_path / "run.mat", {"T": {"x": T + 1j}})
    with refused(names=["T.x"]):
        read_table(tmp_path / "run.mat")


@pytest.mark.parametrize("name", DAMAGED)
def test_a_file_without_variables_is_refused(tmp_path: Path, name: str):
    path = tmp_path / "run.mat"
    DAMAGED[name](path)
    with refused(file=path, names=()) as caught:
        read_table(path)
    assert len(str(caught.value)) < 200


def test_a_column_misspelt_is_named_with_those_meant(tmp_path: Path):
    for save, name in ((save_v5, "a.mat"), (save_v73, "b.mat"), (save_hdf5, "c.h5")):
        save(tmp_path / name, CONTENT)
        with refused(file=name, names=["imu.gyr(4)"]) as refusal:
            read_table(tmp_path / name, wanted=["imu.gyr(4)"])
        assert "'imu.gyr(3)'" in str(refusal.value)


@pytest.mark.parametrize("save", [save_v5, save_v7, save_v73])
@pytest.mark.parametrize("damage", ["cut", "cut short", "overwritten"])
def test_a_damaged_file_is_refused_in_one_line(
    tmp_path: Path, save: Callable[[Path, dict[str, Any]], None], damage: str
):
    path = tmp_path / "run.mat"
    save(path, {"t": np.random.default_rng(0).normal(size=(10_000, 3))})
    content = bytearray(path.read_bytes())
    if damage == "overwritten":
        content[130:3000] = b"\xff" * 2870
    path.write_bytes(content[: {"cut": 20_000, "cut short": 200}.get(damage)])
    with refused(file=path) as caught:
        read_table(path)
    assert len(str(caught.value)) < 200


def test_damaged_chunks_are_refused(tmp_path: Path):
    path = tmp_path / "run.h5"
    with h5py.File(path, "w") as file:
        data = np.random.default_rng(0).normal(size=10_000)
        file.create_dataset("t", data=data, compression="gzip")
        start = file["t"].id.get_chunk_info(0).byte_offset
    content = bytearray(path.read_bytes())
    content[start + 50 : start + 90] = b"\xff" * 40
    path.write_bytes(content)
    with refused(file=path):
        read_table(path)


def test_without_h5py_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    save_v73(tmp_path / "run.mat", CONTENT)
    save_v5(tmp_path / "old.mat", {"t": T})
    for name in [name for name in sys.modules if name.partition(".")[0] == "h5py"]:
        monkeypatch.setitem(sys.modules, name, None)
    with refused(MissingExtra, names=("io",)):
        read_table(tmp_path / "run.mat")
    assert read_table(tmp_path / "old.mat").numbers("t").tolist() == T.tolist()


def test_files_that_matlab_wrote_are_read():
    folder = Path(scipy.io.matlab.__file__).parent / "tests" / "data"
    if not folder.is_dir():
        pytest.skip("this SciPy comes without the files of its tests")
    theta = np.arange(9) * np.pi / 4
    for version in ("4.2c_SOL2", "6.1_SOL2", "6.5.1_GLNX86", "7.4_GLNX86"):
        read = read_table(folder / f"testdouble_{version}.mat").numbers("testdouble")
        np.testing.assert_allclose(read, theta, rtol=1e-15)
    hdf5 = read_table(folder / "testhdf5_7.4_GLNX86.mat").numbers("testdouble")
    np.testing.assert_allclose(hdf5, theta, rtol=1e-15)
    struct_file = read_table(folder / "teststruct_7.4_GLNX86.mat")
    np.testing.assert_allclose(
        struct_file.numbers("teststruct.doublefield"), [2**0.5, np.e, np.pi], rtol=1e-15
    )
    for file, name in (
        ("testfunc_7.4_GLNX86.mat", "testfunc"),
        ("testobject_7.4_GLNX86.mat", "testobject"),
        ("logical_sparse.mat", "sp_log_5_4"),
    ):
        with refused(file=file, names=[name]):
            read_table(folder / file)


def test_a_file_without_variables_has_no_columns(tmp_path: Path):
    with refused(names=()):
        table_from_variables(tmp_path / "run.mat", [], ReadRequest())
