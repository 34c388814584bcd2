"""What a study consists of, as data: sections of text, tables, charts and findings."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from inercal.arrays import Array
from inercal.studies.claim import Finding

Say = Callable[[str], object]


@dataclass(frozen=True, eq=False)
class Line:
    """One curve of a panel: its name, x and y, (n,) each; NaN is left out."""

    name: str
    x: Array
    y: Array
    joined: bool = True


@dataclass(frozen=True, eq=False)
class Panel:
    """One pair of axes; `names` stand under whole numbers of x in place of a scale."""

    title: str
    x: str
    y: str
    lines: Sequence[Line]
    log_y: bool = True
    names: Sequence[str] = ()


@dataclass(frozen=True, eq=False)
class Chart:
    """Panels side by side, with a caption that also says what is to be seen."""

    name: str
    caption: str
    panels: Sequence[Panel]


@dataclass(frozen=True)
class Table:
    """A table: heading above each column, a name before each row, cells that stand out."""

    title: str
    corner: str
    columns: Sequence[str]
    rows: Sequence[tuple[str, Sequence[str]]]
    marked: frozenset[tuple[int, int]] = frozenset()  # of rows and columns
    folded: bool = False  # long: opened on wish


@dataclass(frozen=True)
class Section:
    """One question of a study: what is asked, the findings, and what shows them."""

    name: str
    title: str
    text: Sequence[str]
    findings: Sequence[Finding] = ()
    tables: Sequence[Table] = ()
    charts: Sequence[Chart] = ()


@dataclass(frozen=True)
class Study:
    """A source, recomputed.

    Parameters
    ----------
    name : str
        By which the verb knows it.
    title, source : str
        Of the page; the source with its DOI.
    summary : str
        One paragraph above all.
    facts : sequence of (str, str)
        Conditions, name and text.
    sections : sequence of Section
    """

    name: str
    title: str
    source: str
    summary: str
    facts: Sequence[tuple[str, str]]
    sections: Sequence[Section] = field(repr=False)

    @property
    def findings(self) -> list[Finding]:
        """All findings, in order."""
        return [finding for section in self.sections for finding in section.findings]


class Runner(Protocol):
    """The module of a study."""

    def run(self, trials: int, seed: int, say: Say) -> Study:
        """Compute the study with so many Monte Carlo trials; `say` is told what goes on."""
        ...
