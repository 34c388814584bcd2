"""The page of a worksheet: printed, and filled in by hand at the head."""

from inercal.calibration.verdict import COVERAGE
from inercal.design.on_head import Known, Worksheet
from inercal.report.templates import render
from inercal.units import digits

_MOST = 24  # rows of a pass that one sheet of paper holds


def page(sheet: Worksheet, table: str) -> str:
    """Return the whole page, HTML; `table` is the name of the file to be filled."""
    return render(
        "worksheet.html",
        sheet=sheet,
        table=table,
        boxes=_boxes(sheet),
        known=[_cells(one) for one in (*sheet.expected, *sheet.together)],
        alone=len(sheet.expected),
        passes=sheet.rows[-1].in_pass,
        most=_MOST,
    )


def _boxes(sheet: Worksheet) -> list[tuple[str, str, str]]:
    """Return the columns that are filled in: kind, name and unit."""
    names = sheet.names
    found = [
        ("accelerometer", name, axis.readout.unit)
        for name, axis in zip(names.accelerometers, sheet.run.sensor.axes, strict=True)
    ]
    if sheet.bench.collimated != "none":
        found.append(("collimator", "autocollimator", names.autocollimator_unit))
    if names.level:
        found.append(("level", "level", names.level_unit))
    return found


def _cells(one: Known) -> tuple[str, str, str, str]:
    return one.name, one.meaning, digits(0.0, COVERAGE * one.std / one.size)[1], one.unit
