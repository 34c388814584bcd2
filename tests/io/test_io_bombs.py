"""Small files that declare more than any memory holds are refused before they are decoded."""

import struct
import subprocess
import sys
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from tests.refusals import refused

from inercal.io.read import read_table

N = 1_000_000_000  # values
READ = """
import resource, sys
from inercal.errors import InputError
from inercal.io.read import read_table
import {libraries}
size = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (size + 4_000_000_000,) * 2)
before = resource.getrusage(resource.RUSAGE_SELF)
seconds = int(before.ru_utime + before.ru_stime) + 3
resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
try:
    read_table(sys.argv[1], ["ax"])
except InputError as error:
    after = resource.getrusage(resource.RUSAGE_SELF)
    print(after.ru_maxrss - before.ru_maxrss, error.key, error)
"""


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


def mat(path: Path, size: int = 8 * 500_000_000, declared: int | None = None) -> None:
    """Write a packed matrix, whose last element declares `size` bytes and has as many zeros."""
    flags = mat_element(6, struct.pack("<2I", 6, 0))
    shape = mat_element(5, struct.pack("<2i", size // 8, 1))
    name = mat_element(1, b"ax\0\0\0\0\0\0")
    head = (
        struct.pack("<2I", 14, declared or size + 64)
        + flags
        + shape
        + name
        + struct.pack("<2I", 9, size)
    )
    packer = zlib.compressobj(9)
    packed = packer.compress(head)
    block = bytes(1 << 24)
    for _ in range(size >> 24):
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


BOMBS: dict[str, tuple[Callable[[Path], None], str]] = {
    "a.npz": (npz, "numpy"),
    "words.npz": (npz_words, "numpy"),
    "a.h5": (hdf5, "h5py"),
    "filled.h5": (hdf5_filled, "h5py"),
    "a.mat": (mat, "scipy.io"),
    "short.mat": (lambda path: mat(path, declared=1000), "scipy.io"),
    "a.parquet": (parquet, "pyarrow.parquet"),
    "dictionary.parquet": (parquet_dictionary, "pyarrow.parquet"),
}


# Values that are not stored, a label of 100 MB, a variable longer than it declares.
REFUSED_OTHERWISE = ("a.h5", "dictionary.parquet", "short.mat")


@pytest.mark.slow
@pytest.mark.parametrize("name", BOMBS)
def test_a_bomb_is_refused_within_300_mb_and_2_s(tmp_path: Path, name: str):
    make, libraries = BOMBS[name]
    path = tmp_path / name
    make(path)
    assert path.stat().st_size < 4_000_000
    script = READ.format(libraries=libraries)
    done = subprocess.run(
        [sys.executable, "-c", script, str(path)], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert ("[data] most_values" in done.stdout) == (name not in REFUSED_OTHERWISE)
    assert done.stdout.count("\n") == 1
    assert int(done.stdout.split()[0]) < 300_000  # kB


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

    def sniffed(read: Path) -> object:
        if change == "grows":
            with path.open("a") as file:
                file.writelines(f"{k},2.5\n" for k in range(1000, 3000))
        else:
            path.write_text("t,ax\n0,1.5\n")
        return sniff(read)

    from inercal.io.text import sniff

    monkeypatch.setattr("inercal.io.text.sniff", sniffed)
    with refused(file=path):
        read_table(path)
