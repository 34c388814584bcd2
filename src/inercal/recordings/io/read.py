"""Read tables and recordings from files in any registered format."""

import os
from collections.abc import Callable, Collection, Generator, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import cast

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.parallel import available_cores
from inercal.basics.units import format_count
from inercal.recordings import Recording
from inercal.recordings.io.audit import audit, audit_rows, require_accepted
from inercal.recordings.io.column_table import ReadRequest, Table, file_head, open_error
from inercal.recordings.io.isolation import MOST_VALUES_KEY, read_isolated
from inercal.recordings.io.readers import (
    HEAD_BYTES,
    MOST_VALUES_OPTION,
    Reader,
    refuse_unknown_options,
    refuse_wrong_content,
    select_reader,
)
from inercal.recordings.io.row_checks import check_finite
from inercal.recordings.io.simulation_mark import stored_mark
from inercal.recordings.io.table_recording import (
    Columns,
    number_block,
    read_request,
    recording_from_table,
    sample_times,
)
from inercal.recordings.io.time_stamps import nearest_samples
from inercal.recordings.io.wrapped_numbers import sign_in_place

_LONG = 1 << 23  # bytes; for shorter files, starting a reading process takes longer than it saves
_MOST_AT_ONCE = 4  # files, because of the memory that reading them takes
_ROUNDING = 1e-6  # of half a step, for stamps with few digits


def read_table(
    path: str | os.PathLike[str],
    wanted: Collection[str] | None = None,
    text: Collection[str] = (),
    options: Mapping[str, object] | None = None,
) -> Table:
    """Read a table: text, .npz, Parquet, .mat, HDF5, or a format that another package registers.

    The format is determined by the content of the file and then by its suffix.

    Parameters
    ----------
    path : path-like
        The file.
    wanted : collection of str or None
        Columns to return; None for all columns.
    text : collection of str
        Columns to return as text even if they look like numbers.
    options : mapping of str to object, optional
        Options of the reader (`inercal.recordings.io.readers`).

    Raises
    ------
    InputError
        The file cannot be read as a table with these columns.
    """
    path, options = Path(path), options or {}
    _refuse_unknown_options(options, path)
    names = None if wanted is None else tuple(wanted)
    return _read(path, ReadRequest(names, tuple(text)), options)


def detect_reader(path: Path) -> Reader:
    """Return the reader for a file, chosen by its content and then by its suffix.

    Raises
    ------
    InputError
        The path is not a regular file, the file cannot be opened, or it contains something else.
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
        head = file_head(path, HEAD_BYTES)
    except OSError as error:
        raise open_error(path, error) from error
    refuse_wrong_content(path, head)
    return select_reader(path, head)


def _read(path: Path, wanted: ReadRequest, options: Mapping[str, object]) -> Table:
    """Read a table from a file; the reader receives the options that it knows."""
    reader = detect_reader(path)
    before = _state(path)
    read = partial(reader.read, **reader.option_values(options))
    try:
        if reader.isolation is None:
            table = _read_marked(path, read, wanted)
        else:
            most = cast(int | None, options.get(MOST_VALUES_OPTION.name))
            table = read_isolated(
                reader.isolation, path, _read_marked, read, wanted, most_values=most
            )
            _refuse_too_many_values(table, most)
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


def _read_all(
    files: Sequence[tuple[Path, ReadRequest]], options: Mapping[str, object]
) -> Generator[Table]:
    """Yield the tables of several files in order; reading processes read long files ahead."""

    def read(one: tuple[Path, ReadRequest]) -> Table:
        return _read(*one, options)

    long = sum(_is_read_apart(path) for path, _ in files) if len(files) > 1 else 0
    if (workers := min(long, available_cores(), _MOST_AT_ONCE)) < 2:
        yield from map(read, files)
        return
    from concurrent.futures import ThreadPoolExecutor

    pool = ThreadPoolExecutor(workers)
    try:
        yield from pool.map(read, files)
    finally:
        pool.shutdown(cancel_futures=True)


def _is_read_apart(path: Path) -> bool:
    """Return whether a file is long, and a separate process reads it."""
    with suppress(InputError, OSError):
        isolation = detect_reader(path).isolation if path.stat().st_size >= _LONG else None
        return isolation is not None and not isolation.is_bounded(path)
    return False


def _read_marked(path: Path, read: Callable[..., Table], wanted: ReadRequest) -> Table:
    """Read a table from a file, including its simulation mark."""
    table = read(path, wanted)
    return replace(table, simulation=table.simulation or stored_mark(path))


def _refuse_too_many_values(table: Table, most: int | None) -> None:
    """Refuse a table with more values than [data] states."""
    values = sum(column.size for column in table.columns.values())
    if most is not None and values > most:
        raise InputError(
            f"{table.source} has {values} values in the columns that are read, more than "
            f"{MOST_VALUES_KEY} = {most}: export only the columns you use, or raise the limit",
            key=MOST_VALUES_KEY,
        )


def _state(path: Path) -> tuple[int, int, int] | None:
    """Return data that reveal whether a file was changed; None if it does not exist."""
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
        Contents of each column.
    limits : mapping of channel to (lowest, highest), optional
        See `inercal.recordings.io.audit.audit`.
    second : path-like, optional
        The file with the columns `columns.second`.

    Raises
    ------
    InputError
        A file cannot be read, two files were not sampled together, or the audit refuses the
        recording.
    """
    recording = read_unaudited(Path(path), columns, None if second is None else Path(second))
    return require_accepted(audit(recording, columns.nonfinite, limits, in_place=True))


