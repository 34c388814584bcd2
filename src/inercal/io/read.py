"""Tables and recordings from files of any known kind."""

import os
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from inercal.arrays import Array
from inercal.errors import InputError
from inercal.io.audit import NonfinitePolicy, audit, audit_rows, require_accepted
from inercal.io.column_table import ReadRequest, Table, open_error
from inercal.io.packet_counter import times_from_counter
from inercal.io.readers import HEAD_BYTES, Reader, refuse_unknown_options, select_reader
from inercal.io.time_stamps import is_iso_time, require_unit, times_from_iso
from inercal.recording import Recording
from inercal.units import si_factor, to_si

_GZIP = b"\x1f\x8b"
_ROUNDING = 1e-6  # of half a step: stamps of few digits


@dataclass(frozen=True)
class Columns:
    """Which column of a file is what.

    Parameters
    ----------
    channels : tuple of (axis, column, unit)
        One for each axis of the sensor, in its order; the unit is that of the column.
    time : str or None
        Column of time stamps; None where samples come at `rate_hz`.
    time_unit : str or None
        Unit of the time column as it is stated; "sample" for a counter, None where no unit is
        stated, and s are in force.
    rate_hz : float or None
        Samples per second, where there is no time column or where it counts samples.
    modulus : int or None
        Of a counter of samples that begins again at 0: how many it counts.
    time_keys : (str, str or None)
        Keys of a run file that a message names: of the time column's unit, and of a rate in place
        of the column.
    origin : int or None
        Time 0 of a column of dates, ns since 1970; that of the first row where it is not given.
    label : str or None
        Column that names the section of each sample.
    temperature, temperature_unit : str
        Column of temperature, or None.
    readback : tuple of (name, column, unit)
        What the bench said of itself.
    nonfinite : "refuse" or "drop"
        What to do with rows that hold NaN or infinity.
    second : tuple of (axis, column, unit)
        Channels after these, in a file of their own whose rows are the same samples; a time
        column is in both.
    options : mapping of str to object
        Of the readers of these files (`inercal.io.readers`).

    Raises
    ------
    InputError
        A unit is none, `rate_hz` is missing or needless, `modulus` is needless, or a column is used
        twice.
    """

    channels: tuple[tuple[str, str, str], ...]
    time: str | None = None
    time_unit: str | None = None
    rate_hz: float | None = None
    label: str | None = None
    temperature: str | None = None
    temperature_unit: str = "°C"
    readback: tuple[tuple[str, str, str], ...] = ()
    nonfinite: NonfinitePolicy = "refuse"
    second: tuple[tuple[str, str, str], ...] = ()
    modulus: int | None = None
    time_keys: tuple[str, str | None] = ("time_unit", "rate")
    origin: int | None = None
    options: Mapping[str, object] = field(default_factory=dict[str, object])

    def __post_init__(self) -> None:
        for _, _, unit in (*self.channels, *self.second):
            si_factor(unit)
        counted = self.time is None or self.time_unit == "sample"
        if counted and self.rate_hz is None:
            reason = "there is no time column" if self.time is None else "time counts samples"
            raise InputError(f"rate_hz is needed: {reason}")
        if not counted and self.rate_hz is not None:
            raise InputError(
                f"rate_hz and a time column in {self.time_unit or 's'!r} are both stated: keep one"
            )
        if self.modulus is not None and (self.time is None or not counted):
            raise InputError(f"modulus {self.modulus} is of a time column that counts samples")
        if self.rate_hz is not None and not 0 < self.rate_hz < np.inf:
            raise InputError(f"rate_hz is {self.rate_hz:g}; it must be positive")
        for channels in (self.channels, self.second):  # two files may well use the same names
            columns = [column for _, column, _ in channels]
            for column in columns:
                if columns.count(column) > 1:
                    raise InputError(f"column {column!r} is given to more than one channel")

    @property
    def names(self) -> tuple[str, ...]:
        """The columns of the first file that are used."""
        single = (self.time, self.label, self.temperature)
        many = (column for _, column, _ in (*self.channels, *self.readback))
        return tuple(dict.fromkeys([*(name for name in single if name is not None), *many]))


