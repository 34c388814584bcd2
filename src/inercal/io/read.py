"""Tables and recordings from files of all registered formats."""

import os
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from inercal.arrays import Array
from inercal.errors import InputError
from inercal.io.audit import NonfinitePolicy, audit, audit_rows, require_accepted
from inercal.io.column_table import ReadRequest, Table, open_error
from inercal.io.readers import HEAD_BYTES, Reader, refuse_unknown_options, select_reader
from inercal.io.time_stamps import (
    is_iso_time,
    require_unit,
    times_from_counter,
    times_from_iso,
)
from inercal.recording import Recording
from inercal.units import si_factor, to_si

_GZIP = b"\x1f\x8b"
_ROUNDING = 1e-6  # of half a step: stamps of few digits


@dataclass(frozen=True)
class Columns:
    """What each column of a file holds.

    Parameters
    ----------
    channels : tuple of (axis, column, unit)
        The axes of the sensor, in its order, each with its column and the column's unit.
    time : str or None
        Column of time stamps; None where samples come at `rate_hz`.
    time_unit : str or None
        Stated unit of the time column; "sample" for a counter of samples. None where no unit is
        stated: the stamps are then read as s.
    rate_hz : float or None
        Samples per second, where there is no time column or where it counts samples.
    modulus : int or None
        Number of values of a counter of samples that restarts at 0.
    time_keys : (str, str or None)
        Keys of a run file that a message names: the unit of the time column, and the rate that may
        replace the column.
    origin : int or None
        Time 0 of a column of dates, ns since 1970; None for the first row's time.
    label : str or None
        Column that names the section of each sample.
    temperature, temperature_unit : str
        Column of temperature, or None.
    readback : tuple of (name, column, unit)
        Quantities that the bench measured itself.
    nonfinite : "refuse" or "drop"
        What to do with rows that hold NaN or infinity.
    second : tuple of (axis, column, unit)
        Further channels, in a second file whose rows are the same samples; where there is a time
        column, both files have it.
    options : mapping of str to object
        Options of the readers of these files (`inercal.io.readers`).

    Raises
    ------
    InputError
        An unknown unit, `rate_hz` missing or contradicting a time column, `modulus` without a
        counter, or a column used twice.
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
            raise InputError(f"rate_hz is missing: {reason}; give rate_hz", key="rate_hz")
        if not counted and self.rate_hz is not None:
            raise InputError(
                f"rate_hz and a time column in {self.time_unit or 's'!r} are both stated: remove "
                "one of the two",
                key="rate_hz",
            )
        if self.modulus is not None and (self.time is None or not counted):
            raise InputError(
                f"modulus {self.modulus} is for a time column that counts samples; remove modulus",
                key="modulus",
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
        """The used columns of the first file."""
        single = (self.time, self.label, self.temperature)
        many = (column for _, column, _ in (*self.channels, *self.readback))
        return tuple(dict.fromkeys([*(name for name in single if name is not None), *many]))


def read_table(
    path: str | os.PathLike[str],
    wanted: Collection[str] | None = None,
    text: Collection[str] = (),
    options: Mapping[str, object] | None = None,
) -> Table:
    """Read a table: text, .npz, Parquet, .mat, HDF5, or a format that another package registers.

    The content of a file, then its suffix, decides the format.

    Parameters
    ----------
    path : path-like
        The file.
    wanted : collection of str or None
        Columns to return; None for all.
    text : collection of str
        Columns to return as text even where they look like numbers.
    options : mapping of str to object, optional
        Options of the reader (`inercal.io.readers`).

    Raises
    ------
    InputError
        The file cannot be read as a table with these columns.
    """
    path, options = Path(path), options or {}
    _refuse_unknown_options(options, path)
    return _read(path, ReadRequest(wanted, text), options)


def detect_reader(path: Path) -> Reader:
    """Return the reader of a file, chosen by its content and then by its suffix.

    Raises
    ------
    InputError
        It is not a regular file, it cannot be opened, or it is compressed.
    """
    try:
        if path.is_dir():
            raise InputError(f"{path} is a folder; name a file in it", file=path)
        if path.exists() and not path.is_file():
            raise InputError(
                f"{path} is not a regular file, and a stream cannot be read twice: save it as a "
                "file",
                file=path,
            )
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
    except OSError as error:
        raise open_error(path, error) from error
    if head.startswith(_GZIP):
        raise InputError(f"{path.name} is compressed with gzip: unpack it first", file=path)
    return select_reader(path, head)


def _read(path: Path, wanted: ReadRequest, options: Mapping[str, object]) -> Table:
    """Return the table of a file; the reader takes the options that it knows."""
    reader = detect_reader(path)
    before = _state(path)
    try:
        table = reader.read(path, wanted, **reader.option_values(options))
    except OSError as error:
        raise open_error(path, error) from error
    except Exception as error:
        if _state(path) != before:
            raise _changed_error(path) from error
        if isinstance(error, InputError):
            error.file = error.file or path
        raise
    if _state(path) != before:
        raise _changed_error(path)
    return table


def _state(path: Path) -> tuple[int, int, int] | None:
    """Return what tells that a file was changed; None for no file."""
    try:
        known = path.stat()
    except OSError:
        return None
    return known.st_ino, known.st_size, known.st_mtime_ns


def _changed_error(path: Path) -> InputError:
    return InputError(
        f"{path} was changed while it was read: wait until it is complete, or read a copy",
        file=path,
    )


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
        What each column holds.
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
    """Read the readback of a bench from a separate file, with its axes as channels.

    Rows and times are audited as those of a recording; an axis may be at rest throughout.

    Raises
    ------
    InputError
        The file cannot be read, or the audit refuses it.
    """
    recording = _recording(Path(path), columns, None)
    return require_accepted(audit_rows(recording, columns.nonfinite, in_place=True))


def _recording(path: Path, columns: Columns, second: Path | None) -> Recording:
    """Return the recording of the files, not audited."""
    if (second is None) != (not columns.second):
        raise InputError(
            f"{path}: state a second file and its columns, or neither of the two", file=path
        )
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
    source, first_row, kept = table.source, table.first_line, table.kept_corrections
    if second is not None:
        other = _read_second_file(second, columns, data[:, len(together) :], (source, time))
        source = f"{source} and {other.source}"
        first_row = first_row if other.first_line == first_row else 0
        kept = "; ".join(filter(None, (kept, other.kept_corrections)))
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
        kept_corrections=kept,
    )


def _number_block(table: Table, together: tuple[str, ...]) -> Array:
    """Return the block of these columns; refuse a column of text."""
    for column in together:
        table.numbers(column)
    assert table.block is not None  # the request has block columns
    return table.block


def _read_second_file(
    path: Path, columns: Columns, place: Array, first: tuple[str, Array]
) -> Table:
    """Read the columns of the second file into `place`, (n, k), and return its table."""
    together = tuple(column for _, column, _ in columns.second)
    names = together if columns.time is None else (columns.time, *together)
    table = _read(path, ReadRequest(names, (), together), columns.options)
    block = _number_block(table, together)
    name, time = first
    if len(block) != len(place):
        raise InputError(
            f"{table.source} has {len(block)} rows and {name} has {len(place)}: "
            "two files of one recording must have the same rows",
            file=path,
        )
    if columns.time is not None:
        _refuse_unequal_times(table, _time(table, columns, len(block))[0], name, time)
    place[:] = block
    return table


def _refuse_unequal_times(table: Table, time: Array, name: str, expected: Array) -> None:
    """Refuse a time that differs by more than half a step from that in the first file.

    The audit refuses a time that is missing in the first file.
    """
    with np.errstate(invalid="ignore"):  # of infinities
        step = np.abs(np.diff(expected))
        step = step[np.isfinite(step)]
        half = 0.5 * float(np.median(step, overwrite_input=True)) if step.size else 0.0
        apart = ~(np.abs(time - expected) <= half * (1 + _ROUNDING)) & np.isfinite(expected)
    if not apart.any():
        return
    k = int(np.argmax(apart))
    line = table.first_line + k if table.first_line else None
    raise InputError(
        f"{table.source} {f'sample {k}' if line is None else f'line {line}'} is at {time[k]:.6g} s "
        f"where {name} is at {expected[k]:.6g} s: two files of one recording must have the same "
        "times",
        file=table.source,
        line=line,
    )


def _time(table: Table, columns: Columns, n: int) -> tuple[Array, int | None]:
    """Return the time of each sample, (n,), s, and time 0 of a column of dates, ns since 1970."""
    name = columns.time
    if name is not None and columns.rate_hz is None and _holds_dates(table, name):
        if columns.time_unit is not None:
            raise InputError(
                f"{table.source}: column {name!r} holds ISO 8601 times, which have no unit: remove "
                f"{columns.time_keys[0]}",
                file=table.source,
                key=columns.time_keys[0],
                names=(name,),
            )
        cells: list[str] = table.columns[name].tolist()
        return times_from_iso(cells, name, table.source, table.first_line, columns.origin)
    counter = np.arange(n, dtype=np.float64) if name is None else table.numbers(name)
    if columns.rate_hz is not None and columns.modulus is not None:
        try:
            return times_from_counter(counter, columns.modulus, columns.rate_hz), None
        except InputError as error:
            raise error.located(table.source, file=table.source) from None
    if name is None or columns.rate_hz is not None:
        return counter / (columns.rate_hz or 1.0), None
    require_unit(counter, name, columns.time_unit, table.source, columns.time_keys)
    return counter * si_factor(columns.time_unit or "s", like="s"), None


def _holds_dates(table: Table, name: str) -> bool:
    """Return whether a column is text whose first cell is a date with a time."""
    column = table.columns[name]
    return column.dtype.kind == "U" and column.size > 0 and is_iso_time(str(column[0]))