def read_readback(path: str | os.PathLike[str], columns: Columns) -> Recording:
    """Read the readback of a bench from a separate file, with the bench's axes as channels.

    Rows and times are audited like those of a recording, but an axis may be constant throughout.

    Raises
    ------
    InputError
        The file cannot be read, or the audit refuses it.
    """
    recording = read_unaudited(Path(path), columns)
    return require_accepted(audit_rows(recording, columns.nonfinite, in_place=True))


def read_each(files: Collection[Path], columns: Columns) -> Generator[Recording]:
    """Yield unaudited recordings with the same columns, whose times count from the first file.

    Raises
    ------
    InputError
        A file cannot be read; the recordings of the files before it have been yielded.
    """
    request = read_request(columns)
    with closing(_read_all([(path, request) for path in files], columns.options)) as tables:
        for path in files:
            _refuse_unknown_options(columns.options, path)
            recording = recording_from_table(next(tables), columns)
            columns = replace(columns, origin=recording.origin)
            yield recording


def read_unaudited(path: Path, columns: Columns, second: Path | None = None) -> Recording:
    """Read a recording from its files without auditing it; keep the mark of a simulation.

    Raises
    ------
    InputError
        A file cannot be read, or two files do not belong together.
    """
    if (second is None) != (not columns.second):
        raise InputError(f"{path}: state both a second file and its columns, or neither", file=path)
    files = [path] if second is None else [path, second]
    _refuse_unknown_options(columns.options, *files)
    if second is not None and columns.second_time is not None:
        return _join_by_time(path, second, columns)
    together = tuple(column for _, column, _ in columns.second)
    names = together if columns.time is None else (columns.time, *together)
    further = ReadRequest(names, (), together, whole=columns.stamps)
    requests = zip(files, (read_request(columns), further), strict=False)
    with closing(_read_all([*requests], columns.options)) as tables:
        recording = recording_from_table(next(tables), columns)
        if second is None:
            return recording
        other = next(tables)
    _add_second_file(other, second, replace(columns, origin=recording.origin), recording)
    kept = filter(None, (recording.kept_corrections, other.kept_corrections))
    return replace(
        recording,
        source=f"{recording.source} and {other.source}",
        first_row=recording.first_row if other.first_line == recording.first_row else 0,
        line_breaks=recording.line_breaks if other.line_breaks == recording.line_breaks else (),
        kept_corrections="; ".join(kept),
        simulation=recording.simulation or other.simulation,
    )


