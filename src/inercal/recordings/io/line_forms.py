"""Read lines in which a terminal or a sketch writes words between the numbers.

A serial monitor writes the time of arrival before each line (`10:11:23.000 -> 1.2,3.4`). A sketch
for a serial plotter writes a name before each number (`ax:1.2 ay:3.4`), and others write a word
before a group of numbers (`a/g: 1 2 3 4 5 6`). All rows must have the same words. Names become the
header. The time of arrival is left out, because the link determines it and not the sensor.
"""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from inercal.recordings.io.table_start import is_number

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
