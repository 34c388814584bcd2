"""Read tables of means, typed by hand or computed by another program, as observations.

Each row is a position or turn. It contains its label, the mean reading of each axis in output units
and, for turns, the duration of the section. The standard deviation of the means does not follow
from the table. The user states one value for all rows, or adds columns with the value of each row,
"ax_sd" for "ax".
"""

import csv
import os
from collections.abc import Callable, Mapping, Sequence
from math import comb, isnan
from pathlib import Path

import numpy as np

from inercal.basics.arrays import Array, median_of_rows
from inercal.basics.atomic_files import atomic_write
from inercal.basics.errors import InputError
from inercal.estimation.uncertainty.rounding import last_digit
from inercal.physics.quantities import QUANTITIES
from inercal.physics.sensors import Axis, Sensor
from inercal.recordings import Finding, Observations, ReadingSteps, add_rounding
from inercal.recordings.io.column_table import (
    DECIMAL_COMMA,
    MIXED_MARKS,
    TOO_LARGE,
    Table,
    shorten,
)
from inercal.recordings.io.read import Columns, read_table
from inercal.recordings.rounding_errors import NOISY

_FEW_DIGITS = 3  # units of the last digit; means that differ by less may be equal
_OF_NOISE = 0.01  # share of a mean's variance, below which rounding to the last digit is ignored
_ONE_DIGIT = 0.1  # of the largest mean: whole numbers such as 1 and 0 g are not what was read
_ROWS = 4  # in tables with fewer rows, means may agree to the last digit
_BY_CHANCE = 1e-3  # expected number of equal pairs, below which equal rows are copies
_NEAR = 3.0  # standard deviations; readings so far apart may have the same expectation
_DIGITS, _LEAST = 12, 1e-300  # digits that survive the conversion to SI, and a mean that is not 0
SD_SUFFIX = "_sd"  # suffix of the column with a column's standard deviation

_OPEN_CELL = "write the mean, go on with inercal measure,"  # before "or remove the row"


def read_means(
    path: Path,
    columns: Columns,
    sensor: Sensor,
    sd: dict[str, float],
    seconds: str | None,
    row_names: Callable[[Sequence[str]], Sequence[str]] = tuple,
) -> Observations:
    """Read a table of means from a file.

    Parameters
    ----------
    path : Path
    columns : Columns
        Columns to read; only `label`, `channels` and `temperature` are used.
    sensor : Sensor
        Sensor whose axes are in the wanted order, with readouts.
    sd : mapping
        Standard deviation of a mean in SI, by the quantity that an axis measures ("f", "w"). For
        other quantities, columns of the table contain it in output units.
    seconds : str or None
        Name of the column with durations in s; None for 1 s in each row.
    row_names : callable, optional
        Function that converts row labels to distinct names. Without a column of labels, the rows
        are numbered from 1.

    Raises
    ------
    InputError
        A column is missing, a value is not finite, a label is repeated, or no deviation is stated.
    """
    table = read_columns(path, columns, [] if seconds is None else [seconds])
    if columns.label is None:
        labels = tuple(map(str, range(1, table.rows + 1)))
    else:
        labels = tuple(row_names([str(label).strip() for label in table.columns[columns.label]]))
    durations = None if seconds is None else table.numbers(seconds)
    return observations_from_table(path, table, labels, columns, sensor, sd, durations)


def read_columns(path: Path, columns: Columns, extra_columns: Sequence[str]) -> Table:
    """Read a table, and refuse it if a required column is missing.

    Parameters
    ----------
    path : Path
    columns : Columns
        Required columns: `channels`, and `label` and `temperature` if given.
    extra_columns : sequence of str
        Other required columns.

    Raises
    ------
    InputError
        A column is missing.
    """
    # Labels are text, also in a file in which only some of them look like numbers.
    needed = [*(name for _, name, _ in columns.channels), *extra_columns]
    needed += [] if columns.temperature is None else [columns.temperature]
    label = [] if columns.label is None else [columns.label]
    text = [name for name in label if name not in needed]
    table = read_table(path, text=text, options=columns.options)
    for name in (*label, *needed):
        if name not in table.columns:
            raise InputError(
                f"{path}: no column {name!r}; it has {', '.join(table.columns)}",
                file=path,
                names=(name,),
            )
    return table


