"""Convert the variables in a MATLAB or HDF5 file to the columns of a table.

A vector of numbers is a column with the same name. In a matrix, samples run along the longer side,
as rows or as columns, and the other side is counted from 1. For example, `acc`, (n, 3) or (3, n),
gives "acc(1)", "acc(2)", "acc(3)". The name of a struct or group precedes a dot, "imu.acc(2)". A
file may also contain parameters. The columns of the recording are therefore those with the length
that most numbers have.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inercal.basics.errors import InputError
from inercal.recordings.io import column_table
from inercal.recordings.io.column_table import Array, Column, ReadRequest, Table

# Reasons why a variable cannot be a column.
OBJECT = "is a MATLAB object (table, string, datetime, …): save its columns as plain arrays"
FUNCTION = "is a function handle, not numbers"
COMPLEX = "contains complex numbers: save real and imaginary parts as two arrays"
SPARSE = "is a sparse matrix: save it with full()"
STRUCTS = "is an array of structs: save a struct of arrays"
CELL = "is a cell array in which not every cell is a single text: save plain arrays"


@dataclass(frozen=True)
class Variable:
    """One array in a file.

    Parameters
    ----------
    name : str
        Name of the array, including the names of the structs or groups around it.
    shape : tuple of int
        Shape as stored; (n,) for text.
    open : function
        Function that returns the array, or an object that can be sliced like it. For text, it
        returns the n entries.
    text : bool
        Whether the variable contains words.
    transposed : bool
        Whether the array is stored with its axes reversed. This decides which axis of a square
        matrix contains the samples.
    chunk : int
        Number of samples that are stored together and must be read at once.
    refused : str
        Reason why the variable is not a column; empty if it is one.
    """

    name: str
    shape: tuple[int, ...] = ()
    open: Callable[[], Any] = lambda: None
    text: bool = False
    transposed: bool = False
    chunk: int = 1
    refused: str = ""

    @property
    def refusal_reason(self) -> str:
        """Reason why the variable contains no column; empty if it contains columns."""
        if self.refused:
            return self.refused
        if 0 in self.shape:
            return "is empty"
        if not 1 <= len(self.shape) <= 2:
            return "is a single number" if not self.shape else f"has {len(self.shape)} axes, not 2"
        if min(self.length, self.width) > column_table.MOST_COLUMNS:
            return f"{self.shape} is not a table"
        return ""

    @property
    def length(self) -> int:
        """Number of samples."""
        return self.shape[self.sample_axis]

    @property
    def width(self) -> int:
        """Number of columns."""
        return int(np.prod(self.shape)) // self.length

    @property
    def sample_axis(self) -> int:
        """Axis along which samples run; 0 if the variable is refused."""
        if len(self.shape) != 2:
            return 0
        first, last = self.shape
        return int(last > first or (last == first and self.transposed))

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the variable's columns."""
        count = self.width
        return (self.name,) if count == 1 else tuple(f"{self.name}({k + 1})" for k in range(count))


def matlab_object(name: str, *, is_function: bool) -> Variable:
    """Return the variable for a function handle or another object of MATLAB, which is refused."""
    return Variable(name, refused=FUNCTION if is_function else OBJECT)


def table_from_variables(path: Path, variables: Sequence[Variable], wanted: ReadRequest) -> Table:
    """Convert the variables in a file to a table.

    Raises
    ------
    InputError
        There is no column, a wanted column is missing or not numeric, or columns differ in length.
    """
    source = path.name
    refused = {v.name: v.refusal_reason for v in variables if v.refusal_reason}
    columns = _columns(variables)
    for name in wanted.names or ():
        _refuse_unusable_variable(name, [name for name, _, _ in columns], refused, source)
    if not columns:
        first = next((f": {name!r} {why}" for name, why in refused.items()), "")
        raise InputError(
            f"{source} has no columns of numbers{first}; save arrays of numbers",
            names=tuple(refused),
        )
    length = _length(columns)
    requested = set(wanted.names or ())
    names = [name for name, v, _ in columns if v.length == length or name in requested]
    chosen = column_table.select_columns(names, wanted.names, source)
    found = {name: (v, k) for name, v, k in columns if name in chosen}
    column_table.refuse_unequal_lengths({name: found[name][0].length for name in chosen}, source)
    read, block = _read([found[name][0] for name in chosen], chosen, wanted, source)
    others = {name: v.length for name, v, _ in columns if name not in names and not v.text}
    digest = column_table.file_sha256(path)
    return Table(tuple(names), read, source, digest, block=block, other_lengths=others)


