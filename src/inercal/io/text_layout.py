"""The layout of a text file, from its first lines.

Columns are separated by semicolons, tabs, commas or white space: the first of these, in this order,
that a row of data contains. A first line without a number, or with a word above a number, names the
columns; so does a comment directly above the data with as many words as there are columns.
"""

import csv
import re
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from inercal.errors import InputError
from inercal.io.column_table import refuse_too_many_columns

COMMENTS = "#%"
_SNIFFED_LINES = 50  # lines of data; enough to contain a decimal comma
_DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+([eE][-+]?\d+)?")
_DECIMAL_POINT = re.compile(r"[-+]?\d*\.\d*([eE][-+]?\d+)?")


@dataclass(frozen=True)
class TextLayout:
    """Where the columns of a text file are.

    Parameters
    ----------
    names : tuple of str
        Of the columns; "1", "2", ... without a header.
    name_source : str
        Text that names where the number of columns comes from.
    header : bool
        Whether the file names its columns.
    first_line : int
        Line of the first row of data, from 1.
    delimiter : str or None
        None for white space.
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
        """Return a line without its comment and the white space around it."""
        kept = " \r\n" if self.delimiter == "\t" else None
        return _uncommented(line, self.comment).strip(kept)

    def cells(self, line: str) -> list[str]:
        """Return the entries of a line."""
        return split_cells(self.content(line), self.delimiter)

    def is_number(self, cell: str) -> bool:
        """Return whether an entry is a number in this file."""
        return is_number(cell.replace(",", ".") if self.decimal_comma else cell)


def sniff(path: Path) -> TextLayout:
    """Return the layout of a text file.

    Raises
    ------
    InputError
        No line of data, or a first line with more or fewer columns than the header.
    """
    heading, rows, title = _first_lines(path)
    sample = rows[min(1, len(rows) - 1)][1]
    delimiter = next((d for d in (";", "\t", ",") if d in sample), None)
    for _, text in rows:  # before a million short strings are kept
        refuse_too_many_columns(len(text.split(delimiter)), path.name)
    table = [split_cells(text, delimiter) for _, text in rows]
    decimal_comma = delimiter in (";", "\t") and _has_decimal_comma(table)

    def marks(row: list[str]) -> list[bool]:
        return [is_number(c.replace(",", ".") if decimal_comma else c) for c in row]

    headed = _is_header(table[0], marks(table[0]), marks(table[1]) if table[1:] else [])
    if headed and len(rows) == 1:
        raise InputError(
            f"{path.name} has a header in line {rows[0][0]} and no data below it: record or export "
            "it again",
            line=rows[0][0],
        )
    first_line, first = rows[int(headed)][0], table[int(headed)]
    names = (
        split_cells(title, delimiter)
        if headed
        else _names_in_comment(heading, delimiter, len(first))
    )
    if headed and len(names) != len(first):
        raise InputError(
            f"{path.name} line {first_line}: {column_count_text(len(first))} where the header has "
            f"{len(names)}; write a name for each column, separated by the same character as the "
            "numbers",
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


def _first_lines(path: Path) -> tuple[list[str], list[tuple[int, str]], str]:
    """Return the comments above the data, the first lines below, and the unchanged first line.

    Comments are removed from the lines. A header may contain a #, so its line is returned too.
    """
    heading: list[str] = []
    rows: list[tuple[int, str]] = []
    with path.open(encoding="utf-8-sig") as file:
        lines = ((number, line.strip("\r\n ")) for number, line in enumerate(file, 1))
        content = ((number, line) for number, line in lines if line.strip())
        title = ""
        for number, title in content:
            if title[0] not in COMMENTS:
                rows.append((number, _uncommented(title, _comment(heading))))
                break
            heading.append(title)
        comment = _comment(heading)
        data = ((k, _uncommented(line, comment)) for k, line in content if line[0] not in COMMENTS)
        rows.extend(islice(data, _SNIFFED_LINES))
    if not rows:
        raise InputError(f"{path.name} has comments only and no data: record or export it again")
    return heading, rows, title


def _uncommented(line: str, comment: str) -> str:
    # In a line with quotation marks a # is more likely part of a label.
    return line if '"' in line else line.partition(comment)[0]


def _comment(heading: list[str]) -> str:
    return heading[-1][0] if heading else "#"


def split_cells(text: str, delimiter: str | None) -> list[str]:
    """Return the entries of a line, without quotation marks and white space around them."""
    if delimiter is None:
        return [cell.strip('"') for cell in text.split()]
    if '"' not in text:
        return [cell.strip() for cell in text.split(delimiter)]
    try:
        return [cell.strip() for cell in next(csv.reader([text], delimiter=delimiter))]
    except csv.Error:  # an entry above 128 kB
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
    # Only Python reads 1_000 and digits of other scripts.
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
