"""The worksheet of a run: steps for the operator, the table to fill, expected uncertainties."""

import csv
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from io import StringIO

from inercal.basics.errors import InputError
from inercal.benches.operator_sheet import Sheet
from inercal.estimation import Estimate
from inercal.methods.dual_orthogonal import well_determined_sums
from inercal.physics.sensors import Sensor
from inercal.pipeline.design.expected_uncertainty import (
    ExpectedUncertainty,
    estimate_of_plan,
    estimated_uncertainties,
)
from inercal.runfile import Run


@dataclass(frozen=True, eq=False)
class Worksheet:
    """Steps for the operator, and expected uncertainties.

    Parameters
    ----------
    run : Run
    sheet : Sheet
    expected : tuple of ExpectedUncertainty
        Of each coefficient.
    together : tuple of ExpectedUncertainty
        Of sums that are determined far better than their terms, if the sheet lists sums.
    """

    run: Run
    sheet: Sheet
    expected: tuple[ExpectedUncertainty, ...]
    together: tuple[ExpectedUncertainty, ...]


def run_sheet(run: Run) -> Sheet:
    """Return the steps for the operator of a run.

    Raises
    ------
    InputError
        A bench whose plans are fixed, or a plan that it cannot carry out.
    """
    if run.kind.sheet is None:
        raise InputError(
            f"{run.path}: a bench of kind {run.kind.name} has no worksheet; use another bench",
            file=run.path,
            key="[bench] kind",
        )
    sheet, temperature = run.kind.sheet(run), run.data.temperature
    if temperature is None or temperature in sheet.columns:
        return sheet
    units = {**sheet.units, str(temperature): run.data.temperature_unit}
    return replace(sheet, columns=(*sheet.columns, temperature), units=units)


def build_worksheet(run: Run) -> Worksheet:
    """Return the worksheet of a run. Its data are not read.

    Raises
    ------
    InputError
        A bench whose plans are fixed, a plan that it cannot carry out, or no noise.
    NotObserved
        Coefficients that the plan does not determine.
    """
    sheet = run_sheet(run)
    estimate = estimate_of_plan(run, run.kind.words.rows)
    sums = _sum_uncertainties(estimate, run.sensor, run.bench.gravity.value) if sheet.sums else ()
    return Worksheet(run, sheet, estimated_uncertainties(estimate, run.sensor), sums)


def worksheet_csv(made: Worksheet) -> str:
    """Return the table to be filled, CSV: settings are filled in, readings are empty.

    The filled table is the [data] file of a run with kind = "means".

    Raises
    ------
    InputError
        A column that is given by its number or for two quantities, or a run whose means in a table
        would not suffice.
    """
    return rows_as_csv(table_rows(made.run, made.sheet))


def rows_as_csv(rows: Iterable[Sequence[str]]) -> str:
    """Return rows of cells as CSV."""
    text = StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def table_rows(run: Run, sheet: Sheet) -> list[list[str]]:
    """Return the header and the rows of the table to be filled, cells to be filled empty.

    Raises
    ------
    InputError
        As of `worksheet_csv`.
    """
    if sheet.table_error is not None:
        raise sheet.table_error
    columns = [column for column in sheet.columns if column is not None]
    for column in columns:
        if isinstance(column, int):
            raise InputError(
                f"{run.path}: [data] gives column {column} by its number; a worksheet needs "
                "names: replace the number by a name",
                file=run.path,
                key="[data]",
                names=(str(column),),
            )
    names = [str(column) for column in columns]
    if twice := [name for name, count in Counter(names).items() if count > 1]:
        raise InputError(
            f"{run.path}: [data] names column {twice[0]!r} for two quantities; name a different "
            "column for each",
            file=run.path,
            key="[data]",
            names=(twice[0],),
        )
    rows = [[*row.given, *[""] * (len(columns) - len(row.given))] for row in sheet.rows]
    return [names, *rows]


def _sum_uncertainties(
    estimate: Estimate, sensor: Sensor, g: float
) -> tuple[ExpectedUncertainty, ...]:
    lines = [(one, sensor.coefficient(one.terms[0])) for one in well_determined_sums(estimate, g)]
    return tuple(
        ExpectedUncertainty(one.name, one.meaning, line.unit, line.si, one.sd)
        for one, line in lines
    )
