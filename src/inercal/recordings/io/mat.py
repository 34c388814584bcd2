"""Read MATLAB files up to version 7 with SciPy; version 7.3 files are HDF5 (see `hdf5`)."""

from collections.abc import Callable, Iterator
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from inercal.basics.errors import InputError
from inercal.recordings.io import variables
from inercal.recordings.io.column_table import ReadRequest, Table, shorten
from inercal.recordings.io.isolation import Isolation
from inercal.recordings.io.readers import Reader
from inercal.recordings.io.variables import Variable

_NUMBERS = {"double", "single", "logical"} | {
    f"{u}int{b}" for u in ("", "u") for b in (8, 16, 32, 64)
}


def read_mat(path: Path, wanted: ReadRequest) -> Table:
    """Read a table from a MATLAB file of version 4, 6 or 7.

    Parameters
    ----------
    path : Path
        File with vectors and matrices, in structs or not. Cells of text and rows of characters are
        used as labels. See `inercal.recordings.io.variables` for the column names.
    wanted : ReadRequest

    Raises
    ------
    InputError
        The variables do not form a table.
    """
    scipy_io: Any = import_module("scipy.io")
    return variables.table_from_variables(path, _variables(path, scipy_io), wanted)


def _variables(path: Path, scipy_io: Any) -> list[Variable]:
    """Return the variables in a file; numbers outside structs are loaded only when used."""
    options = {"appendmat": False, "spmatrix": False}
    try:
        listed: list[tuple[str, tuple[int, ...], str]] = scipy_io.whosmat(path, appendmat=False)
    except TypeError:  # whosmat does not list a file that contains objects
        loaded: dict[str, Any] = scipy_io.loadmat(path, **options)
        return [v for k, value in loaded.items() if k[:2] != "__" for v in _contents(k, value)]

    def load(name: str) -> Any:
        value = scipy_io.loadmat(path, variable_names=[name], **options)[name]
        if hasattr(value, "tocsc"):  # sparse logical matrices are listed as full matrices
            raise InputError(f"{path.name}: {name!r} {variables.SPARSE}", names=(name,))
        return value

    # Other entries, whose names begin with "__", belong to MATLAB's function workspace.
    return [v for one in listed if one[0][:2] != "__" for v in _variable(*one, load)]


def _variable(
    name: str, shape: tuple[int, ...], kind: str, load: Callable[[str], Any]
) -> Iterator[Variable]:
    """Yield a listed variable, or the variables that it contains."""
    if kind in _NUMBERS:
        yield Variable(name, shape, partial(load, name))
    elif kind == "sparse":
        yield Variable(name, refused=variables.SPARSE)
    elif kind in ("char", "cell", "struct"):
        try:
            yield from _contents(name, load(name))
        except Exception as error:  # SciPy raises many kinds of errors for unreadable content
            yield Variable(name, refused=f"cannot be read: {shorten(str(error), 120)}")
    else:
        yield variables.matlab_object(name, is_function=kind == "function")


def _contents(name: str, value: Any) -> Iterator[Variable]:
    """Yield a value as a variable, or the fields of a struct."""
    kind = type(value).__name__
    if kind == "MatlabOpaque":  # before SciPy 1.18, its name is only stored inside it
        inside = value.size and "s0" in (value.dtype.names or ())
        known = np.ravel(value)[0]["s0"] if inside else name
        name = known.decode() if isinstance(known, bytes) else name
        yield variables.matlab_object(name, is_function=False)
    elif kind in ("MatlabFunction", "MatlabObject"):
        yield variables.matlab_object(name, is_function=kind == "MatlabFunction")
    elif not isinstance(value, np.ndarray):
        yield Variable(
            name, refused=variables.SPARSE if hasattr(value, "tocsc") else "cannot be read"
        )
    else:
        yield from _array(name, cast(NDArray[Any], value))


def _array(name: str, array: NDArray[Any]) -> Iterator[Variable]:
    if array.dtype.names is not None:
        if array.size != 1:
            yield Variable(name, refused=variables.STRUCTS if array.size else "is empty")
            return
        for field in array.dtype.names:
            yield from _contents(f"{name}.{field}", array.flat[0][field])
    elif array.dtype.kind == "O":
        texts = [_text(cell) for cell in array.flat]
        words = [text for text in texts if text is not None]
        refused = "" if len(words) == len(texts) else variables.CELL
        yield Variable(name, (len(texts),), lambda: words, text=True, refused=refused)
    elif array.dtype.kind == "U":
        rows = [str(row).rstrip() for row in array.flat]
        yield Variable(name, (len(rows),), lambda: rows, text=True)
    elif array.dtype.kind == "c":
        yield Variable(name, refused=variables.COMPLEX)
    else:
        yield Variable(name, array.shape, lambda: array)


def _text(cell: Any) -> str | None:
    """Return the text in a cell; None if the cell contains something else."""
    if not hasattr(cell, "dtype") or cell.size > 1:
        return None
    if cell.size == 0:  # '' or []
        return ""
    return str(cell.flat[0]) if cell.dtype.kind == "U" else None


# Versions 5 to 7 have a title and, at byte 124, their version. Version 4 has neither. A file saved
# with -ascii is text.
READER = Reader(
    "mat",
    read_mat,
    content=((0, b"MATLAB 5.0 MAT-file"), (124, b"\0\1IM"), (124, b"\1\0MI")),
    suffixes=(".mat",),
    binary=True,
    isolation=Isolation("a MATLAB file", libraries=("scipy.io",)),
)
