"""Read the files of a recording, and find the roles of their columns.

Two files may contain the accelerometers and the gyros, each with its own clock. Several files with
the same columns are parts of one recording: one for each pose, or for each temperature.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from inercal.basics.errors import InputError
from inercal.pipeline.drafts.column_names import in_axis_order, role_of_name
from inercal.pipeline.drafts.column_roles import ColumnRoles, recognise_columns
from inercal.pipeline.drafts.column_values import finite_rows, require_finite_rows
from inercal.pipeline.drafts.draft_entries import DraftKey
from inercal.pipeline.drafts.signed_columns import sign_columns
from inercal.pipeline.drafts.stated_keys import stated_columns, stated_gyros, stated_options
from inercal.recordings.io.column_table import Table
from inercal.recordings.io.file_patterns import is_pattern, matching_files
from inercal.recordings.io.read import detect_reader, read_table

_MOST_TEXTS = 4  # columns of text
_SAME_TIME = 0.25  # of a step
_PAUSE_STEPS = 50.0  # between the parts in a draft
_STILL = 0.02  # scatter of a part at rest, relative to the range of all parts
_FEWEST_POSES = 6


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


def recording_name(logs: Sequence[Path]) -> str:
    """Return a name for a recording: that of its file, its folder, or what its files share."""
    stem = logs[0].resolve().stem.partition("*")[0]
    if len(logs) > 1:
        stem = _shared_begin([log.stem for log in logs]) or logs[0].stem
    return stem.strip(" _-.+") or "recording"


def read_logs(logs: Sequence[Path], values: Mapping[str, Any]) -> LogFiles:
    """Read the files of a recording and find the roles of their columns.

    Raises
    ------
    InputError
        If a file cannot be read, or if the files do not belong together.
    """
    files = [file for log in logs for file in _expanded(log)]
    if twice := next((file for file in files if files.count(file) > 1), None):
        raise InputError(f"{twice} is given twice: name each file once", file=twice)
    if len(files) == 1:
        return _single_file(files[0], values)
    read = [_read(file, values) for file in files]
    tables, signs = [table for table, _ in read], next((one for _, one in read if one), ())
    if len(files) == 2 and (found := _separate_gyros(files, tables, values)) is not None:
        return replace(found, signs=signs)
    if any(table.names != tables[0].names or not table.header for table in tables):
        raise InputError(
            f"{files[1]} is neither the gyros' file for {files[0]} nor a file with the same "
            "columns: give one recording, one file with the accelerometers and one with the "
            "gyros, or several files with the same header",
            file=files[1],
            names=tuple(map(str, files)),
        )
    return replace(_parts(files, tables, values), signs=signs)


def _expanded(log: Path) -> tuple[Path, ...]:
    """Return the files that a name with a star or a folder stands for."""
    if log.is_dir():
        files = sorted(one for one in log.iterdir() if one.is_file() and one.name[0] != ".")
        suffixes = [one.suffix for one in files if one.suffix not in (".toml", ".json", ".html")]
        if not suffixes:
            raise InputError(f"{log}: the folder contains no recording", file=log)
        usual = max(suffixes, key=suffixes.count)
        return tuple(one for one in files if one.suffix == usual)
    return tuple(matching_files(log).values()) if is_pattern(log) else (log,)


def _single_file(log: Path, values: Mapping[str, Any]) -> LogFiles:
    table, signs = _read(log, values)
    stated = stated_columns(values, table, second_file=False)
    roles = recognise_columns(finite_rows(table), detect_reader(log).name, stated)
    used = [column for triad in roles.triads.values() for column in triad]
    used += [roles.single["time"]] if "time" in roles.single else []
    if values.get("data.nonfinite") == "drop":
        return LogFiles((log,), finite_rows(table, used), None, roles, signs)
    require_finite_rows(log, table, used)
    return LogFiles((log,), table, None, roles, signs)


def _separate_gyros(
    files: Sequence[Path], tables: Sequence[Table], values: Mapping[str, Any]
) -> LogFiles | None:
    """Return the two files as accelerometers and gyros; None if that is not what they are."""
    for first, second in ((0, 1), (1, 0)):
        table, gyros = tables[first], tables[second]
        try:
            stated = stated_columns(values, table, second_file=True)
            roles = recognise_columns(table, detect_reader(files[first]).name, stated)
            found = recognise_columns(gyros, stated=stated_gyros(values, gyros))
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
        return LogFiles((files[first], files[second]), table, gyros, joined)
    return None


def _bare_axes(table: Table, roles: ColumnRoles) -> tuple[str, ...] | None:
    """Return the columns of a file that contains only times and one triad."""
    names = [n for n in table.names if table.columns[n].dtype.kind != "U"]
    free = [n for n in names if role_of_name(n) is None and n not in roles.single.values()]
    return in_axis_order(free) if len(free) == len("xyz") else None


def _with_own_clock(
    file: Path, table: Table, gyros: Table, roles: ColumnRoles, found: ColumnRoles
) -> tuple[ColumnRoles, Table]:
    """Return the roles with `gyro_time` if the gyros have another clock, and the gyros then."""
    clocks = [one.single.get("time") for one in (roles, found)]
    rows = [next(iter(one.columns.values())).size for one in (table, gyros)]
    if None in clocks or any(
        one.columns[str(clock)].dtype.kind == "U"
        for one, clock in zip((table, gyros), clocks, strict=True)
    ):
        if rows[0] == rows[1]:
            return roles, gyros
        raise InputError(
            f"{file} has {rows[1]} rows instead of {rows[0]}, and not both files have a column of "
            "times in numbers, by which to pair the samples",
            file=file,
        )
    time, other = table.numbers(str(clocks[0])), gyros.numbers(str(clocks[1]))
    step = float(np.median(np.diff(time)))
    if rows[0] == rows[1] and np.abs(time - other).max() <= _SAME_TIME * step:
        return roles, gyros
    nearest = np.rint(np.interp(time, other, np.arange(other.size))).astype(int)
    paired = {name: column[nearest] for name, column in gyros.columns.items()}
    single = {**roles.single, "gyro_time": str(clocks[1])}
    reasons = {**roles.reasons, "gyro_time": "the gyros were sampled at other times"}
    return replace(roles, single=single, reasons=reasons), replace(
        gyros, columns=paired, block=None
    )


def _parts(files: Sequence[Path], tables: Sequence[Table], values: Mapping[str, Any]) -> LogFiles:
    """Return several files with the same columns as one recording."""
    pattern = _pattern(files)
    by_path = dict(zip(files, tables, strict=True))
    ordered = [by_path[file] for file in matching_files(pattern).values()]
    names = [n for n in ordered[0].names if all(n in one.columns for one in ordered)]
    columns = {name: np.concatenate([one.columns[name] for one in ordered]) for name in names}
    table = replace(ordered[0], columns=columns, block=None)
    ends = np.cumsum([next(iter(one.columns.values())).size for one in ordered])
    edges, spans = ends[:-1], tuple(pairwise([0, *ends.tolist()]))
    stated = stated_columns(values, table, second_file=False)
    first = recognise_columns(ordered[0], stated=stated).single.get("time")
    if first is not None and columns[first].dtype.kind != "U":
        columns[first] = _one_after_the_other(np.split(table.numbers(first), edges))
    roles = recognise_columns(table, stated=stated)
    single = {role: name for role, name in roles.single.items() if role != "label"}
    marks = "found"
    if (triad := roles.triads.get("accelerometer")) is not None:
        force = np.stack([table.numbers(name) for name in triad], axis=-1)
        scatter = [part.std(axis=0).max() for part in np.split(force, edges)]
        still = max(scatter) <= _STILL * np.ptp(force, axis=0).max()
        marks = "labels" if still and len(files) >= _FEWEST_POSES else "found"
    roles = replace(roles, single=single, part_marks=marks, parts=spans)
    return LogFiles((pattern,), table, None, roles)


def _one_after_the_other(times: Sequence[np.ndarray]) -> np.ndarray:
    """Return the times of all parts, with a gap between them as the loader leaves one."""
    moved: list[np.ndarray] = []
    for time in times:
        step = float(np.median(np.diff(time))) if time.size > 1 else 1.0
        start = float(moved[-1][-1]) + _PAUSE_STEPS * step if moved else 0.0
        moved.append(time - time[0] + start)
    return np.concatenate(moved)


def _shared_begin(names: Sequence[str]) -> str:
    same = [len(set(letters)) == 1 for letters in zip(*names, strict=False)]
    return names[0][: [*same, False].index(False)]


def _pattern(files: Sequence[Path]) -> Path:
    """Return the name with a star that stands for exactly these files."""
    folder, names = files[0].parent, [file.name for file in files]
    before = re.sub(r"[-+]?[\d.,]*$", "", _shared_begin(names))
    pattern = folder / f"{before}*{files[0].suffix}"
    same = all(file.parent == folder and file.suffix == files[0].suffix for file in files)
    others = sorted(set(matching_files(pattern).values()) - set(files)) if same else []
    if not same or others:
        why = f"{pattern} also stands for {others[0].name}" if others else "their names differ"
        raise InputError(
            f"{files[0]} and {files[-1]}: {why}; put the files of the recording in a folder of "
            "their own, with names of the same kind",
            file=files[0],
            names=tuple(map(str, files)),
        )
    return pattern


def _read(log: Path, values: Mapping[str, Any]) -> tuple[Table, tuple[DraftKey, ...]]:
    """Read a table with signed readings, and return the key of [data] that gives the signs.

    Columns that begin with numbers or empty cells but contain text are text.
    """
    options = stated_options(values, log)
    text: list[str] = []
    while True:
        try:
            table = read_table(log, text=text, options=options)
            return sign_columns(table, values.get("data.signed_bits"))
        except InputError as error:
            column = error.names[0] if error.names else ""
            if not column or column in text or error.line is None or len(text) == _MOST_TEXTS:
                raise
            text.append(column)
