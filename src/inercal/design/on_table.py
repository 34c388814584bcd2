"""The worksheet of a run on a rate table: its states, and what they will give."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray

from inercal.benches import RateTable
from inercal.benches.rate_table.bench import felt, mountings
from inercal.benches.rate_table.fixture import PLANES, by_mounting, tilted
from inercal.design.known import Known, alone, estimate_of_plan
from inercal.design.table import empty_table
from inercal.errors import InputError
from inercal.pipeline.inputs import readback_units
from inercal.plan import Hold, Spin
from inercal.runfile import Run

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class State:
    """A state and what is felt in it.

    Parameters
    ----------
    number : int
        From 1.
    mounting : str
    step : Spin
    felt : (3,) array
        Along the axes, nominally, m/s².
    """

    number: int
    mounting: str
    step: Spin
    felt: Array

    @property
    def up(self) -> str:
        """What points up, in words."""
        assert self.step.attitude is not None
        return Hold("", self.step.attitude.up, 0.0).in_words()

    @property
    def rpm(self) -> float:
        """Rate, r/min."""
        return self.step.rate * 30 / pi


@dataclass(frozen=True, eq=False)
class TableSheet:
    """What the operator of a rate table does, and what it will give.

    Parameters
    ----------
    run : Run
    rows : tuple of State
        Mounting by mounting, in each by speed.
    notes : tuple of str
        What holds for all rows, in words.
    expected : tuple of Known
        Of each coefficient.
    """

    run: Run
    rows: tuple[State, ...]
    notes: tuple[str, ...]
    expected: tuple[Known, ...]

    @property
    def seconds(self) -> float:
        """Of all states."""
        return sum(row.step.seconds for row in self.rows)


def worksheet(run: Run) -> TableSheet:
    """Return the worksheet of a run on a rate table. Its data are not looked at.

    Raises
    ------
    InputError
        A run on another bench, or no noise.
    NotObserved
        Coefficients that the plan leaves open.
    """
    bench = run.bench
    if not isinstance(bench, RateTable):
        raise InputError(f"{run.path}: this worksheet is of a rate table")
    planned = [step for step in run.steps if isinstance(step, Spin)]
    steps = [step for own in by_mounting(planned) for step in own]
    rows = tuple(
        State(k, name, step, f)
        for k, (name, step, f) in enumerate(
            zip(mountings(steps), steps, felt(bench, steps, {}).f, strict=True), start=1
        )
    )
    estimate = estimate_of_plan(run, "states")
    return TableSheet(run, rows, notes(rows), alone(estimate, run.sensor))


def as_csv(sheet: TableSheet) -> str:
    """Return the table to be filled, CSV: columns as [data] names them, readings empty.

    Filled, it is the [data] file of a run with kind = "means".

    Raises
    ------
    InputError
        A column that is given by its number.
    """
    data, size = sheet.run.data, readback_units(sheet.run)["arm_rate"]
    rows = [[row.mounting, f"{row.step.rate / size:.12g}"] for row in sheet.rows]
    return empty_table(sheet.run, (data.mounting, data.arm_rate, *data.accelerometer), rows)


def notes(rows: Sequence[State]) -> tuple[str, ...]:
    """Return what holds for all rows, in words."""
    level = ", ".join(
        f"{plane} is {centre} to the centre and {up} up"
        for plane, (centre, up) in PLANES.items()
        if any(row.mounting.startswith(plane) for row in rows)
    )
    found = [f"Mountings: {level}."]
    if any(tilted(row.step) for row in rows):
        found.append(
            "XY 30 is XY turned by 30° about the tangential direction, the axis that was toward "
            "the centre rising: mind which axis comes up."
        )
    return (
        *found,
        "Leave a mounting for all its speeds; its angles and its radius are then the same.",
        "At each speed wait until the rate is steady, then take the mean over whole turns.",
        "Readings are said for a sensor without errors: look for exchanged or reversed axes.",
        "A state that went wrong is taken out: its row goes from the file.",
    )
