"""Read the texts of a study from TOML files beside the modules that compute its numbers.

The file with the name of a section contains its title, its text and the claims that it judges::

    title = "Planar: a calibration that validates itself"
    text = ["A paragraph; a figure stands in braces: {across} mg."]

    [claims.itself]
    name = "the statement, and the other fields of `Claim`"

study.toml contains the text of the page above all sections.
"""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

from inercal.studies.claim import Claim, ClaimResult, judge_claim
from inercal.studies.study import Chart, Study, StudySection, StudyTable


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

    def section(
        self,
        findings: Sequence[ClaimResult] = (),
        tables: Sequence[StudyTable] = (),
        charts: Sequence[Chart] = (),
        **figures: object,
    ) -> StudySection:
        """Return the section, with numbers in place of their names in the text."""
        text = [paragraph.format(**figures) for paragraph in self.text]
        return StudySection(self.name, self.title, text, findings, tables, charts)


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
