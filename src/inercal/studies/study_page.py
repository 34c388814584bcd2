"""The page of a study: one HTML file that needs nothing but itself, in the look of the report."""

from collections import Counter

from inercal.report.templates import render
from inercal.studies.charts import draw_chart
from inercal.studies.claim import format_significant
from inercal.studies.study_content import Study

TONES = {"reproduced": "good", "not reproducible": "care", "false": "bad"}


def render_study(study: Study) -> str:
    """Return the whole page, HTML."""
    counted = Counter(finding.verdict for finding in study.findings)
    return render(
        "study.html",
        "inercal.studies",
        study=study,
        counts=[(verdict, counted[verdict], TONES[verdict]) for verdict in TONES],
        tones=TONES,
        draw=draw_chart,
        shown=format_significant,
    )
