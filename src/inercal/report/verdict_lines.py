"""The lines of a verdict for a page: the long list of what the data cannot show is folded."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from inercal.calibration.verdict import UNDETECTED_END, UNDETECTED_START
from inercal.keys import CoefficientName
from inercal.sensors.coefficient_tables import TABLES

_COMMA = re.compile(r", (?![^(]*\))")  # outside brackets


@dataclass(frozen=True)
class VerdictLine:
    """A line of a verdict after its first.

    Parameters
    ----------
    text : str
        Of the line; of a folded one, what stands after the list, or empty.
    causes : tuple of (str, str, str)
        Name, meaning and size of each cause that the data cannot show; empty of other lines.
    """

    text: str
    causes: tuple[tuple[str, str, str], ...] = ()


def verdict_lines(lines: Sequence[str]) -> tuple[VerdictLine, ...]:
    """Return the lines of a verdict, with the causes that the data cannot show as a list."""
    return tuple(_line(text) for text in lines)


def _line(text: str) -> VerdictLine:
    if not text.startswith(UNDETECTED_START):
        return VerdictLine(text)
    listed, _, rest = text.partition(UNDETECTED_END)[2].partition("; ")
    return VerdictLine(rest, tuple(_cause(one) for one in _COMMA.split(listed)))


def _cause(text: str) -> tuple[str, str, str]:
    name, _, size = text.removesuffix(")").partition(" (")
    term = CoefficientName(name).term
    meaning = next(
        (one.meaning for table in TABLES.values() for one in table if one.name == term), ""
    )
    return name, meaning, size