def number_columns(variables: Sequence[Variable]) -> tuple[tuple[str, ...], int] | None:
    """Return names and length of the recording's columns; None if there are none, or text."""
    columns = _columns(variables)
    if not columns:
        return None
    length = _length(columns)
    own = [(name, v) for name, v, _ in columns if v.length == length]
    return None if any(v.text for _, v in own) else (tuple(name for name, _ in own), length)


def column_blocks(variables: Sequence[Variable], names: Sequence[str]) -> Iterator[Array]:
    """Yield blocks of samples from these columns, (k, c); all of them must contain numbers.

    Parameters
    ----------
    variables : sequence of Variable
    names : sequence of str
        Names from `number_columns`.
    """
    found = {name: (v, k) for name, v, k in _columns(variables) if name in names}
    used = {v.name: v for v, _ in found.values()}
    n = next(iter(used.values())).length
    stored = {name: v.open() for name, v in used.items()}
    for rows in column_table.row_blocks(n, max(_rows_per_read(v) for v in used.values())):
        parts = {name: _rows(v, stored[name], rows) for name, v in used.items()}
        chosen = [parts[found[name][0].name][:, found[name][1]] for name in names]
        yield np.stack(chosen, axis=1).astype(np.float64)


def _columns(variables: Sequence[Variable]) -> list[tuple[str, Variable, int]]:
    """Return each readable column: its name, its variable, and its position in the variable."""
    return [
        (name, v, k) for v in variables if not v.refusal_reason for k, name in enumerate(v.columns)
    ]


def _length(columns: Sequence[tuple[str, Variable, int]]) -> int:
    """Return the length that most numbers share."""
    counted: Counter[int] = Counter()
    for _, v, _ in columns:
        counted[v.length] += v.length
    return max(counted, key=lambda n: (counted[n], n))


def _refuse_unusable_variable(
    name: str, names: Sequence[str], refused: dict[str, str], source: str
) -> None:
    """Refuse a wanted column whose variable contains no columns, and give the reason."""
    if name in names:
        return
    for variable, why in refused.items():
        if name == variable or name.startswith((f"{variable}.", f"{variable}(")):
            raise InputError(f"{source}: {variable!r} {why}", names=(variable,))


def _read(
    variables: Sequence[Variable], chosen: Sequence[str], wanted: ReadRequest, source: str
) -> tuple[dict[str, Column], Array]:
    """Read the chosen columns in blocks of samples; return them by name, and their block."""
    n = variables[0].length
    text = {v.name for v in variables if v.text}
    numbers = [name for name, v in zip(chosen, variables, strict=True) if not v.text]
    blank, block = wanted.empty_columns(n, numbers)
    read: dict[str, Column] = {}
    for variable in {v.name: v for v in variables}.values():
        stored = variable.open()
        if variable.name in text:
            read[variable.name] = column_table.label_array(stored, variable.name, source)
            continue
        kind = stored.dtype
        if kind.kind not in "fiub":
            why = COMPLEX if kind.kind == "c" else f"has the type {kind}, which is not numeric"
            raise InputError(f"{source}: {variable.name!r} {why}", names=(variable.name,))
        places = [(k, name) for k, name in enumerate(variable.columns) if name in blank]
        filled: dict[str, NDArray[Any]] = {
            name: np.empty(n, kind) if name in wanted.whole else blank[name] for _, name in places
        }
        for rows in column_table.row_blocks(n, _rows_per_read(variable)):
            part = _rows(variable, stored, rows)
            for k, name in places:
                filled[name][rows] = part[:, k]
        for _, name in places:
            values = filled[name]
            if name in wanted.whole:
                values = wanted.number_column(name, values)
            read[name] = column_table.whole_number_labels(values) if name in wanted.text else values
    return {name: read[name] for name in chosen}, block


def _rows(variable: Variable, stored: Any, rows: slice) -> NDArray[Any]:
    """Return some samples from all columns of a variable, (k, c)."""
    part: NDArray[Any] = np.asarray(stored[rows] if variable.sample_axis == 0 else stored[:, rows])
    return part.reshape(len(part), -1) if variable.sample_axis == 0 else part.T


def _rows_per_read(variable: Variable) -> int:
    """Return a multiple of the chunk, so that no part of a file is decompressed twice."""
    rows = max(1, 8 * column_table.BLOCK_ROWS // variable.width)
    return -(-rows // variable.chunk) * variable.chunk
