"""Store a table from a file as named columns, without any knowledge of the sensor.

A table from a text file knows the line numbers of its rows, because the file may also contain lines
without samples.
"""

import hashlib
import os
import re
from bisect import bisect_right
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from fractions import Fraction
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError

LineBreaks = tuple[tuple[int, int], ...]
"""Row and line number of row 0 and of each row that follows lines without samples."""


def line_of_row(row: int, first_line: int, breaks: LineBreaks) -> int | None:
    """Return a row's line number, from the line of row 0 or from the last row after a gap.

    >>> [line_of_row(k, 0, ((0, 2), (3, 9))) for k in range(5)]
    [2, 3, 4, 9, 10]
    """
    if first_line:
        return first_line + row
    if not breaks:
        return None
    start, line = breaks[bisect_right(breaks, row, key=lambda one: one[0]) - 1]
    return line + row - start


Column = Array | NDArray[np.int64] | NDArray[np.str_]
_LOCAL_DATE = re.compile(r"\s*\d{1,2}([./-])\d{1,2}\1\d{2,4}\b")  # 23.11.2026
DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+([eE][-+]?\d+)?")
MIXED_MARKS = (
    "write only decimal points, or only decimal commas with semicolons between the columns, and no "
    "separator of thousands"
)
_MAX_LISTED_NAMES = 12  # names in a message before it ends in "…"
MOST_COLUMNS = 1000  # a table with more is transposed, or junk that happens to parse
LONGEST_LABEL = 200  # characters; a text column contains one word per sample, not prose
TOO_LARGE = 1e100  # larger than any reading in any unit; squares and sums would overflow
_LARGEST_INT64 = np.iinfo(np.int64).max
BLOCK_ROWS = 1 << 16  # rows processed at a time: a few MB


