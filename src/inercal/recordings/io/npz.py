"""Read NumPy files: archives of columns or of "data" and "columns", and single arrays."""

import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inercal.basics.errors import InputError
from inercal.recordings.io import column_table
from inercal.recordings.io.column_table import Array, Column, ReadRequest, Table
from inercal.recordings.io.isolation import Isolation
from inercal.recordings.io.readers import Reader

_NPY = b"\x93NUMPY"
_LABEL_BYTES = 4 * column_table.LONGEST_LABEL  # of a NumPy text


def _is_bounded(path: Path) -> bool:
    """Return whether the arrays are not compressed, so that they are no larger than the file."""
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
    except (OSError, ValueError, NotImplementedError, zipfile.BadZipFile):
        return False  # a single array, or damaged
    stored = all(
        one.compress_type == zipfile.ZIP_STORED and one.compress_size == one.file_size
        for one in members
    )
    return stored and sum(one.file_size for one in members) <= path.stat().st_size


def read_npz(path: Path, wanted: ReadRequest) -> Table:
    """Read a table from a .npz file, one array at a time, or from a .npy file.

    Parameters
    ----------
    path : Path
        Archive with arrays (n,) named like the columns, or with "data" (n, k) and "columns" (k,) of
        str; or a single array (n, k), or (n,) of records whose fields are the columns.
    wanted : ReadRequest

    Raises
    ------
    InputError
        The file contains pickled objects, or its arrays do not form a table.
    OSError
        The file cannot be read.
    """
    head = column_table.file_head(path, len(_NPY))
    if head == _NPY:
        return _single_array(path, wanted)
    if not head.startswith(b"PK"):
        zipfile.ZipFile(path).close()  # NumPy would accept other files as arrays
    with np.load(path, allow_pickle=False) as archive:
        names, columns, block = _columns(archive, wanted, path.name)
    return Table(names, columns, path.name, column_table.file_sha256(path), block=block)


def _single_array(path: Path, wanted: ReadRequest) -> Table:
    try:
        array: NDArray[Any] = np.load(path, allow_pickle=False)
    except ValueError as error:
        raise InputError(f"{path.name} is damaged or contains objects; save numbers") from error
    fields = array.dtype.names
    if array.ndim != (2 if fields is None else 1):
        raise InputError(f"{path.name}: the array has the shape {array.shape}; save (n, k)")
    parts = {one: array[one] for one in fields} if fields else dict(enumerate(array.T, 1))
    arrays = {str(name): part for name, part in parts.items()}
    names, columns, block = _columns(arrays, wanted, path.name)
    sha256 = column_table.file_sha256(path)
    return Table(names, columns, path.name, sha256, header=fields is not None, block=block)


def _columns(
    archive: Any, wanted: ReadRequest, source: str
) -> tuple[tuple[str, ...], dict[str, Column], Array]:
    """Return the names of all columns, the wanted columns, and their block."""
    names, arrays = _arrays(archive, wanted, source)
    columns: dict[str, Column] = {}
    lengths: dict[str, int] = {}
    blank: dict[str, Array] = {}
    block = np.empty((0, 0))
    for name, array in arrays:
        column = _column(array, name, name in wanted.text, source)
        lengths[name] = n = column.size
        if len(lengths) == 1:
            blank, block = wanted.empty_columns(n, wanted.block_columns)
        if column.dtype.kind == "U":
            short = column.itemsize <= _LABEL_BYTES
            columns[name] = (
                column if short else column_table.label_array(column.tolist(), name, source)
            )
        elif name not in blank:
            columns[name] = wanted.number_column(name, column)
        elif n == len(block):
            blank[name][:] = column
            columns[name] = blank[name]
    column_table.refuse_unequal_lengths(lengths, source)
    if not any(lengths.values()):
        raise InputError(f"{source} has no rows: record or export it again")
    return names, columns, block


def _arrays(
    archive: Any, wanted: ReadRequest, source: str
) -> tuple[tuple[str, ...], Iterator[tuple[str, NDArray[Any]]]]:
    """Return the names of all columns, and the wanted columns with arrays that are read in turn."""
    if not {"data", "columns"} <= set(archive):
        names = tuple(archive)
        chosen = column_table.select_columns(names, wanted.names, source)
        return names, ((name, _array(archive, name, source)) for name in chosen)
    data, titles = _array(archive, "data", source), _array(archive, "columns", source)
    if data.ndim != 2 or titles.shape != data.shape[1:]:
        raise InputError(
            f"{source}: 'data' has the shape {data.shape} and 'columns' {titles.shape}; save "
            "(n, k) and (k,)",
            names=("data", "columns"),
        )
    names = tuple(str(title) for title in titles)
    chosen = column_table.select_columns(names, wanted.names, source)
    return names, ((name, data[:, names.index(name)]) for name in chosen)


def _array(archive: Any, name: str, source: str) -> NDArray[Any]:
    try:
        array: NDArray[Any] | bytes = archive[name]
    except ValueError as error:  # NumPy raises it for pickled objects and for broken headers
        text = "is damaged or contains objects; save plain numbers"
        raise column_table.column_error(source, name, text, "array") from error
    if isinstance(array, bytes):  # NumPy returns members that are not arrays as bytes
        raise InputError(
            f"{source}: {name!r} is not an array; if the file is a workbook, save it as CSV",
            names=(name,),
        )
    return array


def _column(array: NDArray[Any], name: str, as_text: bool, source: str) -> NDArray[Any]:
    """Return a column: numbers unchanged, text as str."""
    if array.ndim != 1:
        text = (
            f"has the shape {array.shape}; save each column as an array (n,) with its name, or "
            "this array alone with numpy.save"
        )
        raise column_table.column_error(source, name, text, "array")
    if as_text and array.dtype.kind in "iub":
        return array.astype(np.str_)
    if array.dtype.kind not in "fiubU":
        text = f"has the type {array.dtype}; save real numbers or text"
        raise column_table.column_error(source, name, text, "array")
    return array


READER = Reader(
    "npz",
    read_npz,
    content=((0, b"PK\x03\x04"), (0, _NPY)),
    suffixes=(".npz",),
    isolation=Isolation("an .npz or .npy file", is_bounded=_is_bounded),
)
