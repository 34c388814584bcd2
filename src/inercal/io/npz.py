"""NumPy archives: one array a column, or one array "data" with its "columns"."""

import struct
import zipfile
import zlib
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inercal.errors import InputError
from inercal.io.table import Column, Table, as_labels, sha256_of, shortened, wanted_columns

# What the standard library and NumPy raise on archives whose bytes were changed.
_DAMAGED = (
    zipfile.BadZipFile,
    zlib.error,
    struct.error,
    EOFError,
    ValueError,
    RuntimeError,
    OverflowError,
    MemoryError,
    OSError,
)


def read_npz(
    path: Path, wanted: Collection[str] | None = None, text: Collection[str] = ()
) -> Table:
    """Read a table from a .npz file.

    Parameters
    ----------
    path : Path
        Arrays (n,) by name of the column; or "data" (n, k) with "columns" (k,) of str.
    wanted, text
        See `inercal.io.text.read_text`.

    Raises
    ------
    InputError
        A damaged archive, pickled objects, or arrays that do not form a table.
    OSError
        The file cannot be read.
    """
    # NumPy would leave a file that it opened itself open after an error.
    with path.open("rb") as file:
        try:
            zipfile.ZipFile(file).close()
            file.seek(0)
            with np.load(file, allow_pickle=False) as archive:
                names, arrays = _arrays(archive, wanted, path.name)
        except _DAMAGED as error:
            raise InputError(
                f"{path.name} is no .npz archive or is damaged: {shortened(str(error), 120)}"
            ) from error
    columns = {name: _column(a, name, name in text, path.name) for name, a in arrays.items()}
    lengths = {name: column.size for name, column in columns.items()}
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{name} {n}" for name, n in lengths.items())
        raise InputError(f"{path.name} has columns of unequal length: {shortened(listed, 120)}")
    if not any(lengths.values()):
        raise InputError(f"{path.name} has no rows")
    return Table(names, columns, path.name, sha256_of(path), 0, header=True)


def _arrays(
    archive: Any, wanted: Collection[str] | None, source: str
) -> tuple[tuple[str, ...], dict[str, NDArray[Any]]]:
    """Return the names of all columns, and the arrays of those wanted."""
    if not {"data", "columns"} <= set(archive.files):
        names = tuple(archive.files)
        chosen = wanted_columns(names, wanted, source)
        return names, {name: _array(archive, name, source) for name in chosen}
    data, titles = _array(archive, "data", source), _array(archive, "columns", source)
    if data.ndim != 2 or titles.shape != data.shape[1:]:
        raise InputError(
            f"{source}: 'data' {data.shape} needs (n, k) and 'columns' {titles.shape} (k,)"
        )
    names = tuple(str(title) for title in titles)
    chosen = wanted_columns(names, wanted, source)
    return names, {name: data[:, names.index(name)] for name in chosen}


def _array(archive: Any, name: str, source: str) -> NDArray[Any]:
    try:
        array: NDArray[Any] | bytes = archive[name]
    except ValueError as error:  # what NumPy raises for pickled objects and for broken headers
        raise InputError(
            f"{source}: array {name!r} is damaged or holds objects; save plain numbers"
        ) from error
    if isinstance(array, bytes):  # how NumPy hands out members that are no arrays
        raise InputError(f"{source}: {name!r} is no array; is it a workbook? Save it as CSV")
    return array


def _column(array: NDArray[Any], name: str, as_text: bool, source: str) -> Column:
    if array.ndim != 1:
        raise InputError(f"{source}: array {name!r} {array.shape} is no column (n,)")
    if array.dtype.kind == "U" or (as_text and array.dtype.kind in "iub"):
        return as_labels([str(value) for value in array.tolist()], name, source)
    if array.dtype.kind not in "fiub":
        raise InputError(f"{source}: array {name!r} of {array.dtype} is neither numbers nor text")
    return np.ascontiguousarray(array, dtype=np.float64)
