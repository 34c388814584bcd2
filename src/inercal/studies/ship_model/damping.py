"""Damping: it solves the equations short of rank, and leaves what they do not tell as it was."""

from inercal.studies.claim import shown
from inercal.studies.section import Section
from inercal.studies.ship_model.estimators import Compared
from inercal.studies.ship_model.experiment import MILLI, median, over
from inercal.studies.words import words_of

WORDS = words_of("inercal.studies.ship_model", "damping")


def section(found: Compared) -> Section:
    """Return the section of the damped least squares."""
    norms, vectors = (
        [median(of(name) / MILLI) for name in ("damped", "planar")]
        for of in (found.norms, found.vectors)
    )
    worse = (found.vectors("damped") > found.vectors("planar")).mean()
    findings = (
        WORDS.judge("fits", *over(*norms),
            f"{shown(norms[1].value)} mg before, {shown(norms[0].value)} mg after: what is "
            "minimised falls"),
        WORDS.judge("betters", *over(*vectors),
            f"{shown(vectors[1].value)} mg before, {shown(vectors[0].value)} mg after; of "
            f"{worse:.0%} of the devices it is worse"),
    )  # fmt: skip
    return WORDS.section(findings)
