"""Data classes for a study, the stages in which its numbers are computed, and its texts.

The texts are in TOML files beside the modules that compute the numbers of a study.

The file with the name of a section contains its title, its text and the claims that it judges::

    title = "Planar: a calibration that validates itself"
    text = ["A paragraph; a figure stands in braces: {across} mg."]

    [claims.itself]
    name = "the statement, and the other fields of `Claim`"

study.toml contains the text of the page above all sections.
"""

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from itertools import islice
from typing import Any

from inercal.basics.arrays import Array
from inercal.basics.parallel import Executor, in_order
from inercal.studies.claim import Claim, ClaimResult, judge_claim

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


@dataclass(frozen=True)
class SectionText:
    """Text and claims of a section.

    Parameters
    ----------
    name, title : str
    text : sequence of str
        Paragraphs, with the names of numbers in braces.
    claims : mapping of str to Claim
    """

    name: str
    title: str
    text: Sequence[str]
    claims: Mapping[str, Claim]

    def judge(self, claim: str, computed: float, uncertainty: float, reason: str) -> ClaimResult:
        """Judge the claim with this key; see `inercal.studies.claim.judge_claim`."""
        return judge_claim(self.claims[claim], computed, uncertainty, reason)

    def section(self, *parts: ClaimResult | StudyTable | Chart, **figures: object) -> StudySection:
        """Return the section with these parts, and with numbers for their names in the text."""
        return StudySection(
            self.name,
            self.title,
            [paragraph.format(**figures) for paragraph in self.text],
            [one for one in parts if isinstance(one, ClaimResult)],
            [one for one in parts if isinstance(one, StudyTable)],
            [one for one in parts if isinstance(one, Chart)],
        )


def read_section_text(package: str, name: str) -> SectionText:
    """Read the text of a section, given the package of its study and its name."""
    content = _read_toml(package, name)
    claims = {
        key: Claim(**fields | {"name": _one_line(fields["name"])})
        for key, fields in content.get("claims", {}).items()
    }
    return SectionText(
        name, content["title"], [_one_line(text) for text in content["text"]], claims
    )


def build_study(package: str, sections: Sequence[StudySection], **figures: object) -> Study:
    """Return the study of a package, with numbers in place of their names in the facts."""
    content = _read_toml(package, "study")
    return Study(
        content["name"],
        content["title"],
        _one_line(content["source"]),
        _one_line(content["summary"]),
        [(name, "\n".join(text).format(**figures)) for name, text in content["facts"].items()],
        sections,
    )


def _read_toml(package: str, name: str) -> dict[str, Any]:
    return tomllib.loads(files(package).joinpath(f"{name}.toml").read_text(encoding="utf-8"))


def _one_line(text: str) -> str:
    return " ".join(text.split())