def observations_from_table(
    path: Path,
    table: Table,
    labels: tuple[str, ...],
    columns: Columns,
    sensor: Sensor,
    sd: Mapping[str, float],
    durations: Array | None = None,
) -> Observations:
    """Convert the rows of a table to observations.

    Parameters
    ----------
    path : Path
        Path of the table, for messages.
    table : Table
    labels : tuple of r str
        Names of the rows.
    columns, sensor, sd
        As in `read_means`.
    durations : (r,) array, optional
        Durations, s; by default 1 s in each row, for benches on which nothing depends on them.

    Raises
    ------
    InputError
        A value is not finite, a temperature is impossible, a label is repeated, a column has the
        same value in all rows, or no deviation is stated.
    """
    durations = np.ones(len(labels)) if durations is None else durations
    twice = sorted({label for label in labels if labels.count(label) > 1})
    if twice:
        raise InputError(
            f"{path}: position {twice[0]!r} appears in several rows; write each position in a "
            "single row",
            file=path,
            names=tuple(twice),
        )
    by_axis = {axis: name for axis, name, _ in columns.channels}
    output = np.empty((len(labels), len(sensor.axes)))
    for k, axis in enumerate(sensor.axes):
        output[:, k] = number_column(path, table, by_axis[axis.name], _OPEN_CELL)
        _require_within_range(path, table, by_axis[axis.name], axis, output[:, k])
    _refuse_constant_column(path, output, sensor, by_axis)
    if not (np.isfinite(durations) & (durations > 0)).all():
        row = int(np.flatnonzero(~(np.isfinite(durations) & (durations > 0)))[0])
        raise InputError(
            f"{path} {table.place(row)}: the duration is {durations[row]:g} s; it must be above 0",
            file=path,
            line=table.line(row),
        )
    deviation = _standard_deviations(path, table, by_axis, sensor, sd)
    temperature = None
    if columns.temperature is not None:
        cells = number_column(path, table, columns.temperature, "write the temperature")
        temperature = columns.thermometer.possible_kelvin(
            cells, columns.temperature, table.place, str(path)
        )
    mean, covariance = sensor.to_si(output), deviation[..., None] ** 2 * np.eye(len(sensor.axes))
    digits = _rounding_of_digits(output, deviation, sensor)
    rounding, even = digits.errors_of_means(mean), digits.step**2 / 12
    if rounding is not None:
        rounding = rounding.with_independent(even - digits.variance)
    rounding, covariance, notes = add_rounding(sensor, rounding, covariance, even)
    return Observations(
        labels=labels,
        mean=mean,
        covariance=covariance,
        duration=durations,
        samples=np.ones(len(labels), dtype=np.int64),
        time=np.arange(len(labels), dtype=float),
        channels=sensor.channels,
        rounding=rounding,
        notes=notes,
        timed=False,
        temperature=temperature,
    )


def check_repeated_rows(observations: Observations, sensor: Sensor) -> tuple[Finding, ...]:
    """Return a warning for rows whose means are exactly equal on all axes, and are then copies.

    Means with few digits may be equal by chance. Two means with a standard deviation σ, written in
    steps q ≪ σ, are equal with a probability of q / (2 √π σ).
    """
    mean, rows = observations.mean, len(observations.labels)
    sd = np.sqrt(np.diagonal(observations.covariance, axis1=-2, axis2=-1)).mean(axis=0)
    chance = rows**2 / 2
    for axis, one, own in zip(sensor.axes, mean.T, sd.tolist(), strict=True):
        written: Array = one * axis.readout.scale
        digits = _DIGITS - int(np.ceil(np.log10(np.abs(written).max() + _LEAST)))
        rounded: Array = np.round(written, digits)
        step = last_digit(rounded) / abs(axis.readout.scale)
        chance *= min(1.0, step / (2 * np.sqrt(np.pi) * own + _LEAST))
    _, first, counts = np.unique(mean, axis=0, return_inverse=True, return_counts=True)
    alike = (np.flatnonzero(first.ravel() == k).tolist() for k in np.flatnonzero(counts > 1))
    labels = ([observations.labels[k] for k in copies] for copies in alike)
    return tuple(
        Finding(
            "warning",
            "copies",
            f"{len(copies)} rows have exactly the same readings: {' and '.join(copies)}; remove "
            f"the copy, {' and '.join(copies[1:])}",
        )
        for copies in labels
        if chance < _BY_CHANCE
    )


