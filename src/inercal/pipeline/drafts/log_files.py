"""Read the files of a recording, and find the roles of their columns.

Two files may contain the accelerometers and the gyros, each with its own clock. Several files with
the same columns are parts of one recording: one for each pose, or for each temperature.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from inercal.basics.errors import InputError
from inercal.pipeline.drafts import column_values
from inercal.pipeline.drafts.column_names import (
    in_axis_order,
    is_other_quantity,
    plain_name,
    role_of_name,
)
from inercal.pipeline.drafts.column_roles import (
    NO_GYROS,
    NO_MARKS,
    NO_SENSOR,
    ColumnRoles,
    recognise_columns,
)
from inercal.pipeline.drafts.draft_entries import DraftKey
from inercal.pipeline.drafts.file_parts import join_parts
from inercal.pipeline.drafts.rest_recording import read_log_table, sign_columns
from inercal.pipeline.drafts.stated_keys import stated_columns, stated_options, stated_triad
from inercal.recordings.data.rest_marks import marks_from_file
from inercal.recordings.io.column_table import Table
from inercal.recordings.io.file_patterns import is_pattern, matching_files
from inercal.recordings.io.read import detect_reader, read_table
from inercal.recordings.io.split_bags import METADATA, bag_parts
from inercal.recordings.io.time_stamps import times_from_iso

MARKS_FILE = "marks.json"
"""Name of a file of marks beside a log."""

_OTHER_SENSORS = re.compile(
    r"(\w*_)?(magneto\w*|magnet(ic)?|mag|compass|orientation|gravity|location|gps)(_\w*)?"
)  # names of files
_SAME_TIME = 0.25  # of a step


class NoCommonClock(InputError):
    """Two files or arrays have different lengths, and no times with which to pair their samples."""


@dataclass(frozen=True)
class LogFiles:
    """The files of a recording.

    Parameters
    ----------
    files : tuple of Path
        The files for [data] file, which may be one name with a star, and for gyro_file.
    table : Table
        The first file, or all parts.
    gyros : Table or None
        The gyros' file, with as many rows as the table.
    roles : ColumnRoles
    signs : tuple of DraftKey
        The key of [data] that gives unsigned counts their signs; empty if they have them.
    """

    files: tuple[Path, ...]
    table: Table
    gyros: Table | None
    roles: ColumnRoles
    signs: tuple[DraftKey, ...] = ()


def read_logs(logs: Sequence[Path], values: Mapping[str, Any]) -> LogFiles:
    """Read the files of a recording and find the roles of their columns.

    Raises
    ------
    InputError
        If a file cannot be read, or if the files do not belong together.
    """
    return _with_marks(_read_files(logs, values), values)


def _read_files(logs: Sequence[Path], values: Mapping[str, Any]) -> LogFiles:
    files = _whole_bag([file for log in logs for file in _expanded(log)])
    if twice := next((file for file in files if files.count(file) > 1), None):
        raise InputError(f"{twice} is given twice: name each file once", file=twice)
    if len(files) == 1:
        return _single_file(files[0], values)
    read = [_read(file, values) for file in files]
    others = [file for file, (one, _) in zip(files, read, strict=True) if _is_other(file, one)]
    if 0 < len(others) < len(files):
        kept = [file for file in files if file not in others]
        found = _read_files(kept, values)
        text = f"left out, because no method uses them: {', '.join(one.name for one in others)}"
        return replace(found, roles=found.roles.because({NO_SENSOR: text}))
    tables, signs = [table for table, _ in read], next((one for _, one in read if one), ())
    if len(files) == 2:
        found = _separate_angles(files, tables, values) or _separate_gyros(files, tables, values)
        if found is not None:
            return replace(found, signs=signs)
    headers = [table.names if table.header else () for table in tables]
    usual = max(headers, key=headers.count)
    if any(names != usual or not names for names in headers):
        odd = next((k for k, names in enumerate(headers) if names != usual), 1)
        raise InputError(
            f"{files[odd]} is neither the gyros' file for {files[headers.index(usual)]} nor a file "
            "with the same columns: give one recording, one file with the accelerometers and one "
            "with the gyros, or several files with the same header",
            file=files[odd],
            names=tuple(map(str, files)),
        )
    pattern, table, roles = join_parts(files, tables, values)
    return LogFiles((pattern,), table, None, roles, signs)


def _with_marks(found: LogFiles, values: Mapping[str, Any]) -> LogFiles:
    """Return the recording with the file of marks beside it, if its marks suit the recording."""
    roles, rows, path = found.roles, found.table.rows, found.files[0].parent / MARKS_FILE
    if roles.means or roles.marks or "data.marks" in values or not path.is_file():
        return found
    try:
        spans = tuple((mark.start, mark.stop) for mark in marks_from_file(path))
        why = "" if all(0 <= a < b <= rows for a, b in spans) else f"the log has {rows} rows"
    except InputError as error:
        spans, why = (), str(error).removeprefix(f"{path}: ")
    if "label" in roles.single and not why:
        why = f"the column {roles.single['label']} names the sections"
    if why:
        text = f"{path.name} beside the log is not used: {why}"
        return replace(found, roles=roles.because({NO_MARKS: text}))
    reasons = {"marks": "a file of marks beside the log"}
    return replace(found, roles=roles.because(reasons, marks=str(path), parts=spans))


def _is_other(file: Path, table: Table) -> bool:
    """Return whether a file contains the readings of another sensor, such as a magnetometer."""
    names = [name for name in table.names if role_of_name(name) is None]
    named = bool(names) and all(map(is_other_quantity, names))
    bare = sorted(map(plain_name, names)) == list("xyz")
    return named or (bare and _OTHER_SENSORS.fullmatch(plain_name(file.stem)) is not None)


def _whole_bag(files: list[Path]) -> list[Path]:
    """Return the file that lists the parts of a split ROS 2 bag, if these are all of them."""
    listed = files[0].parent / METADATA
    if len(files) < 2 or not listed.is_file() or set(files) != set(bag_parts(listed)):
        return files
    return [listed]


def _expanded(log: Path) -> tuple[Path, ...]:
    """Return the files that a name with a star or a folder stands for."""
    if log.is_dir():
        if (log / METADATA).is_file():
            return (log / METADATA,)
        files = sorted(one for one in log.iterdir() if one.is_file() and one.name[0] != ".")
        suffixes = [one.suffix for one in files if one.suffix not in (".toml", ".json", ".html")]
        if not suffixes:
            raise InputError(f"{log}: the folder contains no recording", file=log)
        usual = max(suffixes, key=suffixes.count)
        return tuple(one for one in files if one.suffix == usual)
    return tuple(matching_files(log).values()) if is_pattern(log) else (log,)


def _single_file(log: Path, values: Mapping[str, Any]) -> LogFiles:
    table, signs = _read(log, values)
    if (found := _arrays_of_two_lengths(log, table, values)) is not None:
        return replace(found, signs=signs)
    stated = stated_columns(values, table, second_file=False)
    roles = recognise_columns(column_values.finite_rows(table), detect_reader(log).name, stated)
    used = [column for triad in roles.triads.values() for column in triad]
    used += [roles.single["time"]] if "time" in roles.single else []
    if values.get("data.nonfinite") == "drop":
        return LogFiles((log,), column_values.finite_rows(table, used), None, roles, signs)
    column_values.require_finite_rows(log, table, used)
    return LogFiles((log,), table, None, roles, signs)


def _arrays_of_two_lengths(log: Path, table: Table, values: Mapping[str, Any]) -> LogFiles | None:
    """Return accelerometers and gyros of a file in which they have different lengths.

    None if all columns have the usual length, or if the others are no gyros. Gyros without times of
    their own are left out, with the reason.
    """
    for length in sorted(
        {n for n in table.other_lengths.values() if n >= column_values.FEWEST_SAMPLES}
    ):
        names = tuple(name for name, n in table.other_lengths.items() if n == length)
        other = read_table(log, names, options=stated_options(values, log))
        try:
            found = _separate_gyros((log, log), (table, replace(other, names=names)), values)
        except NoCommonClock:
            roles = recognise_columns(table, detect_reader(log).name)
            why = (
                f"{', '.join(names)}: left out, because they have {length} values and "
                f"{', '.join(table.names)} {table.rows}, and not both have a column of times"
            )
            return LogFiles((log,), table, None, roles.because({NO_GYROS: why}))
        if found is not None:
            return found
    return None


def _separate_angles(
    files: Sequence[Path], tables: Sequence[Table], values: Mapping[str, Any]
) -> LogFiles | None:
    """Return a recording with a file of the turntable's angles; None if there is none."""
    found = [recognise_columns(table) for table in tables]
    for first, second in ((0, 1), (1, 0)):
        table, angles = tables[first], found[second]
        if not angles.table or angles.triads or found[first].table or "time" not in angles.single:
            continue
        stated = stated_columns(values, table, second_file=False)
        roles = recognise_columns(table, detect_reader(files[first]).name, stated)
        roles = roles.because(
            {"table_time": angles.reasons["time"]},
            table=angles.table,
            table_file=str(files[second]),
            single={**roles.single, "table_time": angles.single["time"]},
        )
        return LogFiles((files[first],), table, None, roles)
    return None


