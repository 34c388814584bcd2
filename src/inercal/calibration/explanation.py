"""Keep verdicts short: a few lines, with an explanation of all findings under headings.

An addition describes coefficients that a run added to its model because of its score tests.
The tests rejected a fit, and these coefficients were the most likely cause. The run was then
calibrated again with them.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from inercal.physics.sensors import Sensor
from inercal.physics.sensors.coefficient_selection import coefficient_words
from inercal.recordings import Finding

MOST_CHARACTERS = 100  # largest length of a line in a verdict
AGREEMENT = "How well the data agree with the model"
CAUSE = "What explains the residuals"
NEXT_STEPS = "What to do next"
UNCERTAINTIES = "Largest expanded uncertainties (k = 2)"
UNDETECTABLE = (
    "Not detectable from these data and not included in U (an effect of the size shown would shift "
    "a coefficient by 5 u)"
)
REMARKS = "Remarks on the method and the data"
CHECKS = "Warnings and notes of the checks"
NOTES = "Notes"
"""Heading for notes from a file that states no headings."""
EXPLAIN, NEXT = "--explain lists them.", "Next: "
_OPERATOR_WORDS = re.compile(
    r"\[(?:sensor|bench|data|method|environment|specification|job)\b[\w.]*\]|(?<!\w)--[a-z]"
    r"|\brun file|\binercal [a-z]"
)
_PARTS = re.compile(r"(?<=[;.:]) ")
_PAUSES = re.compile(r", (?!but |not |and |or )(?![^()]*\))")  # outside brackets
_OPEN_BRACKET = re.compile(r" *\([^()]*$")
_LEAST = 16  # smallest number of characters of a shortened line


class ExplanationSection(NamedTuple):
    """A section of the explanation: a heading and its lines."""

    heading: str
    lines: tuple[str, ...]


def sentence(text: str) -> str:
    """Return a text with a capital letter at its beginning."""
    return f"{text[:1].upper()}{text[1:]}"


def fit(text: str, most: int = MOST_CHARACTERS) -> str:
    """Shorten a line to the permitted length: after a clause, else before a bracket or a comma.

    A line without these is cut after a word, and ends with "…". No line ends within brackets.
    """
    if len(text) <= most:
        return text
    ends = [one.start() for one in _PARTS.finditer(text) if _LEAST <= one.start() <= most]
    if whole := [end for end in ends if not _is_open(text[:end])]:
        return text[: whole[-1]].rstrip(";:")
    kept = _OPEN_BRACKET.sub("", text[: most - 1])
    pauses = [one.start() for one in _PAUSES.finditer(kept) if one.start() >= _LEAST]
    if len(kept) < most - 1 and len(kept) >= _LEAST:
        return kept
    if pauses:
        return kept[: pauses[-1]]
    return f"{kept.rpartition(' ')[0] or kept}".rstrip(",;: ") + "…"


def _is_open(text: str) -> bool:
    """Return whether a text ends within brackets."""
    return text.count("(") > text.count(")")


def first_fit(*texts: str) -> str:
    """Return the first line that is short enough; each line must say less than the previous."""
    return next((text for text in texts if len(text) <= MOST_CHARACTERS), fit(texts[-1]))


def fit_list(start: str, parts: Sequence[str], separator: str = ", ") -> str:
    """Return a line with as many parts as fit, and the number of omitted parts."""
    for count in range(len(parts), 0, -1):
        more = f"{separator}{len(parts) - count} more not shown" if count < len(parts) else ""
        text = f"{start}{separator.join(parts[:count])}{more}."
        if len(text) <= MOST_CHARACTERS:
            return text
    return fit(f"{start}{separator.join(parts)}.")


def without_operator_words(text: str) -> str:
    """Remove the clauses that mention run files or options of the program."""
    kept = [part for part in _PARTS.split(text) if not _OPERATOR_WORDS.search(part)]
    joined = " ".join(kept)
    return joined if len(kept) == len(_PARTS.split(text)) else joined.rstrip(";:, ")


def customer_lines(lines: Iterable[str]) -> tuple[str, ...]:
    """Return only the lines for a customer, without run-file keys or next steps."""
    kept = (without_operator_words(line) for line in lines if not line.startswith(NEXT))
    return tuple(filter(None, kept))


def customer_sections(sections: Sequence[ExplanationSection]) -> tuple[ExplanationSection, ...]:
    """Return the explanation for a customer, without run-file keys, options or next steps."""
    found = (
        ExplanationSection(heading, customer_lines(lines))
        for heading, lines in sections
        if heading != NEXT_STEPS
    )
    return tuple(section for section in found if section.lines)


_MOST_NAMED = 2  # most other causes that are named before the advice


@dataclass(frozen=True)
class Addition:
    """A group of coefficients that was added to the model.

    Parameters
    ----------
    group : str
        Name of the group that [method] also accepts, such as "g" or "ax.k2".
    coefficients : tuple of str
        Full names of the coefficients.
    chi2_before, dof_before, chi2_after, dof_after : float and int
        χ² and degrees of freedom of the fits without and with the group; see `ScoreTestSet.chi2`.
        If the noise comes from the data, both χ² have the unit of the fit with the group.
    indistinguishable : tuple of str
        Other causes that would have explained these residuals equally well.
    """

    group: str
    coefficients: tuple[str, ...]
    chi2_before: float
    dof_before: int
    chi2_after: float
    dof_after: int
    indistinguishable: tuple[str, ...] = ()


def additions_text(additions: Sequence[Addition], sensor: Sensor) -> str:
    """Describe the additions in order, with the decrease of χ²; empty if there are none."""
    parts = (
        f"{coefficient_words(sensor, one.group, one.coefficients)}, "
        f"χ² from {_grouped(one.chi2_before)} to {_grouped(one.chi2_after)}"
        for one in additions
    )
    return f"Added to the model: {'; then '.join(parts)}." if additions else ""


def doubtful_additions(additions: Sequence[Addition]) -> tuple[Finding, ...]:
    """Return a warning for each addition if another cause would explain the residuals as well."""
    found: list[Finding] = []
    for one in additions:
        others = " or ".join(one.indistinguishable)
        text = f"{one.group} was added, but {others} would explain the residuals as well"
        if len(one.indistinguishable) > _MOST_NAMED:
            count = f"{len(one.indistinguishable)} other causes"
            text = (
                f"{one.group} was added, but {count} would explain the residuals as well: {others}"
            )
        if others:
            advice = "find out which one it is, and state it in the run file"
            found.append(Finding("warning", "also", f"{text}; {advice}"))
    return tuple(found)


def _grouped(chi2: float) -> str:
    return f"{chi2:,.0f}".replace(",", " ")
