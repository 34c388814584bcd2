"""Damping: it solves the equations short of rank, and leaves what they do not tell as it was."""

from inercal.studies.claim import format_significant
from inercal.studies.section_texts import read_section_text
from inercal.studies.ship_model.estimators import EstimatorComparison
from inercal.studies.ship_model.simulated_rate_table import MILLI, median_estimate, median_ratio
from inercal.studies.study_content import StudySection

TEXT = read_section_text("inercal.studies.ship_model", "damping")


def section(found: EstimatorComparison) -> StudySection:
    """Return the section of the damped least squares."""
    norms, vectors = (
        [median_estimate(of(name) / MILLI) for name in ("damped", "planar")]
        for of in (found.norms, found.vector_errors)
    )
    worse = (found.vector_errors("damped") > found.vector_errors("planar")).mean()
    findings = (
        TEXT.judge("fits", *median_ratio(*norms),
            f"{format_significant(norms[1].value)} mg before, {format_significant(norms[0].value)} "
            "mg after: what is minimised falls"),
        TEXT.judge("betters", *median_ratio(*vectors),
            f"{format_significant(vectors[1].value)} mg before, "
            f"{format_significant(vectors[0].value)} mg after; of {worse:.0%} of the devices it is "
            "worse"),
    )  # fmt: skip
    return TEXT.section(findings)
