"""What a study consists of, as data: sections of text, tables, charts and findings."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from inercal.basics.arrays import Array
from inercal.basics.parallel import Executor
from inercal.studies.claim import ClaimResult

MessageCallback = Callable[[str], object]


@dataclass(frozen=True, eq=False)
class Curve:
    """One curve of a panel: its name, x and y, (n,) each; NaN is not plotted."""

    name: str
    x: Array
    y: Array
    connected: bool = True


@dataclass(frozen=True, eq=False)
class StudyPanel:
    """One pair of axes; `names` label the whole numbers of x in place of a scale."""

    title: str
    x: str
    y: str
    lines: Sequence[Curve]
    log_y: bool = True
    names: Sequence[str] = ()


@dataclass(frozen=True, eq=False)
class Chart:
    """Panels side by side, with a caption that states what to look for."""

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
    highlighted: frozenset[tuple[int, int]] = frozenset()  # of rows and columns
    collapsed: bool = False  # a long table, which the reader opens


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
    """A source, recomputed.

    Parameters
    ----------
    name : str
        As `inercal reproduce` takes it.
    title, source : str
        Of the page; the source with its DOI.
    summary : str
        One paragraph above all.
    facts : sequence of (str, str)
        Conditions, name and text.
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
        """All findings, in order."""
        return [finding for section in self.sections for finding in section.findings]


class StudyModule(Protocol):
    """The module of a study."""

    def run(self, trials: int, seed: int, say: MessageCallback, executor: Executor) -> Study:
        """Compute the study with this number of Monte Carlo trials; `say` receives progress."""
        ...
