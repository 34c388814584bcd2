"""Read the files of a recording, and find the roles of their columns."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from inercal.basics.errors import InputError
from inercal.pipeline.drafts.column_roles import ColumnRoles, recognise_columns
from inercal.pipeline.drafts.column_values import finite_rows, require_finite_rows
from inercal.pipeline.drafts.stated_keys import stated_columns, stated_gyros
from inercal.recordings.io.column_table import Table
from inercal.recordings.io.read import detect_reader, read_table

_MOST_TEXTS = 4  # columns of text


def recognise_files(
    logs: Sequence[Path], values: Mapping[str, Any]
) -> tuple[Table, Table | None, ColumnRoles]:
    """Return the table, the gyros' table if it is a separate file, and the column roles."""
    table = _read(logs[0], values)
    stated = stated_columns(values, table, second_file=len(logs) > 1)
    alone = len(logs) == 1
    numbers = finite_rows(table) if alone else table
    roles = recognise_columns(numbers, detect_reader(logs[0]).name, stated)
    used = [column for triad in roles.triads.values() for column in triad]
    used += [roles.single["time"]] if "time" in roles.single else []
    if alone and values.get("data.nonfinite") == "drop":
        table = finite_rows(table, used)
    elif alone:
        require_finite_rows(logs[0], table, used)
    gyros = _second_table(logs, table, roles, values)
    if gyros is None:
        return table, None, roles
    second = recognise_columns(gyros, stated=stated_gyros(values, gyros))
    joined = replace(
        roles,
        triads={**roles.triads, "gyro": second.triads["gyro"]},
        reasons={**second.reasons, **roles.reasons},
        units={**second.units, **roles.units},
    )
    return table, gyros, joined


def _read(log: Path, values: Mapping[str, Any]) -> Table:
    """Read a table; columns that begin with numbers or empty cells but contain text are text."""
    stated = {key: values.get(f"data.{key}") for key in detect_reader(log).keys}
    options = {key: value for key, value in stated.items() if value is not None}
    text: list[str] = []
    while True:
        try:
            return read_table(log, text=text, options=options)
        except InputError as error:
            column = error.names[0] if error.names else ""
            if not column or column in text or error.line is None or len(text) == _MOST_TEXTS:
                raise
            text.append(column)


def _second_table(
    logs: Sequence[Path], table: Table, roles: ColumnRoles, values: Mapping[str, Any]
) -> Table | None:
    if len(logs) == 1:
        return None
    if len(logs) > 2:
        raise InputError(
            f"{len(logs)} files were given: give one recording, or one file with the "
            "accelerometers and one with the gyros",
            names=tuple(map(str, logs)),
        )
    second = _read(logs[1], values)
    rows, others = (next(iter(one.columns.values())).size for one in (table, second))
    found = recognise_columns(second, stated=stated_gyros(values, second)).triads
    if "gyro" not in found or "gyro" in roles.triads or rows != others:
        raise InputError(
            f"{logs[1]} is not the gyros' file for {logs[0]}: it has {others} rows instead of "
            f"{rows}, or the first file already contains the gyros; draft a run file for each",
            file=logs[1],
        )
    return second
