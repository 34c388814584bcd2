"""Convert a table to a recording: assign its columns, and compute the times of its samples."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError, error_location
from inercal.basics.units import si_factor, to_si
from inercal.recordings import Finding, Recording
from inercal.recordings.io.audit import NonfinitePolicy
from inercal.recordings.io.column_table import ReadRequest, Table
from inercal.recordings.io.time_stamps import (
    is_iso_time,
    require_counter,
    require_unit,
    times_from_counter,
    times_from_iso,
    times_from_origin,
)
from inercal.recordings.io.wrapped_numbers import (
    MODULUS_KEY,
    require_no_wrap,
    sign_in_place,
    unwrap_stamps,
)
from inercal.recordings.temperature import CELSIUS, TemperatureReadout

_NS = 10**9
# A thermometer is slow if it is read in every second row or less, and regularly.
_FEWEST_ROWS, _MOST_ROWS = 2, 3.0


@dataclass(frozen=True)
class Columns:
    """Contents of each column in a file.

    Parameters
    ----------
    channels : tuple of (axis, column, unit)
        Sensor axes in their order, each with its column and the column's unit.
    time : str or None
        Column of time stamps; None if samples come at `rate_hz`.
    time_unit : str or None
        Stated unit of the time column; "sample" for a sample counter. If None, no unit is stated
        and the stamps are read as s.
    rate_hz : float or None
        Samples per second, if there is no time column or if it counts samples.
    modulus : float or None
        Number of units after which the time column wraps around to 0.
    time_keys : (str, str or None)
        Run-file keys that a message names: the key for the unit of the time column, and the key for
        the rate that can replace the column.
    origin : Fraction or None
        Time 0 on the clock of the stamps, ns, counted from 1970 for dates. None means the time of
        the first row; for dates, 0 means the same.
    label : str or None
        Column that names the section of each sample.
    temperature : str or None
        Temperature column.
    thermometer : TemperatureReadout
        Conversion of the temperature column to kelvin.
    readback : tuple of (name, column, unit)
        Quantities that the bench itself measured.
    nonfinite : "refuse" or "drop"
        Whether to refuse or drop rows that contain NaN or infinity.
    second : tuple of (axis, column, unit)
        Additional channels in a second file whose rows are the same samples. If there is a time
        column, both files must have it.
    second_time : str or None
        Time column of the second file, if its samples have different times. Each sample of the file
        with fewer samples is then joined to the nearest sample of the other file.
    signed_bits : int or None
        Bits of the channels' counts, if they are signed but were written as unsigned numbers.
    options : mapping of str to object
        Options for the readers of these files (`inercal.recordings.io.readers`).

    Raises
    ------
    InputError
        A unit is unknown, `rate_hz` is missing or contradicts a time column, `modulus` is given
        without a time column, or a column is used twice.
    """

    channels: tuple[tuple[str, str, str], ...]
    time: str | None = None
    time_unit: str | None = None
    rate_hz: float | None = None
    label: str | None = None
    temperature: str | None = None
    thermometer: TemperatureReadout = CELSIUS
    readback: tuple[tuple[str, str, str], ...] = ()
    nonfinite: NonfinitePolicy = "refuse"
    second: tuple[tuple[str, str, str], ...] = ()
    modulus: float | None = None
    time_keys: tuple[str, str | None] = ("time_unit", "rate")
    origin: Fraction | None = None
    second_time: str | None = None
    signed_bits: int | None = None
    options: Mapping[str, object] = field(default_factory=dict[str, object])

    def __post_init__(self) -> None:
        for _, _, unit in (*self.channels, *self.second):
            si_factor(unit)
        counted = self.time is None or self.time_unit == "sample"
        if counted and self.rate_hz is None:
            reason = "there is no time column" if self.time is None else "time counts samples"
            raise InputError(f"rate_hz is missing: {reason}; give rate_hz", key="rate_hz")
        if not counted and self.rate_hz is not None:
            raise InputError(
                f"rate_hz and a time column in {self.time_unit or 's'!r} are both stated: "
                "remove one of them",
                key="rate_hz",
            )
        if self.modulus is not None and self.time is None:
            raise InputError(
                f"modulus {self.modulus:.12g} is for a time column that restarts; remove modulus, "
                "or name the time column",
                key="modulus",
            )
        if self.second_time is not None and (counted or not self.second):
            raise InputError(
                "second_time is for a second file, and needs a column of times in the first; "
                "remove second_time",
                key="second_time",
            )
        if self.rate_hz is not None and not 0 < self.rate_hz < np.inf:
            raise InputError(f"rate_hz is {self.rate_hz:g}; it must be positive", key="rate_hz")
        for channels in (self.channels, self.second):  # two files may use the same names
            columns = [column for _, column, _ in channels]
            for column in columns:
                if columns.count(column) > 1:
                    raise InputError(
                        f"column {column!r} is stated for several channels; give each its own "
                        "column",
                        names=(column,),
                    )

    @property
    def names(self) -> tuple[str, ...]:
        """The columns of the first file that are used."""
        single = (self.time, self.label, self.temperature)
        many = (column for _, column, _ in (*self.channels, *self.readback))
        return tuple(dict.fromkeys([*(name for name in single if name is not None), *many]))

    @property
    def stamps(self) -> tuple[str, ...]:
        """The time column, if any, which is read with all of its digits."""
        return () if self.time is None else (self.time,)


class SampleTimes(NamedTuple):
    """Times of samples from the origin, (n,) s; see `Recording` for the other attributes."""

    time: Array
    origin: Fraction | None = None
    first_stamp: float = 0.0


def read_request(columns: Columns) -> ReadRequest:
    """Return which columns to read from the first file, with space for those of the second."""
    label = () if columns.label is None else (columns.label,)
    together = tuple(column for _, column, _ in columns.channels)
    return ReadRequest(columns.names, label, together, len(columns.second), columns.stamps)


def recording_from_table(table: Table, columns: Columns) -> Recording:
    """Convert a table to an unaudited recording; columns of a second file remain empty.

    Parameters
    ----------
    table : Table
        A table that was read with `read_request`.
    columns : Columns

    Raises
    ------
    InputError
        A column contains text instead of numbers, times cannot be read, or a temperature is
        impossible.
    """
    data = number_block(table, tuple(column for _, column, _ in columns.channels))
    if columns.signed_bits is not None:
        sign_in_place(data[:, : len(columns.channels)], columns.signed_bits, table.source)
    labels = None if columns.label is None else table.columns[columns.label].astype(np.str_)
    temperature = None
    if columns.temperature is not None:
        temperature = columns.thermometer.possible_kelvin(
            table.numbers(columns.temperature), columns.temperature, table.place, table.source
        )
    time, origin, first_stamp = sample_times(table, columns, len(data))
    findings: tuple[Finding, ...] = ()
    if temperature is not None and (slow := _nearest_readings(time, temperature)) is not None:
        count = int(np.isfinite(temperature).sum())
        text = f"the temperature was read in {count} of {time.size} rows; others use the nearest"
        temperature, findings = slow, (Finding("note", "temperature", text),)
    channels = columns.channels + columns.second
    return Recording(
        time=time,
        data=data,
        channels=tuple(axis for axis, _, _ in channels),
        units=tuple(unit for _, _, unit in channels),
        labels=labels,
        temperature=temperature,
        readback={
            name: to_si(table.numbers(column), unit, like=unit)
            for name, column, unit in columns.readback
        },
        source=table.source,
        sha256=table.sha256,
        first_row=table.first_line,
        line_breaks=table.line_breaks,
        origin=origin,
        first_stamp=first_stamp,
        kept_corrections=table.kept_corrections,
        devices=table.devices,
        simulation=table.simulation,
        findings=findings,
    )


def _nearest_readings(time: Array, temperature: Array) -> Array | None:
    """Return the reading nearest in time for each row of a slow thermometer, (n,) K.

    The result is None unless the rows without a number lie regularly between those with one.
    """
    known = np.flatnonzero(np.isfinite(temperature))
    rows = np.diff(known, prepend=-1, append=temperature.size)
    usual = float(np.median(rows))
    if not known.size or np.any(np.diff(time) < 0):
        return None
    if usual < _FEWEST_ROWS or rows.max() > _MOST_ROWS * usual:
        return None
    middle = 0.5 * (time[known[1:]] + time[known[:-1]])
    return np.asarray(temperature[known[np.searchsorted(middle, time)]])


def number_block(table: Table, together: tuple[str, ...]) -> Array:
    """Return the block of these columns; refuse columns of text."""
    for column in together:
        table.numbers(column)
    assert table.block is not None  # the request has block columns
    return table.block


def sample_times(table: Table, columns: Columns, n: int) -> SampleTimes:
    """Return the times of a table's samples, counted from `columns.origin` or the first row."""
    name = columns.time
    if name is not None and columns.rate_hz is None and _holds_dates(table, name):
        needless = columns.time_keys[0] if columns.time_unit is not None else MODULUS_KEY
        if columns.time_unit is not None or columns.modulus is not None:
            raise InputError(
                f"{table.source}: column {name!r} contains ISO 8601 times, which have no "
                f"unit and never restart: remove {needless}",
                file=table.source,
                key=needless,
                names=(name,),
            )
        cells: list[str] = table.columns[name].tolist()
        return SampleTimes(*times_from_iso(cells, name, table, columns.origin or None))
    if name is None:
        return SampleTimes(np.arange(n, dtype=np.float64) / (columns.rate_hz or 1.0))
    counter = table.stamps(name)
    if columns.modulus is None and columns.time_keys[1] is not None:
        require_no_wrap(table, name)
    if columns.rate_hz is not None and columns.modulus is not None:
        with error_location(table.source, file=table.source):
            return SampleTimes(times_from_counter(counter, columns.modulus, columns.rate_hz))
    if columns.rate_hz is not None:
        require_counter(counter, name, columns.rate_hz, table.source, columns.time_keys[0])
        rate = Fraction(columns.rate_hz)
        origin = None if columns.origin is None else columns.origin * rate
        count, start = times_from_origin(counter, 1.0, origin)
        return SampleTimes(count / columns.rate_hz, start / rate, float(start / rate / _NS))
    if columns.modulus is not None:
        counter = unwrap_stamps(counter, columns.modulus)
    require_unit(counter, name, columns.time_unit, table.source, columns.time_keys)
    before = table.time_zero or Fraction(0)
    origin = None if columns.origin is None else columns.origin - before
    time, start = times_from_origin(counter, si_factor(columns.time_unit or "s", like="s"), origin)
    return SampleTimes(time, start + before, float(start / _NS))


def _holds_dates(table: Table, name: str) -> bool:
    """Return whether a column is text whose first cell is a date with a time."""
    column = table.columns[name]
    return column.dtype.kind == "U" and column.size > 0 and is_iso_time(str(column[0]))