def _separate_gyros(
    files: Sequence[Path], tables: Sequence[Table], values: Mapping[str, Any]
) -> LogFiles | None:
    """Return the two files as accelerometers and gyros; None if they contain something else."""
    for first, second in ((0, 1), (1, 0)):
        table, gyros = tables[first], tables[second]
        try:
            stated = stated_columns(values, table, second_file=True)
            roles = recognise_columns(table, detect_reader(files[first]).name, stated)
            found = recognise_columns(gyros, stated=stated_triad("gyro", values, gyros))
        except InputError:
            if first == 0:
                continue
            raise
        own = found.triads.get("gyro") or _bare_axes(gyros, found)
        if "accelerometer" not in roles.triads or "gyro" in roles.triads or own is None:
            continue
        if "accelerometer" in found.triads:
            continue
        joined = replace(
            roles,
            triads={**roles.triads, "gyro": own},
            reasons={"gyro": "the columns of their file"} | {**found.reasons, **roles.reasons},
            units={**found.units, **roles.units},
        )
        joined, gyros = _with_own_clock(files[second], table, gyros, joined, found)
        both = tuple(dict.fromkeys((files[first], files[second])))
        return LogFiles(both, table, gyros, joined)
    return None


def _bare_axes(table: Table, found: ColumnRoles) -> tuple[str, ...] | None:
    """Return the columns of a file that contains only times and one triad."""
    names = [n for n in table.names if table.columns[n].dtype.kind != "U"]
    free = [n for n in names if role_of_name(n) is None and n not in found.single.values()]
    if any(map(is_other_quantity, free)):
        return None
    return in_axis_order(free) if len(free) == len("xyz") else None


