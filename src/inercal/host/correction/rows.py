"""Samples as they come from a source, and the columns of the run file that they need."""

from typing import NamedTuple, Protocol

import numpy as np

from inercal.basics.arrays import Array, Bools
from inercal.basics.errors import InputError
from inercal.recordings.data.recording_loader import reader_columns, require_distinct_columns
from inercal.recordings.io.read import Columns
from inercal.runfile import Run


class Rows(NamedTuple):
    """Samples.

    Parameters
    ----------
    time : (n,) array
        Times, s.
    readings : (n, m) array
        Finite readings of the axes in output units.
    kelvin : (n,) array or None
        Temperatures, K; None if the run file names no temperature.
    saturated : (n,) array of bool or None
        Samples that the device marks as saturated.
    """

    time: Array
    readings: Array
    kelvin: Array | None
    saturated: Bools | None = None

    def take(self, keep: Bools) -> "Rows":
        """Return the samples to keep."""
        return self if keep.all() else Rows(*(x if x is None else x[keep] for x in self))


class Parser(Protocol):
    """Turns bytes into samples.

    Attributes
    ----------
    malformed : int
        Number of lines or packets that were skipped.
    missing : int
        Number of packets that are missing according to the counter or the clock of the device.
    """

    malformed: int
    missing: int

    def feed(self, data: bytes) -> Rows | None:
        """Return the samples that are now complete; None if there are none."""
        ...

    def restart(self, *, mid_stream: bool) -> None:
        """Forget an incomplete sample, because the next bytes do not continue the last ones.

        `mid_stream` tells whether they may begin in the middle of a line or packet.
        """
        ...

    def finish(self) -> Rows | None:
        """Return the last sample if only its line end is missing."""
        ...


def stream_columns(run: Run) -> Columns:
    """Return the columns of a run whose samples come from a single source.

    Raises
    ------
    InputError
        The columns are in two files, or a column is missing or used twice.
    """
    require_distinct_columns(run)
    columns = reader_columns(run)
    if columns.second:
        raise InputError(
            f"{run.path}: [data] names two files or times, but a stream has a single source; "
            "remove gyro_file and gyro_time",
            file=run.path,
            key="[data] gyro_file",
        )
    if len(columns.channels) < len(run.sensor.axes):
        raise InputError(
            f"{run.path}: [data] names {len(columns.channels)} columns for the axes "
            f"{', '.join(run.sensor.channels)}; name one for each axis in accelerometer and gyro",
            file=run.path,
            key="[data] accelerometer",
        )
    return columns


def last_known(values: Array, before: float) -> Array:
    """Return values, (n,), with each NaN replaced by the last value before it."""
    there = np.isfinite(values)
    if there.all():
        return values
    at = np.maximum.accumulate(np.where(there, np.arange(values.size), -1))
    return np.where(at < 0, before, values[at])
