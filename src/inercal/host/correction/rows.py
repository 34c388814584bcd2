"""Samples as they come from a source, and the columns of the run file that they need."""

from typing import NamedTuple

from inercal.basics.arrays import Array, Bools
from inercal.basics.errors import InputError
from inercal.recordings.data.recording_loader import reader_columns, require_distinct_columns
from inercal.recordings.io.read import Columns
from inercal.runfile import Run


class ArrivedRows(NamedTuple):
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

    def take(self, keep: Bools) -> "ArrivedRows":
        """Return the samples to keep."""
        kelvin = None if self.kelvin is None else self.kelvin[keep]
        saturated = None if self.saturated is None else self.saturated[keep]
        return ArrivedRows(self.time[keep], self.readings[keep], kelvin, saturated)


def stream_columns(run: Run) -> Columns:
    """Return the columns of a run whose samples come from a single source.

    Raises
    ------
    InputError
        The columns are in two files, or a column is missing or used twice.
    """
    require_distinct_columns(run)
    columns, wanted = reader_columns(run), len(run.sensor.axes)
    if len(columns.channels) < wanted:
        raise InputError(
            f"{run.path}: [data] names {len(columns.channels)} columns of a single file for the "
            f"{wanted} axes of the sensor; name one for each, without gyro_file and gyro_time",
            file=run.path,
            key="[data] accelerometer",
        )
    return columns
