"""The section of a sensor's history that says when to calibrate next."""

from markupsafe import Markup

from inercal.report.report_tables import typeset_minus
from inercal.report.templates import render
from inercal.store.recalibration import Recalibration
from inercal.store.recalibration_text import (
    interval_table,
    limit_text,
    recalibration_lines,
)


def recalibration_section(found: Recalibration) -> Markup:
    """Return the table of intervals and what follows from it, HTML."""
    heads, cells = interval_table(found)
    rows = [
        (one.name, typeset_minus(limit_text(found, one)), *row)
        for one, row in zip(found.rows, cells, strict=True)
    ]
    lines = [f"{line[0].upper()}{line[1:]}." for line in recalibration_lines(found)]
    return Markup(render("recalibration.html", heads=heads, rows=rows, lines=lines))
