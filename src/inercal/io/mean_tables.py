"""Tables of means, typed by hand or made elsewhere: read straight in as observations.

One row a position or turn: its label, the mean reading of each axis in output units, for turns
the section's duration. The standard deviation of the means is stated, it cannot be found here: one
for all rows, or that of each in columns beside its means, `ax_sd` for `ax`.
"""

import csv
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from inercal.errors import InputError
from inercal.io.atomic_files import atomic_write
from inercal.io.column_table import Array, Table, shorten
from inercal.io.read import Columns, read_table
from inercal.recording import Observations
from inercal.sensors import Axis, Sensor
from inercal.units import to_si

_ROWS = 4  # fewer may well agree to the last digit
SD_SUFFIX = "_sd"  # behind the name of a column: its standard deviation


def read_means(
    path: Path,
    columns: Columns,
    sensor: Sensor,
    sd: dict[str, float],
    seconds: str | None,
    row_names: Callable[[Sequence[str]], Sequence[str]] = tuple,
) -> Observations:
    """Read a table of means.

    Parameters
    ----------
    path : Path
    columns : Columns
        `label`, `channels` and `temperature` are used.
    sensor : Sensor
        Axes in the order wanted, with readouts.
    sd : mapping
        Standard deviation of a mean in SI, by what an axis measures ("f", "w"). Where one is
        missing, columns of the table hold it, in output units.
    seconds : str or None
        Column of durations in s; 1 s where there is none.
    row_names : callable, optional
        From the labels of the rows to names of their own.

    Raises
    ------
    InputError
        A column is missing, a value is not finite, a label returns, or no deviation is stated.
    """
    if columns.label is None:
        raise InputError(f"{path}: [data] label is missing: name the column of position labels")
    table = read_columns(path, columns, [] if seconds is None else [seconds])
    labels = tuple(row_names([str(label).strip() for label in table.columns[columns.label]]))
    durations = np.ones(len(labels)) if seconds is None else table.numbers(seconds)
    return observations_from_table(path, table, labels, columns, sensor, sd, durations)


def read_columns(path: Path, columns: Columns, extra_columns: Sequence[str]) -> Table:
    """Return the table, once it has the columns that are used.

    Parameters
    ----------
    path : Path
    columns : Columns
        `label` and `temperature`, if any, and `channels`.
    extra_columns : sequence of str
        Other columns that are wanted.

    Raises
    ------
    InputError
        A column is missing.
    """
    table = read_table(path, options=columns.options)
    beside = [name for name in (columns.label, columns.temperature) if name is not None]
    for name in (*beside, *(name for _, name, _ in columns.channels), *extra_columns):
        if name not in table.columns:
            raise InputError(f"{path}: no column {name!r}; it has {', '.join(table.columns)}")
    return table