def read_table(
    path: str | os.PathLike[str],
    wanted: Collection[str] | None = None,
    text: Collection[str] = (),
    options: Mapping[str, object] | None = None,
) -> Table:
    """Read a table: text, .npz, Parquet, .mat, HDF5, or what another package brings a reader for.

    A file is told by its content and then by its suffix.

    Parameters
    ----------
    path : path-like
        The file.
    wanted : collection of str or None
        Columns to return; None for all.
    text : collection of str
        Columns to return as text even where they look like numbers.
    options : mapping of str to object, optional
        Of its reader (`inercal.io.readers`).

    Raises
    ------
    InputError
        One line: what is wrong, where, and what is possible.
    """
    path, options = Path(path), options or {}
    _refuse_unknown_options(options, path)
    return _read(path, ReadRequest(wanted, text), options)


def detect_reader(path: Path) -> Reader:
    """Return the reader of a file, told by its content and then by its suffix.

    Raises
    ------
    InputError
        It is not a regular file, it cannot be opened, or it is compressed.
    """
    try:
        if path.is_dir():
            raise InputError(f"{path} is a folder; name a file in it")
        if path.exists() and not path.is_file():
            raise InputError(f"{path} is not a regular file; it is read more than once")
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
    except OSError as error:
        raise open_error(path, error) from error
    if head.startswith(_GZIP):
        raise InputError(f"{path.name} is compressed with gzip: unpack it first")
    return select_reader(path, head)


def _read(path: Path, wanted: ReadRequest, options: Mapping[str, object]) -> Table:
    """Return the table of a file by the options that its reader knows of those given."""
    reader = detect_reader(path)
    try:
        return reader.read(path, wanted, **reader.option_values(options))
    except OSError as error:
        raise open_error(path, error) from error


def _refuse_unknown_options(options: Mapping[str, object], *paths: Path) -> None:
    """Refuse options that no reader of these files knows."""
    if options:
        names = " and ".join(path.name for path in paths)
        refuse_unknown_options(options, names, [detect_reader(path) for path in paths])


def read_recording(
    path: str | os.PathLike[str],
    columns: Columns,
    limits: Mapping[str, tuple[float, float]] | None = None,
    second: str | os.PathLike[str] | None = None,
) -> Recording:
    """Read a recording and audit it.

    Parameters
    ----------
    path : path-like
        The file.
    columns : Columns
        Which column is what.
    limits : mapping of channel to (lowest, highest), optional
        See `inercal.io.audit.audit`.
    second : path-like, optional
        The file of `columns.second`.

    Raises
    ------
    InputError
        A file cannot be read, two were not sampled together, or the audit refuses the recording.
    """
    recording = _recording(Path(path), columns, None if second is None else Path(second))
    return require_accepted(audit(recording, columns.nonfinite, limits, in_place=True))


def read_readback(path: str | os.PathLike[str], columns: Columns) -> Recording:
    """Read what a bench says of itself in a file of its own, its axes as channels.

    Rows and times are audited as those of a recording are; an axis may well stand still.

    Raises
    ------
    InputError
        The file cannot be read, or the audit refuses it.
    """
    recording = _recording(Path(path), columns, None)
    return require_accepted(audit_rows(recording, columns.nonfinite, in_place=True))


