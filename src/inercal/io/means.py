"""Tables of means, typed by hand or made elsewhere: read straight in as observations.

One row a position or turn: its label, the mean reading of each axis in output units, for turns
the section's duration. The standard deviation of the means is stated, it cannot be found here.
"""

from pathlib import Path

import numpy as np

from inercal.errors import InputError
from inercal.io.read import Columns, read_table
from inercal.recording import Observations
from inercal.sensors import Sensor


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
    table = read_table(path)
    if columns.label is None:
        raise InputError(f"{path}: [data] label is missing: name the column of position labels")
    wanted = [columns.label, *(name for _, name, _ in columns.channels)]
    wanted += [] if seconds is None else [seconds]
    for name in wanted:
        if name not in table.columns:
            raise InputError(f"{path}: no column {name!r}; it has {', '.join(table.columns)}")
    labels = tuple(str(label).strip() for label in table.columns[columns.label])
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
    durations = np.ones(len(labels)) if seconds is None else table.numbers(seconds)
    if not (np.isfinite(durations) & (durations > 0)).all():
        raise InputError(f"{path}: column {seconds!r}: durations must be positive numbers of s")
    return Observations(
        labels=labels,
        mean=sensor.to_si(output),
        covariance=np.broadcast_to(np.diag(deviation**2), (len(labels), *[len(deviation)] * 2)),
        duration=durations,
        samples=np.ones(len(labels), dtype=np.int64),
        time=np.arange(len(labels), dtype=float),
        channels=sensor.channels,
    )
