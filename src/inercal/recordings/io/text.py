"""Read CSV and text separated by tabs, semicolons or white space.

Long plain files are parsed by pyarrow (`plain_numbers`), and all others by NumPy's C parser, in
blocks of rows. Only if this fails does Python read the lines itself, to name the line, the column
and the text that are wrong.
"""

import re
import warnings
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inercal.basics.errors import InputError
from inercal.recordings.io.column_table import (
    BLOCK_ROWS,
    Array,
    Column,
    LineBreaks,
    ReadRequest,
    Table,
    label_array,
    select_columns,
    shorten,
)
from inercal.recordings.io.plain_numbers import Scan, load_plain, probable_rows, scan
from inercal.recordings.io.readers import Option, Reader
from inercal.recordings.io.text_layout import (
    TextLayout,
    column_count_text,
    refuse_sheet_error,
    sniff,
    uncommented,
)

_SPARE_ROWS = 1.25  # because lines may be shorter below those from which the rows are estimated
_LARGEST_EXACT = 2.0**53  # float64 represents all smaller whole numbers exactly
_MOST_BREAKS = 10_000  # in the numbering of lines, due to blank lines and comments between rows


def read_text(path: Path, wanted: ReadRequest, skip: int = 0) -> Table:
    """Read a table from a text file.

    Parameters
    ----------
    path : Path
        UTF-8 text with any line ends, comments with # or %, with or without a header.
    wanted : ReadRequest
    skip : int
        Number of lines to skip at the beginning.

    Raises
    ------
    InputError
        The file is not such text, or a wanted column cannot be read.
    OSError
        The file cannot be read.
    """
    if (rows := probable_rows(path)) and skip >= 0:
        # Whatever is wrong is reported below, because an error of the scan comes first.
        with suppress(InputError, ValueError):
            return _read(path, wanted, skip, int(_SPARE_ROWS * rows) + 1)
    found = scan(path)
    if skip < 0:
        raise InputError(f"[data] skip is {skip}; it counts lines, 0 or more", key="[data] skip")
    return _read(path, wanted, skip, found.line_bound, found)


def _read(
    path: Path, wanted: ReadRequest, skip: int, most_rows: int, found: Scan | None = None
) -> Table:
    """Read a table; without a scan, raise ValueError if the file is not plain or has more rows."""
    layout = sniff(path, skip)
    names = select_columns(layout.names, wanted.names, path.name)
    chosen = {k for k, name in enumerate(layout.names) if name in names}
    words = {k for k in chosen if k in layout.text_columns or layout.names[k] in wanted.text}
    numbers = chosen - words
    blank, block = wanted.empty_columns(most_rows, [layout.names[k] for k in sorted(numbers)])
    places = {str(k): blank[layout.names[k]] for k in numbers}
    plain = load_plain(path, layout, places, words)
    if plain is not None and plain[1] <= most_rows:
        found = plain[2]
    if found is None:
        raise ValueError
    try:
        labels, n = plain[:2] if plain else _load(path, layout, places, words, fill=set())
    except _RowError as error:
        # The row number from the parser is only a hint about where to look first.
        for skip in (error.row - 2, 0):
            if _check_cells(path, layout, numbers, skip, found.lines):
                break
        else:
            raise InputError(f"{path.name}: {shorten(str(error), 120)}") from error
        try:
            labels, n = _load(path, layout, places, words, fill=numbers)
        except _RowError as again:
            raise InputError(f"{path.name}: {shorten(str(again), 120)}") from again
    read: dict[str, Column] = {}
    for name in names:
        k = layout.names.index(name)
        read[name] = labels[k] if k in words else blank[name][:n]
        if name in wanted.whole and k not in words:
            read[name] = _whole_numbers(path, layout, k, blank[name][:n])
    # If there are comments or blank lines between the data, row k is not line first_line + k.
    rows_are_lines = layout.first_line + n - 1 == found.lines
    breaks = () if rows_are_lines else _line_breaks(path, layout, n)
    first_line = layout.first_line if rows_are_lines else 0
    return Table(
        layout.names,
        read,
        path.name,
        found.sha256,
        first_line,
        layout.header,
        block=block[:n],
        line_breaks=breaks,
    )


def _whole_numbers(path: Path, layout: TextLayout, column: int, read: Array) -> Column:
    """Return a column as int64; as it was read if that is exact, or if not all cells are whole."""
    if not np.abs(read).max(initial=0.0) > _LARGEST_EXACT:  # also if a cell is empty
        return read
    with path.open(encoding="utf-8-sig") as file, warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # raised for a cell such as 1.7e18
        warnings.simplefilter("ignore", UserWarning)
        try:
            whole = _parsed(_lines(file, layout, set()), layout, np.int64, usecols=column)
        except (ValueError, OverflowError, DeprecationWarning):
            return read
    return whole if whole.shape == read.shape else read


def _parsed(
    lines: Iterator[str], layout: TextLayout, dtype: Any, *, quoted: bool = False, **options: Any
) -> NDArray[Any]:
    """Read lines with NumPy's parser."""
    return np.loadtxt(
        lines,
        dtype=dtype,
        delimiter=layout.delimiter,
        comments=None,
        quotechar='"' if layout.quoted or quoted else None,
        ndmin=1,
        **options,
    )


class _RowError(ValueError):
    """NumPy's message about a row that it cannot read, and the approximate row number."""

    def __init__(self, message: str, row: int):
        super().__init__(message)
        self.row = row


