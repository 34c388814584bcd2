"""Read Excel workbooks (.xlsx) row by row with openpyxl.

The column names come from the first row of words that is followed by rows of numbers. The rows
above it, such as a title or the logger's settings, are skipped. Formulas are read as their saved
values.
"""

from array import array
from collections.abc import Iterator, Sequence
from contextlib import closing
from datetime import datetime
from importlib import import_module
from itertools import chain, islice, pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from inercal.basics.errors import InputError
from inercal.recordings.io import column_table
from inercal.recordings.io.column_table import Column, ReadRequest, Table, shorten
from inercal.recordings.io.isolation import Isolation
from inercal.recordings.io.readers import Option, Reader

_SNIFFED_ROWS = 100
_MOST_ROWS = 1 << 20
_OLD, _OPEN_DOCUMENT = b"\xd0\xcf\x11\xe0", b"mimetype"  # .xls at 0, .ods at 30

Cell = float | str | None


class _Heading(NamedTuple):
    names: tuple[str, ...]
    texts: frozenset[int]  # columns whose first cell is a word
    skipped: int  # number of non-empty rows above the data
    header: bool


def read_xlsx(path: Path, wanted: ReadRequest, sheet: str | int = 1) -> Table:
    """Read a sheet from an Excel workbook.

    Parameters
    ----------
    path : Path
    wanted : ReadRequest
    sheet : str or int
        Name of the sheet, or its number from 1.

    Raises
    ------
    InputError
        The workbook is damaged, a sheet or column is missing, or a cell is not a number.
    OSError
        The file cannot be read.
    """
    _refuse_other_sheets(path)
    openpyxl: Any = import_module("openpyxl")
    with path.open("rb") as file:
        book = openpyxl.load_workbook(file, read_only=True, data_only=True, keep_links=False)
        with closing(book):
            return _table(path, _rows(_sheet(path.name, book, sheet)), wanted)


def _refuse_other_sheets(path: Path) -> None:
    """Refuse spreadsheets from other programs and from Excel before 2007."""
    head = column_table.file_head(path, 40)
    if head.startswith(_OLD) or head[30:].startswith(_OPEN_DOCUMENT):
        kind = "from Excel before 2007" if head.startswith(_OLD) else "an OpenDocument sheet"
        raise InputError(f"{path.name} is {kind}: save it as .xlsx or as CSV")


def _sheet(source: str, book: Any, sheet: str | int) -> Any:
    names: list[str] = [one.title for one in book.worksheets]
    if isinstance(sheet, int) and 1 <= sheet <= len(names):
        return book.worksheets[sheet - 1]
    if sheet in names:
        return book.worksheets[names.index(str(sheet))]
    raise InputError(
        f"{source} has no sheet {sheet!r}; it has {', '.join(map(shorten, names[:12]))}",
        key="[data] sheet",
    )


def _rows(sheet: Any) -> Iterator[tuple[int, list[Cell]]]:
    """Yield the number and the cells of each row that is not empty."""
    # A workbook may state a size of 10^10 cells, so read rows only up to their actual end.
    sheet.reset_dimensions()
    for number, row in enumerate(sheet.iter_rows(values_only=True), 1):
        if number > _MOST_ROWS:  # openpyxl would fill a gap before this row for hours
            raise InputError(
                f"sheet {sheet.title!r} has a row beyond {_MOST_ROWS}, Excel's last row; "
                "the workbook is damaged: save it again"
            )
        cells = [_cell(value) for value in row]
        while cells and cells[-1] is None:
            cells.pop()
        if cells:
            column_table.refuse_too_many_columns(len(cells), f"sheet {sheet.title!r}")
            yield number, cells


def _cell(value: object) -> Cell:
    """Return a number, a text, or None for an empty cell."""
    if isinstance(value, bool | int | float):
        return float(value)
    if isinstance(value, datetime):
        return value.isoformat()
    text = "" if value is None else str(value).strip()
    try:
        return float(text)
    except ValueError:
        return text or None