def clipped_means(observations: Observations, sensor: Sensor) -> tuple[Finding, ...]:
    """Return a warning if the largest reading, of one channel or of a kind, is that of many rows.

    Call this only if the rows do not fit, because the largest of many equal rows may be right.
    """
    kinds = np.array([axis.measures for axis in sensor.axes])
    scale = np.array([axis.readout.scale for axis in sensor.axes])
    offset = np.array([axis.readout.offset for axis in sensor.axes])
    output = observations.mean * scale + offset
    sd = np.sqrt(np.diagonal(observations.covariance, axis1=-2, axis2=-1)).mean(axis=0) * abs(scale)
    groups = [np.flatnonzero(kinds == kind) for kind in dict.fromkeys(kinds.tolist())]
    found: dict[float, Finding] = {}
    for group in (*groups, *np.arange(len(kinds))[:, np.newaxis]):
        read: Array = output[..., group]
        written = np.round(read, _DIGITS - int(np.ceil(np.log10(np.abs(read).max() + _LEAST))))
        ends = (float(written.max()), float(written.min()))
        count, peak = max((int(np.sum(written == end)), end) for end in ends)
        own = float(sd[group].mean())
        near = int(np.sum(np.abs(written - peak) <= _NEAR * own))
        equal = min(1.0, last_digit(written) / (2 * np.sqrt(np.pi) * own + _LEAST))
        if count >= _ROWS and comb(near, count) * equal ** (count - 1) < _BY_CHANCE:
            names = ", ".join(sensor.channels[k] for k in group.tolist())
            where = f"{count} of {written.size} readings of {names} are {peak:.6g}"
            text = f"{where} and are clipped; remove these rows"
            cause = f"{where} and are clipped"
            found.setdefault(peak, Finding("warning", "saturation", text, cause=cause))
    return tuple(found.values())


def _rounding_of_digits(output: Array, deviation: Array, sensor: Sensor) -> ReadingSteps:
    """Return how the means, (r, m), are rounded by the digits in which they are written.

    A mean is a single reading with noise of its own. If that noise is large, rounding does not
    matter.
    """
    scale = np.array([abs(axis.readout.scale) for axis in sensor.axes])
    kinds = np.array([axis.measures for axis in sensor.axes])
    step = np.zeros(scale.size)
    for kind in set(kinds.tolist()):
        alike = output[:, kinds == kind]  # written in the same way
        digit = last_digit(alike)
        if digit <= _ONE_DIGIT * float(np.abs(alike).max(initial=0.0)):
            step[kinds == kind] = digit
    step /= scale
    sd = median_of_rows(deviation)
    step = np.where(step**2 / 12 > _OF_NOISE * sd**2, step, 0.0)
    noise = np.where(step > 0, sd / np.where(step > 0, step, 1.0), NOISY)
    never = np.zeros(step.size, dtype=np.bool_)
    return ReadingSteps(step, np.minimum(noise, NOISY), never, np.zeros(step.size))


