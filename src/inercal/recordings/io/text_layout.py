"""Determine the layout of a text file from its first lines.

Columns are separated by semicolons, tabs, commas or white space: the first of these, in this order,
that a row of data contains. The first line names the columns if it contains no number, or a word
above a number. A comment directly above the data also names them if it has as many words as there
are columns. Loggers write information about themselves above the table, and units below its header
(`table_start`). Terminals and sketches write words between the numbers. Excel writes "sep=;" in the
first line.
"""

import csv
import re
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import NamedTuple

from inercal.basics.errors import InputError
from inercal.recordings.io.column_table import DECIMAL_COMMA, refuse_too_many_columns
from inercal.recordings.io.table_start import LineForm, find_line_form, is_number, table_start

COMMENTS = "#%"
# At the end of a row, white space is on both sides, so 1.#QNAN, #NV and "25 %" are no comments.
_COMMENT = re.compile(rf'^ *[{COMMENTS}].*|(?<![\s,;|])\s+[{COMMENTS}] [^",;|\t]*$')
_SNIFFED_LINES = 150  # that are examined; enough for a preamble, and to contain a decimal comma
_SEPARATOR_LINE = re.compile(r"\"?sep=(.)\"?", re.IGNORECASE)
# Spreadsheets in any language write #WERT! or #NV, and C programs under Windows 1.#QNAN.
_NO_NUMBER = re.compile(r"#(?:\S*[!?]|[NН](?:V|/\S))|[-+]?1[.,]#\w+")
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
    text_columns : frozenset of int
        Columns whose first entry is a word, not an error value such as #N/A.
    quoted : bool
        Whether quotation marks protect entries.
    form : LineForm or None
        What stands between the numbers of a line; None if only the separators do.
    """

    names: tuple[str, ...]
    name_source: str
    header: bool
    first_line: int
    delimiter: str | None
    decimal_comma: bool
    text_columns: frozenset[int]
    quoted: bool
    form: LineForm | None = None

    def content(self, line: str) -> str:
        """Return a line without its comment and surrounding white space."""
        kept = " \r\n" if self.delimiter == "\t" else None
        line = line if self.form is None else self.form.plain(line)
        return uncommented(line).strip(kept)

    def cells(self, line: str) -> list[str]:
        """Return the entries of a line."""
        return split_cells(self.content(line), self.delimiter)

    @property
    def is_plain(self) -> bool:
        """Whether a fast parser can read the columns, if all of them contain only numbers."""
        odd = self.decimal_comma or self.quoted or self.form is not None
        return self.delimiter is not None and not odd

    def is_number(self, cell: str) -> bool:
        """Return whether an entry is a number in this file."""
        return is_number(cell.replace(",", ".") if self.decimal_comma else cell)


class _Row(NamedTuple):
    """A data line: its number, and its text without comment."""

    line: int
    text: str


def sniff(path: Path, skip: int = 0) -> TextLayout:
    """Determine the layout of a text file; see `sniff_lines`."""
    with path.open(encoding="utf-8-sig") as file:
        return sniff_lines(file, path.name, skip)


def sniff_lines(lines: Iterable[str], name: str, skip: int = 0) -> TextLayout:
    """Determine the layout of lines of text.

    Parameters
    ----------
    lines : iterable of str
        The first lines, of which only as many are taken as are needed.
    name : str
        Name of their source, for messages.
    skip : int
        Number of lines to skip at the beginning.

    Raises
    ------
    InputError
        There is no line of data, or the first line has more or fewer columns than the header.
    """
    heading, rows, separator = _first_lines(lines, name, skip)
    if (form := find_line_form([row.text for row in rows])) is not None:
        heading, rows, separator = _without_words(heading, rows, separator, form)
    rows, delimiter, table = _split(rows, separator, name)
    if (start := table_start(table)) != (0, 0):
        kept = [start.header, *range(max(start.data, start.header + 1), len(rows))]
        heading = heading if start.header == 0 else []
        rows, table = [rows[k] for k in kept], [table[k] for k in kept]
    sample, title = rows[min(1, len(rows) - 1)].text, rows[0].text
    decimal_comma = delimiter in (";", "\t") and _has_decimal_comma(table)

    def marks(row: list[str]) -> list[bool]:
        return [is_number(c.replace(",", ".") if decimal_comma else c) for c in row]

    headed = _is_header(table[0], marks(table[0]), marks(table[1]) if table[1:] else [])
    if headed and len(rows) == 1:
        raise InputError(
            f"{name} has a header in line {rows[0].line} but no data below it: record or "
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
        raise InputError(
            f"{name} line {first_line}: {column_count_text(len(first))} where the header has "
            f"{len(names)}; {_count_advice(first, len(names), delimiter)}",
            line=first_line,
        )
    return TextLayout(
        # pandas leaves the name of an index column empty.
        names=tuple(column or str(k) for k, column in enumerate(names or [""] * len(first), 1)),
        name_source="the header" if headed else f"line {first_line}",
        header=bool(names),
        first_line=first_line,
        delimiter=delimiter,
        decimal_comma=decimal_comma,
        text_columns=frozenset(
            k
            for k, (c, number) in enumerate(zip(first, marks(first), strict=True))
            if c and not number and not _NO_NUMBER.fullmatch(c)
        ),
        quoted='"' in sample,
        form=form,
    )


def _without_words(
    heading: list[str], rows: list[_Row], separator: str | None, form: LineForm
) -> tuple[list[str], list[_Row], str | None]:
    """Return the comments, rows and separator of lines without the words between their numbers."""
    plain = [_Row(row.line, form.plain(row.text)) for row in rows]
    if not form.labels:
        return heading, [row for row in plain if uncommented(row.text).strip()], separator
    first = next(k for k, row in enumerate(plain) if row.text != form.without_arrival(rows[k].text))
    names = form.names
    if not names and first:
        names = re.split(r"[\s,;]+", plain[first - 1].text.strip())
    count = sum(number for _, number in form.labels)
    titled = len(names) == count and not any(map(is_number, names))
    # Names from the rows themselves are in no line above them.
    title = [_Row(plain[first].line - 1, ",".join(names))] if titled else []
    return heading, title + plain[first:], ","


def _is_header(first: list[str], numbers: list[bool], numbers_below: list[bool]) -> bool:
    """Return whether the first line names columns, given which entries are numbers."""
    word_over_number = any(
        cell and not number and below
        for cell, number, below in zip(first, numbers, numbers_below, strict=False)
    )
    return word_over_number or not any(numbers)


def _first_lines(
    lines: Iterable[str], name: str, skip: int
) -> tuple[list[str], list[_Row], str | None]:
    """Return the comments above the data, the first lines below them, and a stated separator."""
    heading: list[str] = []
    rows: list[_Row] = []
    separator = None
    numbered = ((number, line.strip("\r\n ")) for number, line in enumerate(lines, 1))
    content = ((number, line) for number, line in numbered if number > skip and line.strip())
    for number, line in content:
        if separator is None and (stated := _SEPARATOR_LINE.fullmatch(line)):
            separator = stated[1]
        elif line.startswith("//"):
            continue
        elif text := uncommented(line):
            rows.append(_Row(number, text))
            break
        else:
            heading.append(line)
    data = (_Row(k, text) for k, line in content if (text := uncommented(line)))
    rows.extend(islice(data, _SNIFFED_LINES))
    if not rows:
        what = f"no line after the first {skip}" if skip else "only comments and no data"
        raise InputError(f"{name} has {what}: record or export it again")
    return heading, rows, separator


def _split(
    rows: list[_Row], separator: str | None, source: str
) -> tuple[list[_Row], str | None, list[list[str]]]:
    """Return the lines, their delimiter and their entries.

    The delimiter is taken from the second line, or from the last line if a table with different
    columns starts further down. Lines above this table may be as wide as a line of the table that
    is split with their delimiter, so the delimiter of the last line is tried first.
    """
    found: dict[str | None, list[list[str]]] = {}
    for sample in (rows[min(1, len(rows) - 1)].text, rows[-1].text):
        delimiter = separator or next((d for d in (";", "\t", ",", "|") if d in sample), None)
        if delimiter in found:
            continue
        for row in rows:  # refuse too many columns before a million short strings are stored
            refuse_too_many_columns(len(row.text.split(delimiter)), source)
        found[delimiter] = [split_cells(row.text, delimiter) for row in rows]
    delimiter, table = list(found.items())[-1]
    if len(found) == 1 or table_start(table) != (0, 0):
        return rows, delimiter, table
    return rows, *next(iter(found.items()))


def _count_advice(first: list[str], names: int, delimiter: str | None) -> str:
    """Return advice about a first data line with a different number of columns than the header."""
    others = [cell for cell in first if not re.fullmatch(r"[-+]?\d+", cell)]
    if delimiter == "," and len(others) <= 1 and names < len(first) <= 2 * names:
        return (
            "the numbers look like decimal commas, and commas separate the columns too: export "
            "the file with semicolons or with decimal points"
        )
    return (
        "write a name for each column, separated by the same character as the numbers, or state "
        "with [data] skip how many lines stand above the table"
    )


def refuse_sheet_error(line: str, layout: TextLayout, number: int, source: str) -> None:
    """Refuse a row that begins with a spreadsheet error, such as "#N/A", and is no comment.

    Raises
    ------
    InputError
        The line has a number, and as many entries as there are columns.
    """
    cells = split_cells(line.strip(), layout.delimiter)
    row = len(cells) == len(layout.names) and any(map(layout.is_number, cells))
    if row and _NO_NUMBER.fullmatch(cells[0]):
        raise InputError(
            f"{source} line {number}, column {layout.names[0]!r}: {cells[0]!r} is a spreadsheet "
            "error; correct its formula, or remove the line",
            line=number,
        )


def uncommented(line: str) -> str:
    """Return a line without its comment."""
    return _COMMENT.sub("", line) if "#" in line or "%" in line else line


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


def _has_decimal_comma(table: list[list[str]]) -> bool:
    cells = [cell for row in table for cell in row]
    return any(map(DECIMAL_COMMA.fullmatch, cells)) and not any(
        map(_DECIMAL_POINT.fullmatch, cells)
    )


def _names_in_comment(heading: list[str], delimiter: str | None, count: int) -> list[str]:
    """Return names from the comment directly above the data, as numpy.savetxt writes them."""
    names = split_cells(heading[-1].lstrip(COMMENTS + " "), delimiter) if heading else []
    distinct = len(set(names)) == count == len(names) and all(names)
    return names if distinct and not any(map(is_number, names)) else []
