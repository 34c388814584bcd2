"""Find the header and the first data row of a text file among the lines that a logger writes.

The header is the first row of words that is as wide as the data and stands above numbers. If there
are several such rows, some of them contain the unit or the kind of each column. These entries
repeat, so the names are in the lowest row whose cells all differ. Without a header, lines of prose
above the data are left out.
"""

import re
from collections.abc import Sequence
from typing import NamedTuple

from inercal.basics.errors import InputError
from inercal.basics.units import si_factor

_DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+([eE][-+]?\d+)?")
_UNITS = re.compile(
    r"(deg\w*|rad\w*|dps|m/?\(?s.*|[uµ]t|gauss|counts?|raw|(un)?cal\w*|no.?units?|n/?a|-+|unix.*"
    r"|us|[uµm]?s|secs?|seconds?|millis\w*|micros\w*|°?c|celsius)",
    re.IGNORECASE,
)
_SENTENCE_END = re.compile(r"[^\W\d].*[.:!?…]$")
_WORDS = re.compile(r"[^\W\d].*\s\S|\S\s.*[^\W\d]")


class TableStart(NamedTuple):
    """Numbers of the row with the names and of the first data row; equal if there are no names."""

    header: int
    data: int


def table_start(table: Sequence[Sequence[str]]) -> TableStart:
    """Return where a table begins; (0, 0) if its first row decides whether it is a header.

    Parameters
    ----------
    table : sequence of rows
        The entries of the first lines of a file.
    """
    widths = [len(row) for row in table[len(table) // 2 :]]
    width = max(set(widths), key=widths.count)
    last = next(row for row in reversed(table) if len(row) == width)
    filled = max((k for k, cell in enumerate(last, 1) if cell), default=0)
    numbers = [k for k, cell in enumerate(last) if may_be_number(cell)]
    if filled < 2 or not numbers:
        return TableStart(0, 0)

    def is_data(row: Sequence[str]) -> bool:
        cells = [row[k] for k in numbers] if len(row) == width else []
        found = [may_be_number(cell) for cell in cells if cell]
        return 2 * len(found) >= max(len(numbers), 1) and all(found)

    def is_words(row: Sequence[str]) -> bool:
        return len(row) == width and any(row) and not any(map(may_be_number, row))

    start = 0
    while start < len(table) and not is_data(table[start]):
        stop = start
        while stop < len(table) and is_words(table[stop]):
            stop += 1
        if stop > start and stop < len(table) and is_data(table[stop]):
            if (names := _names_row(table[start:stop], width, filled)) is not None:
                return TableStart(start + names, stop)
            break
        # Words that are not directly above numbers are no header.
        start = max(stop, start + 1)
    data = next((k for k, row in enumerate(table) if is_data(row)), 0)
    prose = all(_is_prose(row, filled) for row in table[:data])
    return TableStart(data, data) if prose else TableStart(0, 0)


def _names_row(rows: Sequence[Sequence[str]], width: int, filled: int) -> int | None:
    """Return the lowest row whose cells name the columns."""
    for k in range(len(rows) - 1, -1, -1):
        names = [cell for cell in rows[k][: min(filled, width)] if cell]
        complete = len(names) == filled and len(set(names)) == filled
        if complete and not all(map(_is_unit, names)):
            return k
    return None


def _is_unit(cell: str) -> bool:
    text = cell.strip("()[] ")
    if _UNITS.fullmatch(text):
        return True
    try:
        si_factor(text)
    except InputError:
        return False
    return True


def _is_prose(row: Sequence[str], columns: int) -> bool:
    """Return whether a row contains a sentence, or a title with its value, and no names."""
    cells = [cell for cell in row if cell]
    if any(map(may_be_number, cells)):
        return False
    if not cells or cells[0].endswith(":"):
        return True
    text = cells[0]
    # As many words as columns are names with another separator.
    several = bool(_WORDS.search(text)) and len(text.split()) != columns
    return len(cells) == 1 and (several or bool(_SENTENCE_END.search(text)))


def is_number(text: str) -> bool:
    """Return whether NumPy's parser reads a text as a number."""
    try:
        float(text)
    except ValueError:
        return False
    # Only Python accepts 1_000 and digits of other scripts.
    return "_" not in text and text.isascii()


def may_be_number(cell: str) -> bool:
    """Return whether a cell is a number, with a decimal point or a decimal comma."""
    return is_number(cell) or bool(_DECIMAL_COMMA.fullmatch(cell))
