"""Data classes for a study, and the stages in which its numbers are computed."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import Any

from inercal.basics.arrays import Array
from inercal.basics.parallel import Executor, in_order
from inercal.studies.claim import ClaimResult

MessageCallback = Callable[[str], object]


@dataclass(frozen=True, eq=False)
class Curve:
    """One curve in a panel: its name and x and y, (n,) each; NaN is not plotted."""

    name: str
    x: Array
    y: Array
    connected: bool = True


@dataclass(frozen=True, eq=False)
class StudyPanel:
    """One pair of axes; `names`, if given, label the whole numbers on the x axis."""

    title: str
    x: str
    y: str
    lines: Sequence[Curve]
    log_y: bool = True
    names: Sequence[str] = ()


@dataclass(frozen=True, eq=False)
class Chart:
    """Panels side by side, with a caption that tells the reader what to look for."""

    name: str
    caption: str
    panels: Sequence[StudyPanel]


@dataclass(frozen=True)
class StudyTable:
    """A table: headings of columns, names of rows, and highlighted cells."""

    title: str
    row_heading: str
    columns: Sequence[str]
    rows: Sequence[tuple[str, Sequence[str]]]
    highlighted: frozenset[tuple[int, int]] = frozenset()  # rows and columns of highlighted cells
    collapsed: bool = False  # for a long table, which the reader can open


@dataclass(frozen=True)
class StudySection:
    """One question of a study: its text, the findings, tables and charts."""

    name: str
    title: str
    text: Sequence[str]
    findings: Sequence[ClaimResult] = ()
    tables: Sequence[StudyTable] = ()
    charts: Sequence[Chart] = ()


@dataclass(frozen=True)
class Study:
    """A recomputed source.

    Parameters
    ----------
    name : str
        Name for `inercal reproduce`.
    title, source : str
        Title of the page, and the source with its DOI.
    summary : str
        One paragraph at the top of the page.
    facts : sequence of (str, str)
        Conditions, each with a name and a text.
    sections : sequence of StudySection
    """

    name: str
    title: str
    source: str
    summary: str
    facts: Sequence[tuple[str, str]]
    sections: Sequence[StudySection] = field(repr=False)

    @property
    def findings(self) -> list[ClaimResult]:
        """Return all findings in order."""
        return [finding for section in self.sections for finding in section.findings]


Call = Callable[[], Any]


def compute_stages(
    stages: Mapping[str, Sequence[Call]], say: MessageCallback, executor: Executor
) -> list[list[Any]]:
    """Return the results of the calls of each stage, in order.

    All calls are submitted at once, so that no worker waits for the end of a stage.

    Parameters
    ----------
    stages : mapping of str to sequence of callable
        Calls of each stage, by the message that is shown when the stage begins.
    say : callable
    executor : Executor
    """
    indices = [executor.submit(call) for calls in stages.values() for call in calls]
    results = in_order(executor, indices[0])
    found: list[list[Any]] = []
    for words, calls in stages.items():
        say(words)
        found.append(list(islice(results, len(calls))))
    return found
