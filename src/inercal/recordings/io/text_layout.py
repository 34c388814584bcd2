"""Determine the layout of a text file from its first lines.

Columns are separated by semicolons, tabs, commas or white space: the first of these, in this order,
that a row of data contains. The first line names the columns if it contains no number, or a word
above a number. A comment directly above the data also names them if it has as many words as there
are columns. Loggers write information about themselves above the table. If the first line has a
different number of columns than the data, the table therefore begins at the first row of words that
is followed by rows of numbers. Excel writes "sep=;" in the first line.
"""

import csv
import re
from dataclasses import dataclass
from itertools import islice, pairwise
from pathlib import Path
from typing import NamedTuple

from inercal.basics.errors import InputError
from inercal.recordings.io.column_table import refuse_too_many_columns

COMMENTS = "#%"
_SNIFFED_LINES = 50  # data lines that are examined; enough to contain a decimal comma
_DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+([eE][-+]?\d+)?")
_SEPARATOR_LINE = re.compile(r"sep=(.)", re.IGNORECASE)
_SHEET_ERROR = re.compile(r"#(?:DIV/0!|N/A|VALUE!|REF!|NAME\?|NUM!|NULL!)")
_DECIMAL_POINT = re.compile(r"[-+]?\d*\.\d*([eE][-+]?\d+)?")


@dataclass(frozen=True)
class TextLayout:
    """The layout of the columns in a text file.

    Parameters
    ----------
    names : tuple of str
        Names of the columns; "1", "2", ... without a header.
    name_source : str
        Text that says where the number of columns comes from.
    header : bool
        Whether the file has a header with column names.
    first_line : int
        Line of the first row of data, counted from 1.
    delimiter : str or None
        Separator of the columns; None for white space.
    decimal_comma : bool
        Whether 1,5 is a number.
    comment : str
        The character that starts a comment.
    text_columns : frozenset of int
        Columns whose first entry is a word.
    quoted : bool
        Whether quotation marks protect entries.
    """

    names: tuple[str, ...]
    name_source: str
    header: bool
    first_line: int
    delimiter: str | None
    decimal_comma: bool
    comment: str
    text_columns: frozenset[int]
    quoted: bool

    def content(self, line: str) -> str:
        """Return a line without its comment and surrounding white space."""
        kept = " \r\n" if self.delimiter == "\t" else None
        return _uncommented(line, self.comment).strip(kept)

    def cells(self, line: str) -> list[str]:
        """Return the entries of a line."""
        return split_cells(self.content(line), self.delimiter)

    def is_number(self, cell: str) -> bool:
        """Return whether an entry is a number in this file."""
        return is_number(cell.replace(",", ".") if self.decimal_comma else cell)


class _Row(NamedTuple):
    """A data line: its number, its text without comment, and the unchanged line."""

    line: int
    text: str
    raw: str


def sniff(path: Path, skip: int = 0) -> TextLayout:
    """Determine the layout of a text file.

    Parameters
    ----------
    path : Path
    skip : int
        Number of lines to skip at the beginning.

    Raises
    ------
    InputError
        There is no line of data, or the first line has more or fewer columns than the header.
    """
    heading, rows, separator = _first_lines(path, skip)
    rows, delimiter, table = _split(rows, separator, path.name)
    if start := _table_start(table):
        heading, rows, table = [], rows[start:], table[start:]
    sample, title = rows[min(1, len(rows) - 1)].text, rows[0].raw
    decimal_comma = delimiter in (";", "\t") and _has_decimal_comma(table)

    def marks(row: list[str]) -> list[bool]:
        return [is_number(c.replace(",", ".") if decimal_comma else c) for c in row]

    headed = _is_header(table[0], marks(table[0]), marks(table[1]) if table[1:] else [])
    if headed and len(rows) == 1:
        raise InputError(
            f"{path.name} has a header in line {rows[0].line} but no data below it: record or "
            "export it again",
            line=rows[0].line,
        )
    first_line, first = rows[int(headed)].line, table[int(headed)]
    names = (
        split_cells(title, delimiter)
        if headed
        else _names_in_comment(heading, delimiter, len(first))
    )
    if headed and len(names) != len(first):
        refuse_sheet_error(rows[1].raw, delimiter, first_line, path.name)
        raise InputError(
            f"{path.name} line {first_line}: {column_count_text(len(first))} where the header has "
            f"{len(names)}; {_count_advice(first, len(names), delimiter)}",
            line=first_line,
        )
    return TextLayout(
        # pandas leaves the name of an index column empty.
        names=tuple(name or str(k) for k, name in enumerate(names or [""] * len(first), 1)),
        name_source="the header" if headed else f"line {first_line}",
        header=bool(names),
        first_line=first_line,
        delimiter=delimiter,
        decimal_comma=decimal_comma,
        comment=_comment(heading),
        text_columns=frozenset(
            k
            for k, (c, number) in enumerate(zip(first, marks(first), strict=True))
            if c and not number
        ),
        quoted='"' in sample,
    )


def _is_header(first: list[str], numbers: list[bool], numbers_below: list[bool]) -> bool:
    """Return whether the first line names columns, given which entries are numbers."""
    word_over_number = any(
        cell and not number and below
        for cell, number, below in zip(first, numbers, numbers_below, strict=False)
    )
    return word_over_number or not any(numbers)


