"""The worksheet of a run on a dividing head: its positions, and what they will give.

What is expected is what the run's estimator states of readings made by the bench as declared, with
the noise and the priors as stated (`inercal.budget.experiment`).
"""

import csv
from dataclasses import dataclass
from io import StringIO

import numpy as np

from inercal.benches import DividingHead
from inercal.budget.of_run import experiment_of
from inercal.design.operator import Names, Row, notes, rows
from inercal.errors import InputError, NotObserved
from inercal.estimate import Estimate
from inercal.methods.dual_orthogonal.together import together
from inercal.pipeline.inputs import readback_units
from inercal.plan import Index
from inercal.runfile import Run
from inercal.sensors import Sensor


@dataclass(frozen=True)
class Known:
    """How well a coefficient, or a sum of two, will be known.

    Parameters
    ----------
    name, meaning : str
    unit : str
        As it is printed.
    size : float
        SI size of the unit.
    std : float
        Standard uncertainty, SI.
    """

    name: str
    meaning: str
    unit: str
    size: float
    std: float


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
    estimate = _estimate(run)
    return Worksheet(
        run=run,
        bench=bench,
        names=names,
        rows=made,
        notes=notes(bench, steps, names),
        expected=_alone(estimate, run.sensor),
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
    named = (data.label, data.angle, *data.accelerometer, data.autocollimator, data.level)
    header = [column for column in named if column is not None]
    for column in header:
        if isinstance(column, int):
            raise InputError(
                f"{sheet.run.path}: [data] gives column {column} by its number; a worksheet needs "
                "the names of its columns"
            )
    unit = readback_units(sheet.run)["angle"]
    text = StringIO()
    lines = csv.writer(text, lineterminator="\n")
    lines.writerow(header)
    for row in sheet.rows:
        label = [] if data.label is None else [row.step.label]
        stated = [*label, f"{row.step.angle / unit:.12g}"]
        lines.writerow([*stated, *[""] * (len(header) - len(stated))])
    return text.getvalue()


def _names(run: Run) -> Names:
    data = run.data
    return Names(
        tuple(map(str, data.accelerometer)),
        "" if data.autocollimator is None else str(data.autocollimator),
        data.autocollimator_unit,
        "" if data.level is None else str(data.level),
        data.level_unit,
    )


def _estimate(run: Run) -> Estimate:
    experiment = experiment_of(run)
    try:
        estimate = experiment.estimate()
    except NotObserved as error:
        raise NotObserved(
            f"{run.path}: the plan of {len(run.steps)} positions leaves open what is asked for: "
            f"{error}",
            error.directions,
        ) from None
    except InputError as error:
        raise InputError(f"{run.path}: {error}") from None
    if not (np.all(estimate.converged) and np.isfinite(estimate.covariance).all()):
        raise InputError(
            f"{run.path}: estimator {run.estimator} finds no result of this plan: look at the "
            "noise as stated and at [sensor.truth]"
        )
    return estimate


def _alone(estimate: Estimate, sensor: Sensor) -> tuple[Known, ...]:
    found: list[Known] = []
    # As modelled: by how much one draw of the noise scatters is no matter of the plan.
    variance = np.diagonal(estimate.covariance)
    for name, std in zip(sensor.coefficients, np.sqrt(variance).tolist(), strict=False):
        line = sensor.coefficient(name)
        found.append(Known(name, line.meaning, line.unit, line.si, std))
    return tuple(found)


def _together(estimate: Estimate, sensor: Sensor, g: float) -> tuple[Known, ...]:
    lines = [(one, sensor.coefficient(one.terms[0])) for one in together(estimate, g)]
    return tuple(Known(one.name, one.meaning, line.unit, line.si, one.sd) for one, line in lines)
