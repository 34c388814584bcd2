"""Tables that are too long for the memory: their first rows, and blocks of some columns in turn.

Plain text, Parquet, .npz and HDF5 files are read so; other formats are not.
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
from inercal.recordings.io.plain_numbers import plain_blocks
from inercal.recordings.io.read import detect_reader
from inercal.recordings.io.readers import Reader
from inercal.recordings.io.text_layout import TextLayout, sniff

HEAD_ROWS = 1 << 15
"""Rows by which columns are recognised."""
_SAMPLE_BYTES = 1 << 20  # by which the rows of a text file are estimated


@dataclass(frozen=True)
class LongTable:
    """A file that is read in blocks of rows.

    Parameters
    ----------
    path : Path
    names : tuple of str
        Of all columns.
    rows : int
        Number of rows; of text an estimate.
    read : callable
        Names of columns to an iterator of arrays, (k, c) float64.
    """

    path: Path
    names: tuple[str, ...]
    rows: int
    read: Callable[[Sequence[str]], Iterator[Array]]

    def head(self) -> Table:
        """Return the first rows as a table.

        Raises
        ------
        InputError
            A column that is not of numbers.
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
        return Table(self.names, columns, self.path.name, "", 0, header=True)

    def sha256(self) -> str:
        """Return the SHA-256 of the file."""
        return file_sha256(self.path)


def open_long_table(path: Path, most_values: int) -> LongTable | None:
    """Return a file as a long table; None where it is short, or of a format that is read whole.

    Parameters
    ----------
    path : Path
    most_values : int
        Rows times columns, up to which a file is short.

    Raises
    ------
    InputError
        The file cannot be read.
    """
    reader = detect_reader(path)
    # No format packs a value into less than a thousandth of a byte, and few files are so long.
    if path.suffix != ".npz" and path.stat().st_size < most_values // 8:
        return None
    found = _open_text(path) if reader.name == "text" else _open_packed(path, reader)
    if found is None or found.rows * len(found.names) <= most_values:
        return None
    return found


def _open_text(path: Path) -> LongTable | None:
    layout = sniff(path, 0)
    plain = layout.delimiter is not None and not layout.decimal_comma and not layout.quoted
    if not plain or layout.text_columns or find_spec("pyarrow") is None:
        return None
    with path.open("rb") as file:
        sample = file.read(_SAMPLE_BYTES)
    rows = path.stat().st_size * max(sample.count(b"\n"), 1) // max(len(sample), 1)
    return LongTable(path, layout.names, rows, partial(_text_blocks, path, layout))


def _text_blocks(path: Path, layout: TextLayout, names: Sequence[str]) -> Iterator[Array]:
    return plain_blocks(path, layout, [layout.names.index(name) for name in names])


def _open_packed(path: Path, reader: Reader) -> LongTable | None:
    """Return a file of a library as a long table, which a process of its own reads."""
    if reader.name not in _PACKED or reader.isolation is None:
        return None
    columns, blocks = _PACKED[reader.name]
    try:
        found: _Shape | None = read_isolated(reader.isolation, path, columns)
    except InputError:
        return None  # read whole, its reader names what is wrong
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


@dataclass(frozen=True)
class _Member:
    """An array of an archive: its shape and type, and where its values begin."""

    name: str
    shape: tuple[int, ...]
    dtype: np.dtype[Any]


def _npz_members(path: Path) -> tuple[tuple[_Member, ...], tuple[str, ...]] | None:
    """Return the arrays of numbers of an archive and the names of its columns; None for others."""
    with zipfile.ZipFile(path) as archive:
        members = [_member(archive, name) for name in archive.namelist()]
        titles = _titles(archive, path)
    numbers = [one for one in members if one is not None and one.name != "columns"]
    if len(numbers) < len([one for one in members if one is None or one.name != "columns"]):
        return None
    if titles is not None:
        names = titles
        shapes = {one.shape[1:] for one in numbers}
        if [one.name for one in numbers] != ["data"] or shapes != {(len(titles),)}:
            return None
    else:
        names = tuple(one.name for one in numbers)
        if any(len(one.shape) != 1 for one in numbers):
            return None
    if len({one.shape[0] for one in numbers}) != 1:
        return None
    return tuple(numbers), names


def _npz_columns(path: Path) -> "_Shape | None":
    found = _npz_members(path)
    return None if found is None else (found[1], found[0][0].shape[0])


def _member(archive: zipfile.ZipFile, name: str) -> _Member | None:
    """Return an array of numbers by rows; None of anything else."""
    with archive.open(name) as stored:
        version = np.lib.format.read_magic(stored)  # type: ignore[arg-type]
        read = np.lib.format.read_array_header_1_0
        read = read if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, fortran, dtype = read(stored)  # type: ignore[arg-type]
    if name == "columns.npy":
        return _Member("columns", shape, dtype)
    by_rows = len(shape) == 1 or (len(shape) == 2 and not fortran)
    return (
        _Member(name.removesuffix(".npy"), shape, dtype)
        if (by_rows and dtype.kind in "fiu")
        else None
    )


def _titles(archive: zipfile.ZipFile, path: Path) -> tuple[str, ...] | None:
    if "columns.npy" not in archive.namelist():
        return None
    with np.load(path, allow_pickle=False) as file:
        return tuple(map(str, file["columns"]))


def _npz_blocks(path: Path, names: Sequence[str]) -> Iterator[Array]:
    found = _npz_members(path)
    assert found is not None
    members, all_names = found
    block = members[0].name == "data" and len(members[0].shape) == 2
    chosen = members if block else tuple(m for name in names for m in members if m.name == name)
    places = [all_names.index(name) for name in names] if block else []
    rows = members[0].shape[0]
    with zipfile.ZipFile(path) as archive:
        files = [archive.open(f"{one.name}.npy") for one in chosen]
        for one in files:
            version = np.lib.format.read_magic(one)  # type: ignore[arg-type]
            read = np.lib.format.read_array_header_1_0
            read = read if version == (1, 0) else np.lib.format.read_array_header_2_0
            read(one)  # type: ignore[arg-type]
        for start in range(0, rows, BLOCK_ROWS):
            count = min(BLOCK_ROWS, rows - start)
            parts = [_values(*one, count) for one in zip(files, chosen, strict=True)]
            yield parts[0][:, places] if block else np.concatenate(parts, axis=1)


def _values(file: Any, member: _Member, rows: int) -> Array:
    """Return the next rows of an array, (k, c)."""
    width = member.shape[1] if len(member.shape) == 2 else 1
    data = file.read(rows * width * member.dtype.itemsize)
    found = np.frombuffer(data, dtype=member.dtype)
    if found.size != rows * width:
        raise EOFError(f"array {member.name!r} ends early")
    return found.reshape(rows, width).astype(np.float64)


_Shape = tuple[tuple[str, ...], int]  # names of the columns, and rows
_PACKED: dict[str, tuple[Callable[[Path], _Shape | None], Callable[..., Iterator[Array]]]] = {
    "parquet": (_parquet_columns, _parquet_blocks),
    "npz": (_npz_columns, _npz_blocks),
    "hdf5": (long_columns, long_blocks),
}