def _recording(path: Path, columns: Columns, second: Path | None) -> Recording:
    """Return the recording as it stands in the files."""
    if (second is None) != (not columns.second):
        raise InputError(f"{path}: a second file and the columns in it go together")
    label = () if columns.label is None else (columns.label,)
    together = tuple(column for _, column, _ in columns.channels)
    _refuse_unknown_options(columns.options, path, *([] if second is None else [second]))
    wanted = ReadRequest(columns.names, label, together, spare_columns=len(columns.second))
    table = _read(path, wanted, columns.options)
    data = _number_block(table, together)
    labels = None if columns.label is None else table.columns[columns.label].astype(np.str_)
    temperature = None
    if columns.temperature is not None:
        celsius = table.numbers(columns.temperature)
        temperature = to_si(celsius, columns.temperature_unit, like="K")
    time, origin = _time(table, columns, len(data))
    columns = replace(columns, origin=origin)
    channels = columns.channels + columns.second
    source, first_row = table.source, table.first_line
    if second is not None:
        other = _read_second_file(second, columns, data[:, len(together) :], (source, time))
        source = f"{source} and {other.source}"
        first_row = first_row if other.first_line == first_row else 0
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
        source=source,
        sha256=table.sha256,
        first_row=first_row,
        origin=origin,
    )


def _number_block(table: Table, together: tuple[str, ...]) -> Array:
    """Return the columns asked for together, once it is known that all are numbers."""
    for column in together:
        table.numbers(column)
    if table.block is None:
        raise TypeError(f"{table.source}: no block was requested")
    return table.block


def _read_second_file(
    path: Path, columns: Columns, place: Array, first: tuple[str, Array]
) -> Table:
    """Read the columns of the second file into their place, (n, k), and return its table."""
    together = tuple(column for _, column, _ in columns.second)
    names = together if columns.time is None else (columns.time, *together)
    table = _read(path, ReadRequest(names, (), together), columns.options)
    block = _number_block(table, together)
    name, time = first
    if len(block) != len(place):
        raise InputError(
            f"{table.source} has {len(block)} rows and {name} has {len(place)}: "
            "two files of one recording have the same rows"
        )
    if columns.time is not None:
        _refuse_unequal_times(table, _time(table, columns, len(block))[0], name, time)
    place[:] = block
    return table


def _refuse_unequal_times(table: Table, time: Array, name: str, expected: Array) -> None:
    """Raise InputError where a time differs by more than half a step from that in the first file.

    A time that is missing in the first file is left to the audit.
    """
    with np.errstate(invalid="ignore"):  # of infinities
        step = np.abs(np.diff(expected))
        step = step[np.isfinite(step)]
        half = 0.5 * float(np.median(step, overwrite_input=True)) if step.size else 0.0
        apart = ~(np.abs(time - expected) <= half * (1 + _ROUNDING)) & np.isfinite(expected)
    if not apart.any():
        return
    k = int(np.argmax(apart))
    where = f"line {table.first_line + k}" if table.first_line else f"sample {k}"
    raise InputError(
        f"{table.source} {where} is at {time[k]:.6g} s where {name} is at {expected[k]:.6g} s: "
        "two files of one recording have the same times"
    )


def _time(table: Table, columns: Columns, n: int) -> tuple[Array, int | None]:
    """Return the time of each sample, (n,), s, and of a column of dates what time 0 is."""
    name = columns.time
    if name is not None and columns.rate_hz is None and _holds_dates(table, name):
        if columns.time_unit is not None:
            raise InputError(
                f"{table.source}: column {name!r} holds ISO 8601 times, which have no unit: leave "
                f"{columns.time_keys[0]} out"
            )
        cells: list[str] = table.columns[name].tolist()
        return times_from_iso(cells, name, table.source, table.first_line, columns.origin)
    counter = np.arange(n, dtype=np.float64) if name is None else table.numbers(name)
    if columns.rate_hz is not None and columns.modulus is not None:
        try:
            return times_from_counter(counter, columns.modulus, columns.rate_hz), None
        except InputError as error:
            raise InputError(f"{table.source}: {error}") from None
    if name is None or columns.rate_hz is not None:
        return counter / (columns.rate_hz or 1.0), None
    require_unit(counter, name, columns.time_unit, table.source, columns.time_keys)
    return counter * si_factor(columns.time_unit or "s", like="s"), None


def _holds_dates(table: Table, name: str) -> bool:
    """Return whether a column is text whose first cell is a date with a time."""
    column = table.columns[name]
    return column.dtype.kind == "U" and column.size > 0 and is_iso_time(str(column[0]))
