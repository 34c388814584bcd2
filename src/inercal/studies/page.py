"""The page of a study: one HTML file that needs nothing but itself, in the look of the report."""

from collections import Counter

from inercal.report.templates import render
from inercal.studies.charts import draw
from inercal.studies.claim import shown
from inercal.studies.section import Study

TONES = {"reproduced": "good", "not reproducible": "care", "false": "bad"}


def page(study: Study) -> str:
    """Return the whole page, HTML."""
    counted = Counter(finding.verdict for finding in study.findings)
    return render(
        "study.html",
        "inercal.studies",
        study=study,
        counts=[(verdict, counted[verdict], TONES[verdict]) for verdict in TONES],
        tones=TONES,
        draw=draw,
        shown=shown,
    )
