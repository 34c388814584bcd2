"""The page of a study: one HTML file that needs nothing but itself, in the look of the report."""

from collections import Counter
from importlib.resources import files

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from inercal.studies.charts import draw
from inercal.studies.claim import shown
from inercal.studies.section import Study

TONES = {"reproduced": "good", "not reproducible": "care", "false": "bad"}


def page(study: Study) -> str:
    """Return the whole page, HTML."""
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    folder = files("inercal.studies")
    template = environment.from_string((folder / "study.html").read_text(encoding="utf-8"))
    sheets = (files("inercal.report") / "page.css", folder / "study.css")
    counted = Counter(finding.verdict for finding in study.findings)
    return template.render(
        css=Markup("\n".join(sheet.read_text(encoding="utf-8") for sheet in sheets)),
        study=study,
        counts=[(verdict, counted[verdict], TONES[verdict]) for verdict in TONES],
        tones=TONES,
        draw=draw,
        shown=shown,
    )