def _join_by_time(path: Path, second: Path, columns: Columns) -> Recording:
    """Join two files with different sampling times into one recording.

    Raises
    ------
    InputError
        A file cannot be read, its time decreases, or the files do not overlap in time.
    """
    parts = {"channels": columns.second, "time": columns.second_time, "label": None}
    one = replace(columns, second=(), second_time=None)
    other = replace(one, **parts, temperature=None, readback=())
    requests = [(path, read_request(one)), (second, read_request(other))]
    with closing(_read_all(requests, columns.options)) as tables:
        first = recording_from_table(next(tables), one)
        further = recording_from_table(next(tables), replace(other, origin=first.origin))
    for recording in (first, further):
        _require_increasing_time(recording)
        if columns.nonfinite == "refuse":  # only here are the lines of each file known
            found = check_finite(recording, recording.where, drop=False).findings
            require_accepted(recording.with_findings((*recording.findings, *found)))
    fewer = first if first.time.size <= further.time.size else further
    more = further if fewer is first else first
    near, found = nearest_samples(more.time, fewer.time)
    if not found.any():
        raise InputError(
            f"{first.source} covers {_span(first)} s and {further.source} {_span(further)} s: "
            "both need times of the same clock",
            file=path,
        )
    kept, joined = fewer.take(found), more.take(near[found])
    first_part, second_part = (kept, joined) if fewer is first else (joined, kept)
    texts = filter(None, (first.kept_corrections, further.kept_corrections))
    return replace(
        first_part,
        time=kept.time,
        data=np.hstack([first_part.data, second_part.data]),
        channels=first.channels + further.channels,
        units=first.units + further.units,
        source=first.source if path == second else f"{first.source} and {further.source}",
        kept_corrections="; ".join(texts),
        simulation=first.simulation or further.simulation,
    )


def _span(recording: Recording) -> str:
    """Return the first and the last time on the file's clock, in words."""
    first, last = recording.stamps[[0, -1]]
    return f"{first:.12g} to {last:.12g}"


def _require_increasing_time(recording: Recording) -> None:
    """Refuse times that decrease or are missing, because no sample would then be the nearest."""
    bad = np.flatnonzero(~(np.diff(recording.time) >= 0))
    if bad.size:
        raise InputError(
            f"{recording.source}: time does not increase at {recording.where(int(bad[0]) + 1)}: "
            "the clock was reset, or a time is missing; split or repair the file there",
            file=recording.source,
            line=recording.line(int(bad[0]) + 1),
        )


def _add_second_file(table: Table, path: Path, columns: Columns, first: Recording) -> None:
    """Put the columns of the second file into `first`."""
    together = tuple(column for _, column, _ in columns.second)
    block = number_block(table, together)
    name, time, place = first.source, first.time, first.data[:, -len(together) :]
    if len(block) != len(place):
        raise InputError(
            f"{table.source} has {format_count(len(block), 'row')} and {name} has {len(place)}: "
            "two files of one recording must have the same rows",
            file=path,
        )
    if columns.time is not None:
        _refuse_unequal_times(table, sample_times(table, columns, len(block)).time, name, time)
    place[:] = block
    if columns.signed_bits is not None:
        sign_in_place(place, columns.signed_bits, table.source)


def _refuse_unequal_times(table: Table, time: Array, name: str, expected: Array) -> None:
    """Refuse a time that differs by more than half a step from that in the first file.

    The audit refuses times that are missing in the first file.
    """
    with np.errstate(invalid="ignore"):  # from infinities
        step = np.abs(np.diff(expected))
        step = step[np.isfinite(step)]
        half = 0.5 * float(np.median(step, overwrite_input=True)) if step.size else 0.0
        apart = ~(np.abs(time - expected) <= half * (1 + _ROUNDING)) & np.isfinite(expected)
    if not apart.any():
        return
    k = int(np.argmax(apart))
    raise InputError(
        f"{table.source} {table.place(k)} is at {time[k]:.6g} s "
        f"where {name} is at {expected[k]:.6g} s: two files of one recording must have the same "
        "times",
        file=table.source,
        line=table.line(k),
    )