def _first_lines(path: Path, skip: int) -> tuple[list[str], list[_Row], str | None]:
    """Return the comments above the data, the first lines below them, and a stated separator.

    Comments are removed from the text of the lines. A header may contain a #, so the raw lines are
    also kept.
    """
    heading: list[str] = []
    rows: list[_Row] = []
    separator = None
    with path.open(encoding="utf-8-sig") as file:
        lines = ((number, line.strip("\r\n ")) for number, line in enumerate(file, 1))
        content = ((number, line) for number, line in lines if number > skip and line.strip())
        for number, line in content:
            if separator is None and (stated := _SEPARATOR_LINE.fullmatch(line)):
                separator = stated[1]
            elif line[0] in COMMENTS:
                heading.append(line)
            else:
                rows.append(_Row(number, _uncommented(line, _comment(heading)), line))
                break
        comment = _comment(heading)
        data = (
            _Row(k, _uncommented(line, comment), line)
            for k, line in content
            if line[0] not in COMMENTS
        )
        rows.extend(islice(data, _SNIFFED_LINES))
    if not rows:
        what = f"no line after the first {skip}" if skip else "only comments and no data"
        raise InputError(f"{path.name} has {what}: record or export it again")
    return heading, rows, separator


def _split(
    rows: list[_Row], separator: str | None, source: str
) -> tuple[list[_Row], str | None, list[list[str]]]:
    """Return the lines, their delimiter and their entries.

    The delimiter is taken from the second line, or from the last line if a table with different
    columns starts further down.
    """
    found: list[tuple[str | None, list[list[str]]]] = []
    for sample in (rows[min(1, len(rows) - 1)].text, rows[-1].text):
        delimiter = separator or next((d for d in (";", "\t", ",") if d in sample), None)
        for row in rows:  # refuse too many columns before a million short strings are stored
            refuse_too_many_columns(len(row.text.split(delimiter)), source)
        table = [split_cells(row.text, delimiter) for row in rows]
        found.append((delimiter, table))
        if len(table[0]) == len(table[-1]):
            return rows, delimiter, table
    delimiter, table = found[1] if _table_start(found[1][1]) else found[0]
    return rows, delimiter, table


def _table_start(table: list[list[str]]) -> int:
    """Return the number of lines above the header; 0 if the first line has all columns.

    The header is the first row of words that is as wide as the last row and has numbers below it
    where the last row has numbers.
    """
    last = table[-1]
    if len(table[0]) == len(last) or len(last) < 2:
        return 0
    numbers = [_may_be_number(cell) for cell in last]
    for k, (row, below) in enumerate(pairwise(table)):
        if k == 0 or len(row) != len(last) or len(below) != len(last) or not all(row):
            continue
        worded = not any(_may_be_number(cell) for cell in row)
        alike = all(
            not number or not cell or _may_be_number(cell)
            for number, cell in zip(numbers, below, strict=True)
        )
        if worded and any(numbers) and alike and any(map(_may_be_number, below)):
            return k
    return 0


def _may_be_number(cell: str) -> bool:
    return is_number(cell) or bool(_DECIMAL_COMMA.fullmatch(cell))


def _count_advice(first: list[str], names: int, delimiter: str | None) -> str:
    """Return advice about a first data line with a different number of columns than the header."""
    whole = all(re.fullmatch(r"[-+]?\d+", cell) for cell in first)
    if delimiter == "," and whole and names < len(first) <= 2 * names:
        return (
            "the numbers look like decimal commas, and commas separate the columns too: export "
            "the file with semicolons or with decimal points"
        )
    return "write a name for each column, separated by the same character as the numbers"


def refuse_sheet_error(line: str, delimiter: str | None, number: int, source: str) -> None:
    """Refuse a line with an error value of a spreadsheet, such as "#DIV/0!".

    The # would otherwise begin a comment.

    Raises
    ------
    InputError
        The line contains an error value; the message names the column by its number.
    """
    for k, cell in enumerate(split_cells(line.strip(), delimiter), 1):
        if _SHEET_ERROR.fullmatch(cell):
            raise InputError(
                f"{source} line {number}, column {k}: {cell!r} is an error value of a spreadsheet; "
                "correct its formula, or remove the line",
                line=number,
            )


def _uncommented(line: str, comment: str) -> str:
    # In a line with quotation marks, a # is more likely part of a label.
    return line if '"' in line else line.partition(comment)[0]


def _comment(heading: list[str]) -> str:
    return heading[-1][0] if heading else "#"


def split_cells(text: str, delimiter: str | None) -> list[str]:
    """Return the entries of a line, without quotation marks and surrounding white space."""
    if delimiter is None:
        return [cell.strip('"') for cell in text.split()]
    if '"' not in text:
        return [cell.strip() for cell in text.split(delimiter)]
    try:
        return [cell.strip() for cell in next(csv.reader([text], delimiter=delimiter))]
    except csv.Error:  # an entry longer than 128 kB
        return text.split(delimiter)


def column_count_text(count: int) -> str:
    """Return a number of columns in words."""
    return f"{count} column" + ("s" if count != 1 else "")


def is_number(text: str) -> bool:
    """Return whether NumPy's parser reads a text as a number."""
    try:
        float(text)
    except ValueError:
        return False
    # Only Python accepts 1_000 and digits of other scripts.
    return "_" not in text and text.isascii()


def _has_decimal_comma(table: list[list[str]]) -> bool:
    cells = [cell for row in table for cell in row]
    return any(map(_DECIMAL_COMMA.fullmatch, cells)) and not any(
        map(_DECIMAL_POINT.fullmatch, cells)
    )


def _names_in_comment(heading: list[str], delimiter: str | None, count: int) -> list[str]:
    """Return names from the comment directly above the data, as numpy.savetxt writes them."""
    names = split_cells(heading[-1].lstrip(COMMENTS + " "), delimiter) if heading else []
    distinct = len(set(names)) == count == len(names) and all(names)
    return names if distinct and not any(map(is_number, names)) else []
