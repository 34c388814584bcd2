"""Read HDF5 files, including MATLAB files of version 7.3, with h5py."""

from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.recordings.io import variables
from inercal.recordings.io.column_table import ReadRequest, Table
from inercal.recordings.io.isolation import Isolation
from inercal.recordings.io.readers import Reader
from inercal.recordings.io.variables import Variable

ELSEWHERE = "is stored outside this file or assembled from others: save its values in this file"
_FUNCTION = "function_handle"  # class of function handles in MATLAB
_MOST_PACKED = 1100  # largest compression ratio; deflate reaches 1032


def read_hdf5(path: Path, wanted: ReadRequest) -> Table:
    """Read a table from an HDF5 file or a MATLAB file of version 7.3, in blocks of samples.

    Parameters
    ----------
    path : Path
        File with data sets (n,), (n, k) or (k, n), in groups or not; text is used as labels. See
        `inercal.recordings.io.variables` for the column names. Links to other files are not
        followed.
    wanted : ReadRequest

    Raises
    ------
    InputError
        The variables do not form a table.
    """
    with _opened(path) as found:
        return variables.table_from_variables(path, found, wanted)


def long_columns(path: Path) -> tuple[tuple[str, ...], int] | None:
    """Return the names and the length of a file's number columns.

    Return None if one of them is text.
    """
    with _opened(path) as found:
        return variables.number_columns(found)


def long_blocks(path: Path, names: Sequence[str]) -> Iterator[Array]:
    """Yield blocks of samples from some columns, (k, c).

    Parameters
    ----------
    path : Path
    names : sequence of str
        Names from `long_columns`.
    """
    with _opened(path) as found:
        yield from variables.column_blocks(found, names)


@contextmanager
def _opened(path: Path) -> Generator[list[Variable]]:
    """Open a file and yield its variables, whose numbers can be read within the block."""
    h5py: Any = import_module("h5py")
    with h5py.File(path, "r") as file:
        yield list(_variables(h5py, file, "", set()))


class Group(NamedTuple):
    """Attributes and arrays from one group of an HDF5 file."""

    attributes: dict[str, object]
    arrays: dict[str, Array]


def read_group(path: Path, group: str, names: Sequence[str]) -> Group:
    """Return the attributes of a group, and those of the named arrays in it.

    If the file does not have the group, both are empty.

    Parameters
    ----------
    path : Path
    group : str
    names : sequence of str
        Names of numeric data sets.
    """
    h5py: Any = import_module("h5py")
    with h5py.File(path, "r") as file:
        linked = file.get(group, getlink=True)
        found: Any = file[group] if isinstance(linked, h5py.HardLink) else None
        if not isinstance(found, h5py.Group):
            return Group({}, {})
        attributes = {
            str(name): value.item() if hasattr(value, "item") and value.size == 1 else value
            for name, value in found.attrs.items()
        }
        there = [
            name
            for name in names
            if isinstance(found.get(name, getlink=True), h5py.HardLink)
            and isinstance(found[name], h5py.Dataset)
            and found[name].dtype.kind == "f"
            and not (found[name].external or found[name].is_virtual)
        ]
        return Group(attributes, {name: np.asarray(found[name][()], float) for name in there})


def _variables(h5py: Any, group: Any, before: str, seen: set[int]) -> Iterator[Variable]:
    """Yield the data sets in a group and its subgroups; visit each group once."""
    for key in group:
        # MATLAB stores the contents of cells and objects in groups named #refs#, #subsystem#.
        if key.startswith("#") or not isinstance(group.get(key, getlink=True), h5py.HardLink):
            continue
        item, name = group[key], before + key
        kind = _matlab_class(item)
        if isinstance(item, h5py.Dataset):
            yield _variable(h5py, item, name, kind)
        elif isinstance(item, h5py.Group):
            address = h5py.h5o.get_info(item.id).addr
            if "MATLAB_sparse" in item.attrs:
                yield Variable(name, refused=variables.SPARSE)
            elif kind not in ("", "struct"):
                yield variables.matlab_object(name, is_function=kind == _FUNCTION)
            elif address not in seen:
                seen.add(address)
                yield from _variables(h5py, item, f"{name}.", seen)


def _matlab_class(item: Any) -> str:
    """Return the class that MATLAB states; empty if another program wrote the item."""
    kind = item.attrs.get("MATLAB_class", b"")
    return kind.decode("latin-1") if isinstance(kind, bytes) else str(kind)


def _variable(h5py: Any, data: Any, name: str, kind: str) -> Variable:
    """Return a data set as a variable."""
    if "MATLAB_object_decode" in data.attrs or kind == _FUNCTION:
        return variables.matlab_object(name, is_function=kind == _FUNCTION)
    if not data.size or "MATLAB_empty" in data.attrs:
        return Variable(name, refused="is empty")
    if data.external or data.is_virtual:
        return Variable(name, refused=ELSEWHERE)
    if data.size * data.dtype.itemsize > _MOST_PACKED * data.id.get_storage_size():
        return Variable(name, refused=f"{data.shape} is not stored completely in the file")
    if h5py.check_ref_dtype(data.dtype) is not None:
        if kind != "cell":
            return Variable(name, refused=variables.STRUCTS)
        first = data.file[data[(0,) * data.ndim]]
        refused = "" if _matlab_class(first) == "char" else variables.CELL
        return Variable(name, (data.size,), partial(_cell_texts, data), text=True, refused=refused)
    if kind == "char":
        return Variable(name, (data.shape[-1],), partial(_character_rows, data), text=True)
    if h5py.check_string_dtype(data.dtype) is not None:
        return Variable(name, (data.size,), partial(_texts, data), text=True)
    if data.dtype.names == ("real", "imag") or data.dtype.kind == "c":
        return Variable(name, refused=variables.COMPLEX)
    if data.dtype.kind not in "fiub":
        return Variable(name, refused=f"has the type {data.dtype}, neither numbers nor text")
    plain = Variable(name, data.shape, lambda: data, transposed=kind != "")
    return replace(plain, chunk=data.chunks[plain.sample_axis]) if data.chunks else plain


def _texts(data: Any) -> list[str]:
    """Return the texts in a data set."""
    return [str(one) for one in np.ravel(data.asstr()[()])]


def _character_rows(data: Any) -> list[str]:
    """Return the rows of a character matrix, which MATLAB stores in columns of UTF-16."""
    codes = np.atleast_2d(np.asarray(data[()], dtype="<u2")).T
    return [row.tobytes().decode("utf-16-le", "replace").rstrip() for row in codes]


def _cell_texts(data: Any) -> list[str]:
    """Return the texts to which the cells refer."""
    texts: list[str] = []
    for reference in data[()].flat:
        cell = data.file[reference]
        if "MATLAB_empty" in cell.attrs:
            texts.append("")
        elif _matlab_class(cell) == "char" and cell.shape[-1] == 1:
            texts += _character_rows(cell)
        else:
            name = data.name[1:]
            raise InputError(
                f"{Path(data.file.filename).name}: {name!r} {variables.CELL}", names=(name,)
            )
    return texts


ISOLATION = Isolation("an HDF5 file", libraries=("h5py",), extra="io")
# At byte 124, a MATLAB file of version 7.3 states its version, and IM or MI for the byte order.
READER = Reader(
    "hdf5",
    read_hdf5,
    content=((0, b"\x89HDF"), (124, b"\0\2IM"), (124, b"\2\0MI")),
    suffixes=(".h5", ".hdf5"),
    isolation=ISOLATION,
)