def _with_own_clock(
    file: Path, table: Table, gyros: Table, roles: ColumnRoles, found: ColumnRoles
) -> tuple[ColumnRoles, Table]:
    """Return the roles, with `gyro_time` if the gyros have their own clock, and the gyros."""
    names = [one.single.get("time") for one in (roles, found)]
    rows = [one.rows for one in (table, gyros)]
    dates = [
        name is not None and one.columns[name].dtype.kind == "U"
        for one, name in zip((table, gyros), names, strict=True)
    ]
    clock, own = names
    if clock is None or own is None or dates[0] != dates[1]:
        if rows[0] == rows[1]:
            return roles, gyros
        raise NoCommonClock(
            f"{file} has {rows[1]} rows instead of {rows[0]}, and not both files have a column of "
            "times, both in numbers or both as dates, by which to pair the samples",
            file=file,
        )
    if dates[0]:
        time, origin = times_from_iso(table.columns[clock].tolist(), clock, table)
        other, _ = times_from_iso(gyros.columns[own].tolist(), own, gyros, origin)
    else:
        time, other = table.numbers(clock), gyros.numbers(own)
    step = float(np.median(np.diff(time)))
    if rows[0] == rows[1] and np.abs(time - other).max() <= _SAME_TIME * step:
        return roles, gyros
    nearest = np.rint(np.interp(time, other, np.arange(other.size))).astype(int)
    paired = {name: column[nearest] for name, column in gyros.columns.items()}
    reasons = {"gyro_time": "the gyros were sampled at other times"}
    roles = roles.because(reasons, single={**roles.single, "gyro_time": own})
    return roles, replace(gyros, columns=paired, block=None)


def _read(log: Path, values: Mapping[str, Any]) -> tuple[Table, tuple[DraftKey, ...]]:
    """Read a table with signed readings, and return the key of [data] that gives the signs."""
    table = column_values.without_unusable(read_log_table(log, stated_options(values, log)))
    return sign_columns(table, values.get("data.signed_bits"))
