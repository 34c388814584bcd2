"""The form of a verdict for people: few short lines, and all that was found under headings."""

import re
from collections.abc import Iterable, Sequence
from typing import NamedTuple

MOST_CHARACTERS = 100  # of a line of a verdict
AGREEMENT = "How well the data agree with the model"
CAUSE = "What explains the residuals"
NEXT_STEPS = "What to do next"
UNCERTAINTIES = "Largest expanded uncertainties (k = 2)"
UNDETECTABLE = (
    "Not detectable from these data and not included in U (the size would shift a coefficient by "
    "5 u)"
)
REMARKS = "Remarks on the method and the data"
CHECKS = "Warnings of the checks"
NOTES = "Notes"
"""The heading of a file that states none."""
EXPLAIN, NEXT = "--explain lists them.", "Next: "
_OPERATOR_WORDS = re.compile(
    r"\[(?:sensor|bench|data|method|environment|specification|job)\b[\w.]*\]|(?<!\w)--[a-z]"
    r"|\brun file|\binercal [a-z]"
)
_PARTS = re.compile(r"(?<=[;.:]) ")
_LEAST = 20  # characters of a part that stands alone


class ExplanationSection(NamedTuple):
    """A heading with its lines."""

    heading: str
    lines: tuple[str, ...]


def fit(text: str, most: int = MOST_CHARACTERS) -> str:
    """Return a line that is not too long: whole clauses if possible, else whole words."""
    if len(text) <= most:
        return text
    ends = [one.start() for one in _PARTS.finditer(text) if _LEAST <= one.start() <= most]
    if ends:
        return text[: ends[-1]].rstrip(";:")
    kept = text[: most - 1]
    return f"{kept.rpartition(' ')[0] or kept}".rstrip(",;: ") + "…"


def first_fit(*texts: str) -> str:
    """Return the first of some lines, of which each says less, that is not too long."""
    return next((text for text in texts if len(text) <= MOST_CHARACTERS), fit(texts[-1]))


def fit_list(start: str, parts: Sequence[str], end: str = ".", separator: str = ", ") -> str:
    """Return a line of as many parts as it has place for, and how many are left out."""
    for count in range(len(parts), 0, -1):
        more = f" and {len(parts) - count} more" if count < len(parts) else ""
        text = f"{start}{separator.join(parts[:count])}{more}{end}"
        if len(text) <= MOST_CHARACTERS:
            return text
    return fit(f"{start}{separator.join(parts)}{end}")


def without_operator_words(text: str) -> str:
    """Return a text without its sentences and clauses of run files and the program's options."""
    kept = [part for part in _PARTS.split(text) if not _OPERATOR_WORDS.search(part)]
    joined = " ".join(kept)
    return joined if len(kept) == len(_PARTS.split(text)) else joined.rstrip(";:, ")


def customer_lines(lines: Iterable[str]) -> tuple[str, ...]:
    """Return lines without operator's words and without the next step."""
    kept = (without_operator_words(line) for line in lines if not line.startswith(NEXT))
    return tuple(filter(None, kept))


def customer_sections(sections: Sequence[ExplanationSection]) -> tuple[ExplanationSection, ...]:
    """Return what a customer may read of an explanation: no keys, no options, no next steps."""
    found = (
        ExplanationSection(heading, customer_lines(lines))
        for heading, lines in sections
        if heading != NEXT_STEPS
    )
    return tuple(section for section in found if section.lines)
