"""Make the worksheet of a run: steps for the operator, a table to fill in, and uncertainties."""

import csv
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from io import StringIO

from inercal.basics.errors import InputError
from inercal.benches.operator_sheet import Sheet
from inercal.estimation import Estimate
from inercal.methods.dual_orthogonal import well_determined_sums
from inercal.physics.sensors import Sensor
from inercal.pipeline.budget.experiment_from_runfile import omitted_drift_notes
from inercal.pipeline.design import plan_rehearsal
from inercal.recordings.data.recording_loader import refuse_repeated_columns
from inercal.runfile import Run


@dataclass(frozen=True, eq=False)
class Worksheet:
    """A worksheet with the steps for the operator and the expected uncertainties.

    Parameters
    ----------
    run : Run
    sheet : Sheet
    expected : tuple of ExpectedUncertainty
        Expected uncertainty of each coefficient.
    together : tuple of ExpectedUncertainty
        Expected uncertainties of sums that are far better determined than their terms, if the sheet
        lists sums.
    """

    run: Run
    sheet: Sheet
    expected: tuple[plan_rehearsal.ExpectedUncertainty, ...]
    together: tuple[plan_rehearsal.ExpectedUncertainty, ...]


def run_sheet(run: Run) -> Sheet:
    """Return the sheet with the steps that the operator of a run must carry out.

    Raises
    ------
    InputError
        If the bench has fixed plans or cannot carry out the plan.
    """
    if run.kind.sheet is None:
        raise InputError(
            f"a bench of kind {run.kind.name} has no worksheet; use another bench",
            key="[bench] kind",
        ).located(run.path)
    sheet, temperature = run.kind.sheet(run), run.data.temperature
    if temperature is None or temperature in sheet.columns:
        return sheet
    units = {**sheet.units, str(temperature): run.data.temperature_unit}
    return replace(sheet, columns=(*sheet.columns, temperature), units=units)


def build_worksheet(run: Run) -> Worksheet:
    """Return the worksheet of a run; the data are not read.

    Raises
    ------
    InputError
        If the bench has fixed plans or cannot carry out the plan, or if no noise is stated.
    NotObserved
        If the plan does not determine all coefficients.
    """
    sheet = run_sheet(run)
    sheet = replace(sheet, notes=(*sheet.notes, *omitted_drift_notes(run)))
    estimate = plan_rehearsal.estimate_of_plan(run, run.kind.words.rows)
    sums = _sum_uncertainties(estimate, run.sensor, run.bench.gravity.value) if sheet.sums else ()
    expected = plan_rehearsal.estimated_uncertainties(estimate, run.sensor)
    return Worksheet(run, sheet, (*expected, *plan_rehearsal.magnetometer_uncertainties(run)), sums)


def worksheet_csv(made: Worksheet) -> str:
    """Return the table to fill in as CSV; settings are filled in, and readings are empty.

    The completed table can be the [data] file of a run with kind = "means".

    Raises
    ------
    InputError
        If a column is given by number or is used for two quantities, or if the run needs more than
        a table of means.
    """
    return rows_as_csv(table_rows(made.run, made.sheet))


def rows_as_csv(rows: Iterable[Sequence[str]]) -> str:
    """Return rows of cells as CSV text."""
    text = StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def table_rows(run: Run, sheet: Sheet) -> list[list[str]]:
    """Return the header and the rows of the table to fill in; cells to fill in are empty.

    Raises
    ------
    InputError
        See `worksheet_csv`.
    """
    if sheet.table_error is not None:
        raise sheet.table_error
    columns = [column for column in sheet.columns if column is not None]
    for column in columns:
        if isinstance(column, int):
            raise InputError(
                f"[data] gives column {column} by its number, but a worksheet needs names: "
                "replace the number by a name",
                key="[data]",
                names=(str(column),),
            ).located(run.path)
    names = [str(column) for column in columns]
    refuse_repeated_columns(run, names)
    rows = [[*row.given, *[""] * (len(columns) - len(row.given))] for row in sheet.rows]
    return [names, *rows]


def _sum_uncertainties(
    estimate: Estimate, sensor: Sensor, g: float
) -> tuple[plan_rehearsal.ExpectedUncertainty, ...]:
    lines = [(one, sensor.coefficient(one.terms[0])) for one in well_determined_sums(estimate, g)]
    return tuple(
        plan_rehearsal.ExpectedUncertainty(one.name, one.meaning, line.unit, line.si, one.sd)
        for one, line in lines
    )