def _table(path: Path, rows: Iterator[tuple[int, list[Cell]]], wanted: ReadRequest) -> Table:
    """Convert the rows of a sheet to a table."""
    source = path.name
    first = list(islice(rows, _SNIFFED_ROWS))
    heading = _heading(source, [cells for _, cells in first])
    names = heading.names
    chosen = column_table.select_columns(names, wanted.names, source)
    at = {name: names.index(name) for name in chosen}
    texts = {name for name in chosen if at[name] in heading.texts or name in wanted.text}
    words: dict[str, list[str]] = {name: [] for name in chosen if name in texts}
    numbers = {name: array("d") for name in chosen if name not in texts}
    lines: list[int] = []
    for line, cells in chain(first[heading.skipped :], rows):
        _add(source, line, cells, at, words, numbers)
        lines.append(line)
    blank, block = wanted.empty_columns(len(lines), list(numbers))
    columns: dict[str, Column] = {}
    for name in chosen:
        if name in words:
            columns[name] = column_table.label_array(words[name], name, source)
        else:
            blank[name][:] = np.frombuffer(numbers[name])
            columns[name] = blank[name]
    first_line = lines[0] if lines[-1] - lines[0] + 1 == len(lines) else 0
    sha256 = column_table.file_sha256(path)
    return Table(names, columns, source, sha256, first_line, heading.header, block=block)


def _add(
    source: str,
    line: int,
    cells: Sequence[Cell],
    at: dict[str, int],
    words: dict[str, list[str]],
    numbers: "dict[str, array[float]]",
) -> None:
    """Add the cells of a row to their columns; an empty cell becomes NaN or an empty text."""
    for name, texts in words.items():
        cell = cells[at[name]] if at[name] < len(cells) else None
        whole = isinstance(cell, float) and cell.is_integer()
        texts.append("" if cell is None else str(int(cell)) if whole else str(cell))
    for name, values in numbers.items():
        cell = cells[at[name]] if at[name] < len(cells) else None
        if isinstance(cell, str):
            raise InputError(
                f"{source} line {line}, column {shorten(name)!r}: {shorten(cell)!r} is not a "
                "number; correct the cell or remove the row",
                line=line,
                names=(name,),
            )
        values.append(np.nan if cell is None else cell)


def _heading(source: str, rows: Sequence[Sequence[Cell]]) -> _Heading:
    """Return the column names, from the first row of words that is followed by numbers."""
    for k, (cells, below) in enumerate(pairwise(rows)):
        worded = [cell for cell in cells if isinstance(cell, str)]
        numbers = sum(isinstance(cell, float) for cell in below)
        if len(worded) == len(cells) and numbers and len(below) == len(cells):
            texts = frozenset(j for j, cell in enumerate(below) if isinstance(cell, str))
            return _Heading(tuple(worded), texts, k + 1, header=True)
    width = len(rows[0]) if rows else 0
    if not any(isinstance(cell, float) for row in rows for cell in row):
        raise InputError(f"{source} has no row of numbers: save a sheet with one sample per row")
    if any(len(row) != width for row in rows):
        raise InputError(
            f"{source} has no row of names above its numbers: write a name above each column"
        )
    texts = frozenset(j for j, cell in enumerate(rows[0]) if isinstance(cell, str))
    return _Heading(tuple(str(j + 1) for j in range(width)), texts, 0, header=False)


# The name of the first file in the archive distinguishes a workbook from a .npz archive.
READER = Reader(
    "xlsx",
    read_xlsx,
    content=(
        *((30, name) for name in (b"[Content_Types].xml", b"docProps/", b"_rels/", b"xl/")),
        (30, _OPEN_DOCUMENT),
        (0, _OLD),
    ),
    suffixes=(".xlsx", ".xlsm"),
    options=(Option("sheet", str | int, 1, "name of the sheet, or its number from 1"),),
    isolation=Isolation("an Excel workbook", "save it again", ("openpyxl",), "excel"),
)
