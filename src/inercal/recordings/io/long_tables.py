"""Read tables that do not fit into memory: first some rows, then blocks of the columns.

Only plain text, Parquet, .npz and HDF5 files can be read in blocks; other formats cannot.
"""

import zipfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.recordings.io.column_table import BLOCK_ROWS, Column, Table, file_sha256
from inercal.recordings.io.hdf5 import long_blocks, long_columns
from inercal.recordings.io.isolation import read_isolated, stream_isolated
from inercal.recordings.io.plain_numbers import plain_blocks, probable_rows
from inercal.recordings.io.read import detect_reader
from inercal.recordings.io.readers import Reader
from inercal.recordings.io.text_layout import sniff

HEAD_ROWS = 1 << 15
"""Number of rows that are used to recognise columns."""


@dataclass(frozen=True)
class LongTable:
    """A file that is read in blocks of rows.

    Parameters
    ----------
    path : Path
    names : tuple of str
        Names of all columns.
    rows : int
        Number of rows; an estimate for text files.
    read : callable
        Function that takes column names and returns an iterator of arrays, (k, c) float64.
    """

    path: Path
    names: tuple[str, ...]
    rows: int
    read: Callable[[Sequence[str]], Iterator[Array]]

    def head(self) -> Table:
        """Read the first rows as a table.

        Raises
        ------
        InputError
            A column does not contain numbers.
        """
        parts: list[Array] = []
        for block in self.read(self.names):
            parts.append(block)
            if sum(map(len, parts)) >= HEAD_ROWS:
                break
        values = np.concatenate(parts)[:HEAD_ROWS]
        columns: dict[str, Column] = {
            name: np.ascontiguousarray(values[:, k]) for k, name in enumerate(self.names)
        }
        return Table(self.names, columns, self.path.name, "")

    def sha256(self) -> str:
        """Return the file's SHA-256 in hexadecimal."""
        return file_sha256(self.path)


def open_long_table(path: Path, most_values: int, skip: int = 0) -> LongTable | None:
    """Open a long table; return None if it is short or if its format must be read whole.

    Parameters
    ----------
    path : Path
    most_values : int
        Largest product of rows and columns for which a file counts as short.
    skip : int
        Number of lines to skip at the beginning of a text file.

    Raises
    ------
    InputError
        The file cannot be read.
    """
    reader = detect_reader(path)
    # No format packs a value into less than a thousandth of a byte, and few files are so long.
    if path.suffix != ".npz" and path.stat().st_size < most_values // 8:
        return None
    found = _open_text(path, skip) if reader.name == "text" else _open_packed(path, reader)
    if found is None or found.rows * len(found.names) <= most_values:
        return None
    return found


def _open_text(path: Path, skip: int) -> LongTable | None:
    layout = sniff(path, skip)
    if not layout.is_plain or layout.text_columns or not (rows := probable_rows(path)):
        return None
    return LongTable(path, layout.names, rows, partial(plain_blocks, path, layout))


def _open_packed(path: Path, reader: Reader) -> LongTable | None:
    """Open a file as a long table that a library in a separate process reads."""
    if reader.name not in _PACKED or reader.isolation is None:
        return None
    columns, blocks = _PACKED[reader.name]
    try:
        found: _Shape | None = read_isolated(reader.isolation, path, columns)
    except InputError:
        return None  # it is then read whole, and its reader reports the error
    read = partial(stream_isolated, reader.isolation, path, blocks)
    return None if found is None else LongTable(path, *found, read)


def _parquet_columns(path: Path) -> "_Shape | None":
    if find_spec("pyarrow") is None:
        return None
    parquet: Any = import_module("pyarrow.parquet")
    types: Any = import_module("pyarrow").types
    metadata = parquet.read_metadata(path)
    schema = parquet.read_schema(path)
    if not all(types.is_integer(one) or types.is_floating(one) for one in schema.types):
        return None
    return tuple(map(str, schema.names)), int(metadata.num_rows)


