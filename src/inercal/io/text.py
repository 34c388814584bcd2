"""CSV, tab, semicolon and white-space separated text.

NumPy's C parser reads the numbers. Only when it fails does Python go over the lines, to name the
line, the column and the text that are wrong.
"""

import re
from collections.abc import Collection, Iterator
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from inercal.errors import InputError
from inercal.io.layout import Layout, columns, sniff
from inercal.io.scan import scan
from inercal.io.table import Column, Table, as_labels, shortened, wanted_columns

_LAST_LINE = "the file may be truncated: remove the line or record again"


def read_text(
    path: Path, wanted: Collection[str] | None = None, text: Collection[str] = ()
) -> Table:
    """Read a table of text.

    Parameters
    ----------
    path : Path
        UTF-8 text, any line ends, comments after # or %, with or without a header.
    wanted : collection of str or None
        Columns to return; None for all. Others are counted and not read.
    text : collection of str
        Columns to return as text even where they look like numbers (labels 1, 2, 3).

    Raises
    ------
    InputError
        What is wrong, with its line: see the module, `scan` and `layout`.
    OSError
        The file cannot be read.
    """
    found = scan(path)
    layout = sniff(path)
    names = wanted_columns(layout.names, wanted, path.name)
    words = {k for k, name in enumerate(layout.names) if name in names} & (
        layout.words | {k for k, name in enumerate(layout.names) if name in text}
    )
    numbers = {k for k, name in enumerate(layout.names) if name in names} - words
    rows = _load(path, layout, numbers, words, last_line=found.lines)
    read: dict[str, Column] = {}
    for name in names:
        k = layout.names.index(name)
        column = rows[str(k)]
        read[name] = (
            as_labels([cell.strip() for cell in column.tolist()], name, path.name)
            if k in words
            else np.ascontiguousarray(column)
        )
    # Comments and blank lines amid the data put rows out of step with lines.
    in_step = layout.first_line + rows.size - 1 == found.lines
    if not in_step:
        _refuse_swallowed_lines(path, layout, rows.size)
    first_line = layout.first_line if in_step else 0
    return Table(layout.names, read, path.name, found.sha256, first_line, layout.header)


def _load(
    path: Path, layout: Layout, numbers: set[int], words: set[int], *, last_line: int
) -> NDArray[np.void]:
    """Return all rows as one structured array; columns that nobody wants as single letters."""
    kinds = {k: "f8" if k in numbers else "O" if k in words else "U1" for k in _range(layout)}
    dtype = np.dtype([(str(k), kind) for k, kind in kinds.items()])
    quote = '"' if layout.quoted or words else None

    def parse(fill: set[int]) -> NDArray[np.void]:
        with path.open(encoding="utf-8-sig") as file:
            return np.loadtxt(
                _lines(file, layout, fill),
                dtype=dtype,
                delimiter=layout.delimiter,
                comments=layout.comment,
                quotechar=quote,
                ndmin=1,
            )

    try:
        return parse(fill=set())
    except ValueError as error:
        near = re.search(r"at row (\d+)", str(error))
        # The parser's count of rows is only a hint: where to look first.
        for skip in (int(near[1]) - 2 if near else 0, 0):
            if _only_empty_cells(path, layout, numbers, skip, last_line):
                break
        else:
            raise InputError(f"{path.name}: {shortened(str(error), 120)}") from error
    try:
        return parse(fill=numbers)
    except ValueError as error:
        raise InputError(f"{path.name}: {shortened(str(error), 120)}") from error


def _range(layout: Layout) -> range:
    return range(len(layout.names))


def _lines(file: Iterator[str], layout: Layout, fill: set[int]) -> Iterator[str]:
    """Return the lines of data as the parser needs them: decimal points, nothing empty."""
    lines = islice(file, layout.first_line - 1, None)
    if layout.decimal_comma:
        lines = (line.replace(",", ".") for line in lines)
    separator = layout.delimiter
    if separator is None or not fill:
        return lines

    def filled(line: str) -> str:
        content = layout.content(line)
        if not content:
            return line
        quoted = '"' in content
        cells = layout.cells(line) if quoted else content.split(separator)
        return separator.join(
            "nan" if k in fill and not cell.strip() else _quote(cell) if quoted else cell
            for k, cell in enumerate(cells)
        )

    return map(filled, lines)


def _quote(cell: str) -> str:
    """Return the cell in quotation marks, those inside it doubled."""
    return '"' + cell.replace('"', '""') + '"'


def _only_empty_cells(
    path: Path, layout: Layout, numbers: set[int], skip: int, last_line: int
) -> bool:
    """Raise for the first line that is wrong; return whether there are empty cells to fill.

    Raises
    ------
    InputError
        A row with another number of columns, or a word in a column of numbers.
    """
    expected = len(layout.names)
    empty = False
    with path.open(encoding="utf-8-sig") as file:
        numbered = islice(enumerate(file, 1), layout.first_line - 1 + max(skip, 0), None)
        for number, line in numbered:
            if not layout.content(line):
                continue
            cells = layout.cells(line)
            if len(cells) != expected:
                raise InputError(
                    f"{path.name} line {number}: {columns(len(cells))} where {layout.named_by} "
                    f"has {expected}; {_advice(layout, number, last_line, len(cells))}"
                )
            for k in numbers:
                if not cells[k]:
                    empty = True
                elif not layout.is_number(cells[k]):
                    raise InputError(
                        f"{path.name} line {number}, column {shortened(layout.names[k])!r}: "
                        f"{shortened(cells[k])!r} is not a number"
                    )
    return empty


def _refuse_swallowed_lines(path: Path, layout: Layout, rows: int) -> None:
    """Raise InputError where an open quotation mark has made one row of several lines."""
    with path.open(encoding="utf-8-sig") as file:
        lines = sum(bool(layout.content(k)) for k in islice(file, layout.first_line - 1, None))
    if lines != rows:
        raise InputError(
            f"{path.name}: {lines} lines of data make {rows} rows; is a quotation mark left open?"
        )


def _advice(layout: Layout, line: int, last_line: int, found: int) -> str:
    if line == last_line and found < len(layout.names):
        return _LAST_LINE
    return "repair or remove the line"
