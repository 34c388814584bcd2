"""The worksheet of a run on a dividing head: its positions, and what they will give."""

from dataclasses import dataclass

from inercal.benches import DividingHead
from inercal.design.known import Known, alone, estimate_of_plan
from inercal.design.operator import Names, Row, notes, rows
from inercal.design.table import empty_table
from inercal.errors import InputError
from inercal.estimate import Estimate
from inercal.methods.dual_orthogonal.together import together
from inercal.pipeline.inputs import readback_units
from inercal.plan import Index
from inercal.runfile import Run
from inercal.sensors import Sensor


@dataclass(frozen=True, eq=False)
class Worksheet:
    """What the operator does, and what it will give.

    Parameters
    ----------
    run : Run
    bench : DividingHead
    names : Names
        Of the columns that are filled in.
    rows : tuple of Row
    notes : tuple of str
        What holds for all rows, in words.
    expected : tuple of Known
        Of each coefficient.
    together : tuple of Known
        Of sums that are known far better than their terms.
    """

    run: Run
    bench: DividingHead
    names: Names
    rows: tuple[Row, ...]
    notes: tuple[str, ...]
    expected: tuple[Known, ...]
    together: tuple[Known, ...]

    @property
    def seconds(self) -> float:
        """Of all holds."""
        return sum(row.step.seconds for row in self.rows)


def worksheet(run: Run) -> Worksheet:
    """Return the worksheet of a run on a dividing head. Its data are not looked at.

    Raises
    ------
    InputError
        A run on another bench, a plan that its autocollimation cannot have, or no noise.
    NotObserved
        Coefficients that the plan leaves open.
    """
    bench, steps = run.bench, [step for step in run.steps if isinstance(step, Index)]
    if not isinstance(bench, DividingHead):
        raise InputError(f"{run.path}: a worksheet is of a dividing head")
    names = _names(run)
    try:
        made = rows(bench, steps, recorded=bool(names.autocollimator))
    except InputError as error:
        raise InputError(f"{run.path}: {error}") from None
    estimate = estimate_of_plan(run, "positions")
    return Worksheet(
        run=run,
        bench=bench,
        names=names,
        rows=made,
        notes=notes(bench, steps, names),
        expected=alone(estimate, run.sensor),
        together=_together(estimate, run.sensor, bench.gravity.value),
    )


def as_csv(sheet: Worksheet) -> str:
    """Return the table to be filled, CSV: columns as [data] names them, readings empty.

    Filled, it is the [data] file of a run with kind = "means".

    Raises
    ------
    InputError
        A column that is given by its number.
    """
    data = sheet.run.data
    unit = readback_units(sheet.run)["angle"]
    label = [] if data.label is None else [data.label]
    rows = [[row.step.label] * len(label) + [f"{row.step.angle / unit:.12g}"] for row in sheet.rows]
    header = (*label, data.angle, *data.accelerometer, data.autocollimator, data.level)
    return empty_table(sheet.run, header, rows)


def _names(run: Run) -> Names:
    data = run.data
    return Names(
        tuple(map(str, data.accelerometer)),
        "" if data.autocollimator is None else str(data.autocollimator),
        data.autocollimator_unit,
        "" if data.level is None else str(data.level),
        data.level_unit,
    )


def _together(estimate: Estimate, sensor: Sensor, g: float) -> tuple[Known, ...]:
    lines = [(one, sensor.coefficient(one.terms[0])) for one in together(estimate, g)]
    return tuple(Known(one.name, one.meaning, line.unit, line.si, one.sd) for one, line in lines)