def observations_from_table(
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
        A value is not finite, a label returns, a column is the same in all rows, or no deviation
        is stated.
    """
    twice = sorted({label for label in labels if labels.count(label) > 1})
    if twice:
        raise InputError(f"{path}: position {twice[0]!r} comes in several rows; give one mean each")
    by_axis = {axis: name for axis, name, _ in columns.channels}
    output = np.empty((len(labels), len(sensor.axes)))
    for k, axis in enumerate(sensor.axes):
        output[:, k] = number_column(path, table, by_axis[axis.name], "give the mean")
        _require_within_range(path, table, by_axis[axis.name], axis, output[:, k])
    _refuse_constant_column(path, output, sensor, by_axis)
    if not (np.isfinite(durations) & (durations > 0)).all():
        raise InputError(f"{path}: durations must be positive numbers of s")
    deviation = _standard_deviations(path, table, by_axis, sensor, sd)
    warmth = None
    if columns.temperature is not None:
        read = number_column(path, table, columns.temperature, "give the temperature")
        warmth = to_si(read, columns.temperature_unit, like="K")
    return Observations(
        labels=labels,
        mean=sensor.to_si(output),
        covariance=deviation[..., None] ** 2 * np.eye(len(sensor.axes)),
        duration=durations,
        samples=np.ones(len(labels), dtype=np.int64),
        time=np.arange(len(labels), dtype=float),
        channels=sensor.channels,
        timed=False,
        temperature=warmth,
    )


def _refuse_constant_column(
    path: Path, output: Array, sensor: Sensor, by_axis: Mapping[str, str]
) -> None:
    """Refuse a column that is the same in all rows while its like change."""
    if len(output) < _ROWS:
        return
    constant = (output == output[0]).all(axis=0)
    for k, axis in enumerate(sensor.axes):
        like = [j for j, other in enumerate(sensor.axes) if other.measures == axis.measures]
        if constant[k] and not constant[like].all():
            raise InputError(
                f"{path}: column {by_axis[axis.name]!r} is {output[0, k]:.6g} in all rows while "
                "others change: was the axis connected, and is it this column?"
            )


def _require_within_range(path: Path, table: Table, name: str, axis: Axis, mean: Array) -> None:
    """Refuse a mean at or beyond the full scale: some of its samples were clipped."""
    reach = axis.readout.full_scale
    beyond = np.flatnonzero(np.abs(mean - axis.readout.offset) >= (reach or np.inf))
    if beyond.size:
        raise InputError(
            f"{path} line {table.first_line + beyond[0]}: column {name!r} is "
            f"{mean[beyond[0]]:g}, at or beyond the full_scale that [sensor] states; take the row "
            "out or correct full_scale"
        )


def number_column(path: Path, table: Table, name: str, remedy: str) -> Array:
    """Return a column of numbers, (r,).

    Parameters
    ----------
    path : Path
        For messages.
    table : Table
    name : str
    remedy : str
        What to do where a cell holds none.

    Raises
    ------
    InputError
        A cell that holds none, with its line.
    """
    column = table.columns[name]
    cells: list[object] = column.tolist()
    for k, cell in enumerate(cells):
        if isinstance(cell, float) and np.isfinite(cell):
            continue
        where = f"{path} line {table.first_line + k}: column {name!r}"
        if isinstance(cell, str) and cell.strip() and not _is_number(cell):
            raise InputError(f"{where}: {shorten(cell)!r} is not a number")
        if not isinstance(cell, str) or not _is_number(cell):
            raise InputError(f"{where} is empty or not finite; {remedy} or take the row out")
    return table.numbers(name)


def _is_number(cell: str) -> bool:
    try:
        return bool(np.isfinite(float(cell)))
    except ValueError:
        return False


def _standard_deviations(
    path: Path,
    table: Table,
    by_axis: Mapping[str, str],
    sensor: Sensor,
    sd: Mapping[str, float],
) -> Array:
    """Return the standard deviation of each mean, (r, m) SI, as stated or of the rows' own."""
    rows = next(iter(table.columns.values())).size
    found: list[Array] = []
    for axis in sensor.axes:
        if axis.measures in sd:
            found.append(np.full(rows, sd[axis.measures]))
            continue
        name = by_axis[axis.name] + SD_SUFFIX
        if name not in table.columns:
            kind = {"f": "accelerometer", "w": "gyro"}[axis.measures]
            raise InputError(
                f"{path}: [data.sd] {kind} is missing: state the sd of a mean, with unit, or give "
                f"that of each row in columns, {name!r} and alike"
            )
        own = number_column(path, table, name, "give the deviation of the mean")
        if (bad := np.flatnonzero(own <= 0)).size:
            raise InputError(
                f"{path} line {table.first_line + bad[0]}: column {name!r} is {own[bad[0]]:g}; "
                "a standard deviation is positive"
            )
        found.append(own / abs(axis.readout.scale))
    return np.stack(found, axis=-1)


def write_means(
    path: str | os.PathLike[str], columns: Mapping[str, Sequence[str | float | int]]
) -> None:
    """Write a table of means, CSV, whole or not at all; numbers with all their digits.

    Parameters
    ----------
    path : path
    columns : mapping of str to sequence of r str or numbers
        By their names, in order.

    Raises
    ------
    InputError
        A path that cannot be written.
    """
    with atomic_write(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        lines = csv.writer(file, lineterminator="\n")
        lines.writerow(columns)
        lines.writerows(zip(*columns.values(), strict=True))