def _parquet_blocks(path: Path, names: Sequence[str]) -> Iterator[Array]:
    parquet: Any = import_module("pyarrow.parquet")
    with parquet.ParquetFile(
        path, page_checksum_verification=True, pre_buffer=False, buffer_size=1 << 20
    ) as file:
        batches = file.iter_batches(batch_size=BLOCK_ROWS, columns=list(names), use_threads=False)
        for batch in batches:
            columns = [batch.column(name).to_numpy(zero_copy_only=False) for name in names]
            yield np.stack([np.asarray(one, dtype=np.float64) for one in columns], axis=1)


_Header = tuple[tuple[int, ...], bool, np.dtype[Any]]  # shape, whether by columns, and type


def _header(stored: Any) -> _Header:
    """Read the header of a stored array; the stream is then at its values."""
    version_1 = np.lib.format.read_magic(stored) == (1, 0)
    lib = np.lib.format
    return lib.read_array_header_1_0(stored) if version_1 else lib.read_array_header_2_0(stored)


def _npz_headers(path: Path) -> tuple[dict[str, _Header], tuple[str, ...]] | None:
    """Return the array headers in an archive, and the names of its columns.

    Return None unless all arrays contain numbers by rows and have the same length.
    """
    headers: dict[str, _Header] = {}
    with zipfile.ZipFile(path) as archive:
        for name in archive.namelist():
            with archive.open(name) as stored:
                headers[name.removesuffix(".npy")] = _header(stored)
    titled = headers.pop("columns", None) is not None
    for shape, by_columns, dtype in headers.values():
        by_rows = len(shape) == 1 or (titled and len(shape) == 2 and not by_columns)
        if not by_rows or dtype.kind not in "fiu":
            return None
    if len({shape[0] for shape, _, _ in headers.values()}) != 1:
        return None
    if not titled:
        return headers, tuple(headers)
    with np.load(path, allow_pickle=False) as file:
        names = tuple(map(str, file["columns"]))
    fits = list(headers) == ["data"] and headers["data"][0][1:] == (len(names),)
    return (headers, names) if fits else None


def _npz_columns(path: Path) -> "_Shape | None":
    found = _npz_headers(path)
    return None if found is None else (found[1], next(iter(found[0].values()))[0][0])


def _npz_blocks(path: Path, names: Sequence[str]) -> Iterator[Array]:
    found = _npz_headers(path)
    assert found is not None
    headers, all_names = found
    block = set(headers) != set(all_names)  # a single array contains all columns
    with zipfile.ZipFile(path) as archive:
        wanted = list(headers) if block else list(names)
        files = [archive.open(f"{name}.npy") for name in wanted]
        for file in files:
            _header(file)  # skip it; the values follow
        rows = headers[wanted[0]][0][0]
        for start in range(0, rows, BLOCK_ROWS):
            count = min(BLOCK_ROWS, rows - start)
            parts = [
                _values(file, name, headers[name], count)
                for file, name in zip(files, wanted, strict=True)
            ]
            values = np.concatenate(parts, axis=1)
            yield values[:, [all_names.index(name) for name in names]] if block else values


def _values(file: Any, name: str, header: _Header, rows: int) -> Array:
    """Read the next rows of an array, (k, c)."""
    shape, _, dtype = header
    width = shape[1] if len(shape) == 2 else 1
    found = np.frombuffer(file.read(rows * width * dtype.itemsize), dtype=dtype)
    if found.size != rows * width:
        raise EOFError(f"array {name!r} ends early")
    return found.reshape(rows, width).astype(np.float64)


_Shape = tuple[tuple[str, ...], int]  # column names and number of rows
_PACKED: dict[str, tuple[Callable[[Path], _Shape | None], Callable[..., Iterator[Array]]]] = {
    "parquet": (_parquet_columns, _parquet_blocks),
    "npz": (_npz_columns, _npz_blocks),
    "hdf5": (long_columns, long_blocks),
}