def _refuse_constant_column(
    path: Path, output: Array, sensor: Sensor, by_axis: Mapping[str, str]
) -> None:
    """Refuse an accelerometer column that never changes, and a gyro column that seems dead.

    A gyro seems dead if it always reads 0, or if it is constant while other gyros change.
    """
    if len(output) < _ROWS:
        return
    constant = (output == output[0]).all(axis=0)
    for k, axis in enumerate(sensor.axes):
        like = [j for j, other in enumerate(sensor.axes) if other.measures == axis.measures]
        if axis.measures == "w" and not output[:, k].any():
            raise InputError(
                f"{path}: column {by_axis[axis.name]!r} is 0 in all rows: the gyro has a dead "
                "band about zero or its means are rounded to 0, so its bias cannot be "
                "determined; write the means with more digits, or leave the gyros out",
                file=path,
                names=(by_axis[axis.name],),
            )
        # Gyros at rest may agree in all rows if they are written with few digits.
        few = _FEW_DIGITS * last_digit(output[:, like])
        if axis.measures == "w" and float(np.ptp(output[:, like], axis=0).max()) <= few:
            continue
        others = "" if constant[like].all() else " while others change"
        if constant[k] and (others or axis.measures == "f"):
            raise InputError(
                f"{path}: column {by_axis[axis.name]!r} is {output[0, k]:.6g} in all rows{others}: "
                "check that the axis is connected and that [data] names its column",
                file=path,
                names=(by_axis[axis.name],),
            )


def _require_within_range(path: Path, table: Table, name: str, axis: Axis, mean: Array) -> None:
    """Refuse a mean at or beyond the full scale, because some of its samples were clipped."""
    reach = axis.readout.full_scale
    beyond = np.flatnonzero(np.abs(mean - axis.readout.offset) >= (reach or np.inf))
    if beyond.size:
        text = (
            f"is {mean[beyond[0]]:g}, at or beyond the full_scale that [sensor] states; remove the "
            "row or correct full_scale"
        )
        raise table.cell_error(path, int(beyond[0]), name, text)


def number_column(path: Path, table: Table, name: str, remedy: str) -> Array:
    """Return a column of numbers, (r,), from a table.

    Parameters
    ----------
    path : Path
        Path of the table, for messages.
    table : Table
    name : str
    remedy : str
        Advice on what to do if a cell is empty.

    Raises
    ------
    InputError
        A cell does not contain a finite number; the message states its line.
    """
    for k, cell in enumerate(table.columns[name].tolist()):
        try:
            number = float(cell)
            if abs(number) < TOO_LARGE:
                continue
            what = " is empty or not a number" if isnan(number) else f" is {number:g}, too large"
        except ValueError:
            word = bool(cell.strip())
            what = f": {shorten(cell)!r} is not a number" if word else " is empty"
            remedy = f"{MIXED_MARKS}," if DECIMAL_COMMA.fullmatch(cell.strip()) else remedy
        raise InputError(
            f"{path} {table.place(k)}: column {name!r}{what}; {remedy} or remove the row",
            file=path,
            line=table.line(k),
            names=(name,),
        )
    return table.numbers(name)


def _standard_deviations(
    path: Path, table: Table, by_axis: Mapping[str, str], sensor: Sensor, sd: Mapping[str, float]
) -> Array:
    """Return the standard deviation of each mean, (r, m) SI, as stated or from the columns."""
    deviations: list[Array] = []
    for axis in sensor.axes:
        if axis.measures in sd:
            deviations.append(np.full(table.rows, sd[axis.measures]))
            continue
        name = by_axis[axis.name] + SD_SUFFIX
        if name not in table.columns:
            kind = QUANTITIES[axis.measures].sensor
            raise InputError(
                f"{path}: [data.sd] {kind} is missing: state the standard deviation of a mean with "
                f"its unit, or add columns with that of each row, such as {name!r}",
                file=path,
                key=f"[data.sd] {kind}",
            )
        column = number_column(path, table, name, "write the standard deviation of the mean")
        if (bad := np.flatnonzero(column <= 0)).size:
            text = f"is {column[bad[0]]:g}; a standard deviation must be positive"
            raise table.cell_error(path, int(bad[0]), name, text)
        deviations.append(column / abs(axis.readout.scale))
    return np.stack(deviations, axis=-1)


def write_means(
    path: str | os.PathLike[str], columns: Mapping[str, Sequence[str | float | int]]
) -> None:
    """Write a table of means as CSV, completely or not at all, with all digits of the numbers.

    Parameters
    ----------
    path : path
    columns : mapping of str to sequence of r str or numbers
        Columns by name, in their order.

    Raises
    ------
    InputError
        The path cannot be written.
    """
    with atomic_write(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        lines = csv.writer(file, lineterminator="\n")
        lines.writerow(columns)
        lines.writerows(zip(*columns.values(), strict=True))
