"""Tables of means, typed by hand or made elsewhere: read straight in as observations.

One row a position or turn: its label, the mean reading of each axis in output units, for turns
the section's duration. The standard deviation of the means is stated, it cannot be found here.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from inercal.errors import InputError
from inercal.io.read import Columns, read_table
from inercal.io.table import Table
from inercal.recording import Observations
from inercal.sensors import Sensor

Array = NDArray[np.float64]


def read_means(
    path: Path, columns: Columns, sensor: Sensor, sd: dict[str, float], seconds: str | None
) -> Observations:
    """Read a table of means.

    Parameters
    ----------
    path : Path
    columns : Columns
        `label` and `channels` are used.
    sensor : Sensor
        Axes in the order wanted, with readouts.
    sd : mapping
        Standard deviation of a mean in SI, by what an axis measures ("f", "w").
    seconds : str or None
        Column of durations in s; 1 s where there is none.

    Raises
    ------
    InputError
        A column is missing, a value is not finite, a label returns, or no deviation is stated.
    """
    if columns.label is None:
        raise InputError(f"{path}: [data] label is missing: name the column of position labels")
    table = read_columns(path, columns, [] if seconds is None else [seconds])
    labels = tuple(str(label).strip() for label in table.columns[columns.label])
    durations = np.ones(len(labels)) if seconds is None else table.numbers(seconds)
    return means_of(path, table, labels, columns, sensor, sd, durations)


def read_columns(path: Path, columns: Columns, more: Sequence[str]) -> Table:
    """Return the table, once it has the columns that are used.

    Parameters
    ----------
    path : Path
    columns : Columns
        `label`, if any, and `channels`.
    more : sequence of str
        Other columns that are wanted.

    Raises
    ------
    InputError
        A column is missing.
    """
    table = read_table(path)
    label = () if columns.label is None else (columns.label,)
    for name in (*label, *(name for _, name, _ in columns.channels), *more):
        if name not in table.columns:
            raise InputError(f"{path}: no column {name!r}; it has {', '.join(table.columns)}")
    return table


def means_of(
    path: Path,
    table: Table,
    labels: tuple[str, ...],
    columns: Columns,
    sensor: Sensor,
    sd: Mapping[str, float],
    durations: Array,
) -> Observations:
    """Return the rows of a table as observations.

    Parameters
    ----------
    path : Path
        For messages.
    table : Table
    labels : tuple of r str
        Names of the rows.
    columns, sensor, sd
        As of `read_means`.
    durations : (r,) array
        s.

    Raises
    ------
    InputError
        A value is not finite, a label returns, or no deviation is stated.
    """
    twice = sorted({label for label in labels if labels.count(label) > 1})
    if twice:
        raise InputError(f"{path}: position {twice[0]!r} comes in several rows; give one mean each")
    by_axis = {axis: name for axis, name, _ in columns.channels}
    output = np.empty((len(labels), len(sensor.axes)))
    for k, axis in enumerate(sensor.axes):
        column = table.columns[by_axis[axis.name]]
        if column.dtype.kind != "f":
            raise InputError(f"{path}: column {by_axis[axis.name]!r} holds words, not numbers")
        bad = np.flatnonzero(~np.isfinite(column))
        if bad.size:
            raise InputError(
                f"{path} line {table.first_line + bad[0]}: column {by_axis[axis.name]!r} is not "
                "finite; give the mean or take the row out"
            )
        output[:, k] = column
    kinds = {axis.measures for axis in sensor.axes}
    if missing := kinds - set(sd):
        name = {"f": "accelerometer", "w": "gyro"}[missing.pop()]
        raise InputError(f"{path}: [data.sd] {name} is missing: state the sd of a mean, with unit")
    deviation = np.array([sd[axis.measures] for axis in sensor.axes])
    if not (np.isfinite(durations) & (durations > 0)).all():
        raise InputError(f"{path}: durations must be positive numbers of s")
    return Observations(
        labels=labels,
        mean=sensor.to_si(output),
        covariance=np.broadcast_to(np.diag(deviation**2), (len(labels), *[len(deviation)] * 2)),
        duration=durations,
        samples=np.ones(len(labels), dtype=np.int64),
        time=np.arange(len(labels), dtype=float),
        channels=sensor.channels,
    )