@dataclass(frozen=True)
class ReadRequest:
    """The parts of a file that are to be read.

    Parameters
    ----------
    names : collection of str or None
        Columns to read; None for all columns.
    text : collection of str
        Columns to return as text even if they look like numbers (labels 1, 2, 3).
    block_columns : tuple of str
        Columns with numbers, all in `names`, to store side by side in `Table.block`.
    spare_columns : int
        Number of additional columns in the block, which the caller fills.
    whole : collection of str
        Columns to return as int64 if the file contains whole numbers: time stamps since 1970 in ns
        have more digits than float64 can represent.
    """

    names: Collection[str] | None = None
    text: Collection[str] = ()
    block_columns: tuple[str, ...] = ()
    spare_columns: int = 0
    whole: Collection[str] = ()

    def empty_columns(self, n: int, numbers: Collection[str]) -> tuple[dict[str, Array], Array]:
        """Return empty number columns, each (n,), and the block, (n, k)."""
        block = np.empty((n, len(self.block_columns) + self.spare_columns))
        columns: dict[str, Array] = {}
        for name in numbers:
            within = name in self.block_columns
            columns[name] = block[:, self.block_columns.index(name)] if within else np.empty(n)
        return columns, block

    def number_column(self, name: str, values: NDArray[Any]) -> Array | NDArray[np.int64]:
        """Return numbers, (n,), as float64, or as int64 if whole numbers must stay exact.

        >>> ReadRequest(whole=("t",)).number_column("t", np.array([3, 4], np.uint16))
        array([3, 4])
        """
        kind = values.dtype.kind if name in self.whole else "f"
        if kind == "i" or (kind == "u" and not (values > _LARGEST_INT64).any()):
            return np.ascontiguousarray(values, dtype=np.int64)
        return np.ascontiguousarray(values, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Table:
    """Columns from one file.

    Parameters
    ----------
    names : tuple of str
        Names of all columns in the file; "1", "2", ... if it has no header.
    columns : dict of str to (n,) array
        The requested columns as float64 or str, or as int64 if requested.
    source, sha256 : str
        Name of the file and the hash of its bytes.
    first_line : int
        Line of row 0; 0 if rows do not correspond to lines one by one.
    line_breaks : tuple of (row, line)
        If first_line is 0: row 0 and all rows that are not on the line after the preceding row.
        Empty if the lines are unknown.
    header : bool
        Whether the file has a header with column names.
    block : (n, k) array or None
        The block columns and the spare columns of the request; `columns` contains views of this
        array.
    kept_corrections : str
        Corrections that another program has already applied to the block columns, in words; empty
        if none are known.
    devices : str
        The sensors from which the block columns come, with the numbers that their controller gave
        them; empty if unknown.
    simulation : str
        The simulation that produced the recording; empty if the file does not state one.
    time_zero : Fraction or None
        Time 0 of the time column on the clock of a message log, ns. None for other files, in which
        the columns contain clock readings.
    other_lengths : mapping of str to int
        Lengths of the columns of numbers that do not have the usual length, by name.
    """

    names: tuple[str, ...]
    columns: dict[str, Column]
    source: str
    sha256: str
    first_line: int = 0
    header: bool = True
    block: Array | None = None
    kept_corrections: str = ""
    line_breaks: LineBreaks = ()
    devices: str = ""
    time_zero: Fraction | None = None
    simulation: str = ""
    other_lengths: Mapping[str, int] = field(default_factory=dict[str, int])

    def __getstate__(self) -> dict[str, Any]:
        """Return the attributes for pickling; views of the block are stored as column numbers."""
        block = self.block
        columns = {
            name: column
            if block is None or column.base is not block
            else (column.ctypes.data - block.ctypes.data) // block.itemsize
            for name, column in self.columns.items()
        }
        return vars(self) | {"columns": columns}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the attributes of a pickled table."""
        vars(self).update(state)
        for name, column in self.columns.items():
            if isinstance(column, int) and self.block is not None:
                self.columns[name] = self.block[:, column]

    @property
    def rows(self) -> int:
        """Number of rows."""
        return next(iter(self.columns.values())).size

    def stack(self, names: Iterable[str]) -> Array:
        """Return columns of numbers side by side, (n, k)."""
        return np.stack([self.numbers(name) for name in names], axis=-1)

    def line(self, row: int) -> int | None:
        """Return the line of a row, which is counted from 0; None if unknown."""
        return line_of_row(row, self.first_line, self.line_breaks)

    def place(self, row: int) -> str:
        """Describe where a row is, by its line if this is known, otherwise by its number from 1."""
        line = self.line(row)
        return f"row {row + 1}" if line is None else f"line {line}"

    def cell_error(self, path: Path, row: int, name: str, text: str) -> InputError:
        """Return the error for a cell: "means.csv line 3: column 'ax' …"."""
        where = f"{path} {self.place(row)}"
        message = f"{where}: column {name!r} {text}"
        return InputError(message, file=path, line=self.line(row), names=(name,))

    def numbers(self, name: str) -> Array:
        """Return a column of numbers, (n,), as float64.

        Raises
        ------
        InputError
            The column contains text.
        """
        return self.stamps(name).astype(np.float64, copy=False)

    def stamps(self, name: str) -> Array | NDArray[np.int64]:
        """Return a column of numbers, (n,), keeping whole numbers as integers.

        Raises
        ------
        InputError
            The column contains text.
        """
        column = self.columns[name]
        if column.dtype.kind == "U":
            first, advice = str(column[0]), "name another column, or correct the file"
            if DECIMAL_COMMA.fullmatch(first):
                advice = MIXED_MARKS
            elif _LOCAL_DATE.match(first):
                advice = "write times as in ISO 8601, such as 2026-11-23T03:10:09.123"
            raise InputError(
                f"{self.source}: column {name!r} contains text ({shorten(first)}) "
                f"where numbers are needed; {advice}",
                file=self.source,
                names=(name,),
            )
        return cast("Array | NDArray[np.int64]", column)


def row_blocks(n: int, rows: int = BLOCK_ROWS) -> Iterator[slice]:
    """Divide n rows into slices.

    >>> [(k.start, k.stop) for k in row_blocks(5, 2)]
    [(0, 2), (2, 4), (4, 5)]
    """
    return (slice(k, min(k + rows, n)) for k in range(0, n, rows))


def refuse_unequal_lengths(lengths: Mapping[str, int], source: str) -> None:
    """Raise InputError if columns differ in length."""
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{name} {n}" for name, n in lengths.items())
        raise InputError(
            f"{source} has columns of unequal length: {shorten(listed, 120)}; make them equally "
            "long",
            names=tuple(lengths),
        )


def select_columns(names: Sequence[str], wanted: Collection[str] | None, source: str) -> list[str]:
    """Return the wanted columns; all columns for None.

    Raises
    ------
    InputError
        There are too many columns, two have the same name, or a wanted column is missing.
    """
    refuse_too_many_columns(len(names), source)
    for name, count in Counter(names).items():
        if count > 1:
            raise InputError(
                f"{source} has {count} columns {shorten(name)!r}: rename all but one", names=(name,)
            )
    if wanted is None:
        return list(names)
    for name in wanted:
        if name not in names:
            raise InputError(
                f"{source} has no column {name!r}; {_suggest(name, names)}", names=(name,)
            )
    return list(dict.fromkeys(wanted))


def refuse_too_many_columns(columns: int, source: str) -> None:
    """Raise InputError if there are more columns than any recording has."""
    if columns > MOST_COLUMNS:
        raise InputError(
            f"{source} has {columns} columns, but at most {MOST_COLUMNS} can be read: write "
            "each sample as a row"
        )


def _suggest(name: str, names: Sequence[str]) -> str:
    """Return a text that suggests columns with similar names and then lists the columns."""
    by_lower = {known.lower(): known for known in names}
    near = [by_lower[k] for k in get_close_matches(name.lower(), list(by_lower), n=3)]
    hint = f"did you mean {' or '.join(repr(k) for k in near)}? " if near else ""
    listed = ", ".join(shorten(known) for known in names[:_MAX_LISTED_NAMES])
    it = "It" if hint else "it"
    return f"{hint}{it} has {listed}" + (
        f", … ({len(names)} in all)" if names[_MAX_LISTED_NAMES:] else ""
    )


def shorten(text: str, length: int = 40) -> str:
    """Shorten a text to fit into one line of a message."""
    cut = len(text) > length
    text = " ".join("".join(c if c.isprintable() else " " for c in text[:length]).split())
    return text[: length - 1].rstrip(" ,;") + "…" if cut else text


def column_error(source: str, name: str, text: str, kind: str = "column") -> InputError:
    """Return the error for a column of a file: "log.npz: column 'ax' …"."""
    return InputError(f"{source}: {kind} {name!r} {text}", names=(name,))


def label_array(values: Sequence[str], column: str, source: str) -> NDArray[np.str_]:
    """Return a column of text, (n,) of str.

    Raises
    ------
    InputError
        An entry is too long for a label; NumPy would give every row the width of the longest entry.
    """
    longest = max(values, key=len, default="")
    if len(longest) > LONGEST_LABEL:
        text = (
            f"has a text of {len(longest)} characters ({shorten(longest)}), but a label may have "
            f"at most {LONGEST_LABEL}; name another column"
        )
        raise column_error(source, column, text)
    return np.array(values, dtype=np.str_)


def whole_number_labels(values: NDArray[Any]) -> Column:
    """Convert whole numbers, such as mode numbers, to labels; return other values unchanged."""
    whole = np.isfinite(values).all() and (values == np.round(values)).all()
    return values.astype(np.int64).astype(np.str_) if whole else values


def file_head(path: Path, size: int) -> bytes:
    """Return the first bytes of a file; fewer if the file is shorter."""
    with path.open("rb") as file:
        return file.read(size)


def file_sha256(path: Path) -> str:
    """Return the SHA-256 of a file's bytes, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def open_error(path: str | os.PathLike[str], error: OSError) -> InputError:
    """Return the error for a file that cannot be opened or read."""
    why = "no such file; check the path"
    if not isinstance(error, FileNotFoundError):
        why = f"cannot be read: {error.strerror or error}"
    return InputError(f"{path}: {why}", file=Path(os.fspath(path)))
