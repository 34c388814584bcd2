"""The page of the terms, which the live page links to."""

from inercal.physics.glossary import glossary
from inercal.report.templates import render


def glossary_page() -> str:
    """Return the whole page, HTML."""
    return render("glossary.html", groups=glossary())
