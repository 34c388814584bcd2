"""The page of a worksheet, to be printed and filled in by hand at the bench."""

from itertools import groupby

from inercal.basics.units import format_value_and_uncertainty
from inercal.estimation.uncertainty.coverage import COVERAGE
from inercal.pipeline.design.expected_uncertainty import ExpectedUncertainty
from inercal.pipeline.design.worksheet import Worksheet
from inercal.report.templates import render

_MAX_ROWS = 24  # rows of a group that one sheet of paper holds


def worksheet_page(made: Worksheet, table: str) -> str:
    """Return the whole page, HTML; `table` is the name of the file to be filled."""
    return render(
        "worksheet.html",
        run=made.run,
        sheet=made.sheet,
        columns=[(k, one) for k, one in enumerate(made.sheet.headings) if one.on_page],
        table=table,
        known=[_uncertainty_cells(one) for one in (*made.expected, *made.together)],
        together=made.together,
        alone=len(made.expected),
        groups=[(name, list(rows)) for name, rows in groupby(made.sheet.rows, lambda r: r.group)],
        most=_MAX_ROWS,
    )


def _uncertainty_cells(one: ExpectedUncertainty) -> tuple[str, str, str, str]:
    return (
        one.name,
        one.meaning,
        format_value_and_uncertainty(0.0, COVERAGE * one.std / one.size)[1],
        one.unit,
    )