def _load(
    path: Path, layout: TextLayout, places: Mapping[str, Array], words: set[int], fill: set[int]
) -> tuple[dict[int, NDArray[np.str_]], int]:
    """Read numbers into `places`; return the columns of words, and the number of rows."""
    parts: dict[int, list[NDArray[np.str_]]] = {k: [] for k in words}
    n = 0
    for rows in _chunks(path, layout, places, words, fill):
        for k, place in places.items():
            place[n : n + rows.size] = rows[k]
        for k, part in parts.items():
            cells = [cell.strip() for cell in rows[str(k)].tolist()]
            part.append(label_array(cells, layout.names[k], path.name))
        n += rows.size
    return {k: np.concatenate(part) for k, part in parts.items()}, n


def _chunks(
    path: Path, layout: TextLayout, numbers: Collection[str], words: set[int], fill: set[int]
) -> Iterator[NDArray[np.void]]:
    """Yield structured arrays with blocks of rows; unwanted columns are read as single letters."""
    kinds = [
        (str(k), "f8" if str(k) in numbers else "O" if k in words else "U1")
        for k in range(len(layout.names))
    ]
    n = 0
    with path.open(encoding="utf-8-sig") as file:
        lines = _lines(file, layout, fill)
        while n % BLOCK_ROWS == 0:
            try:
                with warnings.catch_warnings():  # for blank lines, or an empty chunk
                    warnings.simplefilter("ignore", UserWarning)
                    rows = _parsed(
                        lines, layout, np.dtype(kinds), quoted=bool(words), max_rows=BLOCK_ROWS
                    )
            except ValueError as error:
                near = re.search(r"at row (\d+)", str(error))
                raise _RowError(str(error), n + (int(near[1]) if near else 0)) from error
            if rows.size == 0:
                return
            yield rows
            n += rows.size


def _lines(file: Iterator[str], layout: TextLayout, fill: set[int]) -> Iterator[str]:
    """Return the data lines in the form that the parser needs: decimal points, no empty numbers."""
    lines = islice(file, layout.first_line - 1, None)
    if (form := layout.form) is not None:
        lines = map(form.plain, lines)
    lines = map(uncommented, lines)
    if layout.decimal_comma:
        lines = (line.replace(",", ".") for line in lines)
    separator = layout.delimiter
    if separator is None or not fill:
        return lines

    def quoted_cell(cell: str) -> str:
        return '"' + cell.replace('"', '""') + '"'

    def filled(line: str) -> str:
        content = layout.content(line)
        if not content:
            return line
        quoted = '"' in content
        cells = layout.cells(line) if quoted else content.split(separator)
        return separator.join(
            "nan" if k in fill and not cell.strip() else quoted_cell(cell) if quoted else cell
            for k, cell in enumerate(cells)
        )

    return map(filled, lines)


def _check_cells(
    path: Path, layout: TextLayout, numbers: set[int], skip: int, last_line: int
) -> bool:
    """Refuse the first wrong line; return whether there are empty cells to fill.

    Raises
    ------
    InputError
        A row has a different number of columns, or a number column contains a word.
    """
    expected = len(layout.names)
    empty = False
    with path.open(encoding="utf-8-sig") as file:
        numbered = islice(enumerate(file, 1), layout.first_line - 1 + max(skip, 0), None)
        for number, line in numbered:
            if not layout.content(line):
                continue
            cells = layout.cells(line)
            cut = "the file may be truncated: remove the line or record again"
            if len(cells) != expected:
                truncated = number == last_line and len(cells) < expected
                advice = cut if truncated else "repair or remove the line"
                raise InputError(
                    f"{path.name} line {number}: {column_count_text(len(cells))} where "
                    f"{layout.name_source} has {expected}; {advice}",
                    line=number,
                )
            for k in numbers:
                if not cells[k]:
                    empty = True
                elif not layout.is_number(cells[k]):
                    last = number == last_line and k == expected - 1
                    advice = cut if last else "correct the cell or remove the line"
                    raise InputError(
                        f"{path.name} line {number}, column {shorten(layout.names[k])!r}: "
                        f"{shorten(cells[k])!r} is not a number; {advice}",
                        line=number,
                        names=(layout.names[k],),
                    )
    return empty


def _line_breaks(path: Path, layout: TextLayout, rows: int) -> LineBreaks:
    """Return rows that are not on the line after the preceding row, with lines; none if too many.

    Raises
    ------
    InputError
        A row begins with a spreadsheet error, or a quotation mark is not closed, which joins
        several lines to one row.
    """
    breaks: list[tuple[int, int]] = []
    row, before = 0, -1
    with path.open(encoding="utf-8-sig") as file:
        for number, line in islice(enumerate(file, 1), layout.first_line - 1, None):
            if not layout.content(line):
                refuse_sheet_error(line, layout, number, path.name)
                continue
            if number != before + 1 and len(breaks) <= _MOST_BREAKS:
                breaks.append((row, number))
            row, before = row + 1, number
    if row != rows:
        raise InputError(
            f"{path.name}: {row} lines of data give {rows} rows: a quotation mark is not closed; "
            "close or remove it"
        )
    return tuple(breaks) if len(breaks) <= _MOST_BREAKS else ()


READER = Reader(
    "text",
    read_text,
    options=(Option("skip", int, 0, "lines to skip at the beginning of a text file"),),
)
