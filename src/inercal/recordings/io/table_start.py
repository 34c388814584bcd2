"""Find the header and the first data row of a text file among the lines that a logger writes.

The header is the first row of words that is as wide as the data and stands above numbers. If there
are several such rows, some of them contain the units or the kind of each column, which repeat: the
names are then the lowest row whose cells all differ. Without a header, lines of prose above the
data are left out.

Lines in which a program writes words between the numbers are read as plain rows. A serial monitor
writes the time of arrival before each line (`10:11:23.000 -> 1.2,3.4`). A sketch for a serial
plotter writes a name before each number (`ax:1.2 ay:3.4`), and others write a word before a group
of numbers (`a/g: 1 2 3 4 5 6`). The words are the same in all rows. Names become the header; the
time of arrival is that of the link, not of the sensor, and is left out.
"""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from inercal.basics.errors import InputError
from inercal.basics.units import si_factor
from inercal.recordings.io.column_table import DECIMAL_COMMA

_ARRIVAL = re.compile(
    r"\s*(?:\[(?:[\d-]+[ T])?\d?\d:\d\d:\d\d(?:[.,]\d+)?\]\s*(?:->)?"
    r"|(?:[\d-]+[ T])?\d?\d:\d\d:\d\d(?:[.,]\d+)?\s*->)\s?"
)
_LABEL = re.compile(r"(?:^|(?<=[\s,;]))>?((?!nan\b|inf\b)[A-Za-zµ_$][^,;\t:=]*?)\s*[:=]", re.I)
_BETWEEN = re.compile(r"[\s,;|]+")
_UNIT = re.compile(r"[^\W\d]\S*")
_WRAPPED = re.compile(r"\s*[(\[]([^()\[\]]*)[)\]],?\s*")
_AXES = (*"xyz", *"XYZ")
_EXAMINED = 10  # of the last lines; most of them must have the form

Labels = tuple[tuple[str, int], ...]
"""The words of a row, each with the number of numbers after it."""


@dataclass(frozen=True)
class LineForm:
    """The words that each row has between its numbers.

    Parameters
    ----------
    arrival : bool
        Whether a line begins with the time at which a serial monitor received it.
    labels : tuple of (str, int)
        The words of a row, each with the number of numbers after it; empty if there are none.
    wrapped : bool
        Whether brackets are around each line, as Python prints lists and tuples.
    """

    arrival: bool = False
    labels: Labels = ()
    wrapped: bool = False

    def without_arrival(self, line: str) -> str:
        """Return a line without the time of its arrival, and without brackets around it."""
        if self.arrival and _ARRIVAL.match(line):
            return _ARRIVAL.sub("", line, count=1)
        wrapped = _WRAPPED.fullmatch(line) if self.wrapped else None
        return wrapped[1] if wrapped else line

    def plain(self, line: str) -> str:
        """Return a line with commas between its numbers; a line with other words stays unchanged.

        >>> LineForm(labels=(("ax", 1), ("ay", 1))).plain("ax:1.2 ay:3.4")
        '1.2,3.4'
        """
        line = self.without_arrival(line)
        if not self.labels:
            return line
        labels, numbers = _parse(line)
        return ",".join(numbers) if labels == self.labels else line

    @property
    def names(self) -> list[str]:
        """Names of the columns; empty if the words do not name each of them."""
        if not self.labels or any(count not in (1, 3) for _, count in self.labels):
            return []
        names = [
            name + end
            for name, count in self.labels
            for end in (("",) if count == 1 else ("_x", "_y", "_z"))
        ]
        return names if len(set(names)) == len(names) else []


def find_line_form(lines: Sequence[str]) -> LineForm | None:
    """Return the form of most of the last lines; None if they are plain.

    Parameters
    ----------
    lines : sequence of str
        The first lines of a file, without blank lines and comments.
    """
    last = lines[-_EXAMINED:]
    arrival = 2 * sum(_ARRIVAL.match(line) is not None for line in last) > len(last)
    form = LineForm(arrival)
    found = Counter(_parse(form.without_arrival(line))[0] for line in last)
    labels, count = found.most_common(1)[0]
    if labels and 2 * count > len(last):
        return LineForm(arrival, labels)
    wrapped = 2 * sum(_WRAPPED.fullmatch(line) is not None for line in last) > len(last)
    return LineForm(arrival, (), wrapped) if arrival or wrapped else None


def _parse(line: str) -> tuple[Labels, list[str]]:
    """Return the words of a line and its numbers; empty if there is anything else in it."""
    before, *parts = _LABEL.split(line.strip(" \t\r\n{}").replace('"', ""))  # also lines of JSON
    labels: list[tuple[str, int]] = []
    numbers: list[str] = []
    for name, text in zip(parts[::2], parts[1::2], strict=True):
        found = [one for one in _BETWEEN.split(text) if one]
        unit = f" ({found.pop()})" if len(found) > 1 and _UNIT.fullmatch(found[-1]) else ""
        if not found or not all(map(is_number, found)):
            return (), []
        stem, _, axis = (labels[-1][0] if labels else "").partition(" (")[0].rpartition(" ")
        same = stem and axis in _AXES and name in _AXES  # "Acceleration X: 1, Y: 2, Z: 3"
        labels.append((" ".join([*([stem] * bool(same)), *name.split()]) + unit, len(found)))
        numbers += found
    return ((), []) if before.strip(" \t,;|") else (tuple(labels), numbers)


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
    return is_number(cell) or bool(DECIMAL_COMMA.fullmatch(cell))
