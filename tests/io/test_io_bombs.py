"""Small files that declare more than any memory holds are refused at bounded cost."""

import json
import struct
import subprocess
import sys
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from tests.base_seeds import chosen
from tests.refusals import refused

from inercal.recordings.io.read import read_table

N = 1_000_000_000  # values


def npz(path: Path) -> None:
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("ax.npy", "w", force_zip64=True) as file,
    ):
        head = {"descr": "<f8", "fortran_order": False, "shape": (N,)}
        np.lib.format.write_array_header_1_0(file, head)
        for _ in range(300):
            file.write(bytes(1 << 20))


def npz_words(path: Path) -> None:
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("ax.npy", "w", force_zip64=True) as file,
    ):
        head = {"descr": "<U1000000", "fortran_order": False, "shape": (N // 1_000_000 * 4,)}
        np.lib.format.write_array_header_1_0(file, head)
        for _ in range(300):
            file.write(bytes(1 << 20))


def hdf5(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file.create_dataset("ax", (N,), "f8", chunks=(N // 1000,), compression="gzip")


def hdf5_filled(path: Path) -> None:
    with h5py.File(path, "w") as file:
        data = file.create_dataset("ax", (N,), "u1", chunks=(N // 10,), compression="gzip")
        packed = zlib.compress(bytes(N // 10), 9)
        for k in range(10):
            data.id.write_direct_chunk((k * (N // 10),), packed)


def mat_element(kind: int, content: bytes) -> bytes:
    return struct.pack("<2I", kind, len(content)) + content


def mat_matrix(kind: int, shape: tuple[int, int], name: bytes = b"") -> bytes:
    """Return the head of a matrix of a class, before its values."""
    flags, sides = struct.pack("<2I", kind, 0), struct.pack("<2i", *shape)
    return mat_element(6, flags) + mat_element(5, sides) + mat_element(1, name)


def packed_mat(path: Path, head: bytes, zeros: int) -> None:
    """Write a file with one packed element: a head, and zeros."""
    packer = zlib.compressobj(9)
    packed = packer.compress(head)
    block = bytes(1 << 24)
    for _ in range(zeros >> 24):
        packed += packer.compress(block)
    packed += packer.compress(bytes(zeros & ((1 << 24) - 1))) + packer.flush()
    title = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x100) + b"IM"
    path.write_bytes(title + mat_element(15, packed))


DOUBLES, CELLS, STRUCT = 6, 1, 2  # classes of MATLAB
NAME = b"ax\0\0\0\0\0\0"


def mat(path: Path) -> None:
    """Write numbers that are stored as bytes, as MATLAB stores small integers."""
    head = mat_matrix(DOUBLES, (N, 1), NAME) + struct.pack("<2I", 2, N)
    packed_mat(path, struct.pack("<2I", 14, len(head) + N) + head, N)


def mat_long(path: Path) -> None:
    """Write a matrix whose values are more than it declares."""
    head = mat_matrix(DOUBLES, (100, 1), NAME) + struct.pack("<2I", 2, N)
    packed_mat(path, struct.pack("<2I", 14, 1000) + head, N)


def mat_struct(path: Path) -> None:
    """Write a struct with such numbers in its field."""
    inner = mat_matrix(DOUBLES, (N, 1)) + struct.pack("<2I", 2, N)
    fields = struct.pack("<HHI", 5, 4, 8) + mat_element(1, NAME)
    head = mat_matrix(STRUCT, (1, 1), NAME) + fields
    head += struct.pack("<2I", 14, len(inner) + N) + inner
    packed_mat(path, struct.pack("<2I", 14, len(head) + N) + head, N)


def mat_cells(path: Path) -> None:
    """Write cells without values: eight bytes each in the file, and an array each once loaded."""
    cells = N // 10
    head = mat_matrix(CELLS, (cells, 1), NAME)
    packer = zlib.compressobj(9)
    packed = packer.compress(struct.pack("<2I", 14, len(head) + 8 * cells) + head)
    block = struct.pack("<2I", 14, 0) * (1 << 20)
    for _ in range(cells >> 20):
        packed += packer.compress(block)
    packed += packer.flush()
    title = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x100) + b"IM"
    path.write_bytes(title + mat_element(15, packed))


def parquet(path: Path) -> None:
    schema = pa.schema([("ax", pa.float64())])
    with pq.ParquetWriter(path, schema, compression="zstd", max_rows_per_page=N) as writer:
        zeros = pa.record_batch([np.zeros(N // 50)], schema)
        for _ in range(50):
            writer.write_batch(zeros, row_group_size=N // 50)


def parquet_dictionary(path: Path) -> None:
    words = pa.DictionaryArray.from_arrays(np.zeros(20_000, "i4"), ["x" * 100_000_000])
    pq.write_table(pa.table({"ax": words}), path, compression="zstd")


BOMBS: dict[str, Callable[[Path], None]] = {
    "a.npz": npz,
    "words.npz": npz_words,
    "a.h5": hdf5,
    "filled.h5": hdf5_filled,
    "a.mat": mat,
    "long.mat": mat_long,
    "struct.mat": mat_struct,
    "cells.mat": mat_cells,
    "a.parquet": parquet,
    "dictionary.parquet": parquet_dictionary,
}
ONE_OF_EACH_FORMAT = ("a.npz", "filled.h5", "cells.mat", "dictionary.parquet")


def cost(path: Path, *names: str) -> dict[str, Any]:
    """Return what reading a file costs, and what is said of it, in a process that survives."""
    done = subprocess.run(
        [sys.executable, "-m", "tests.io.reading_cost", str(path), *names],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    told = json.loads(done.stdout)
    assert told["own"] < 50_000  # kB
    assert told["memory"] < 1_000_000
    assert told["seconds"] < 10
    assert "\n" not in (told["error"] or "")
    return told


@pytest.mark.slow
@pytest.mark.parametrize("name", chosen(BOMBS, ONE_OF_EACH_FORMAT))
def test_a_bomb_is_refused_within_1_gb_and_10_s(tmp_path: Path, name: str):
    path = tmp_path / name
    BOMBS[name](path)
    assert path.stat().st_size < 4_000_000
    assert cost(path, "ax")["error"].startswith(name)


def test_the_limit_is_that_of_the_data_section(tmp_path: Path):
    path = tmp_path / "a.npz"
    np.savez(path, ax=np.zeros(1001))
    with refused(key="[data] most_values"):
        read_table(path, ["ax"], options={"most_values": 1000})
    assert read_table(path, ["ax"], options={"most_values": 1001}).columns["ax"].size == 1001


@pytest.mark.parametrize("kind", ["external", "virtual"])
def test_values_outside_an_hdf5_file_are_not_read(tmp_path: Path, kind: str):
    secret = tmp_path / "secret"
    secret.write_bytes(np.arange(100.0).tobytes())
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["ax"] = np.arange(100.0)
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        if kind == "external":
            file.create_dataset("ax", (100,), "f8", external=[(str(secret), 0, 800)])
        else:
            layout = h5py.VirtualLayout((100,), "f8")
            layout[:] = h5py.VirtualSource(tmp_path / "other.h5", "ax", (100,))
            file.create_virtual_dataset("ax", layout)
    with refused(names=("ax",)):
        read_table(path, ["ax"])


@pytest.mark.parametrize("change", ["grows", "shrinks"])
def test_a_file_that_changes_while_it_is_read_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, change: str
):
    path = tmp_path / "a.csv"
    path.write_text("t,ax\n" + "".join(f"{k},1.5\n" for k in range(1000)))

    def sniffed(read: Path, skip: int) -> object:
        if change == "grows":
            with path.open("a") as file:
                file.writelines(f"{k},2.5\n" for k in range(1000, 3000))
        else:
            path.write_text("t,ax\n0,1.5\n")
        return sniff(read, skip)

    from inercal.recordings.io.text import sniff

    monkeypatch.setattr("inercal.recordings.io.text.sniff", sniffed)
    with refused(file=path):
        read_table(path)
