"""Make recordings from tables in memory: pandas, polars, Arrow, structured arrays, mappings."""

from collections.abc import Mapping, Sequence
from hashlib import sha256
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from inercal.basics.errors import InputError
from inercal.recordings import Recording
from inercal.recordings.io import column_table
from inercal.recordings.io.audit import audit, require_accepted
from inercal.recordings.io.column_table import Column, ReadRequest, Table
from inercal.recordings.io.table_recording import Columns, read_request, recording_from_table


def recording_from_frame(
    frame: Any,
    columns: Columns,
    limits: Mapping[str, tuple[float, float]] | None = None,
    name: str = "frame",
) -> Recording:
    """Convert a table in memory to an audited recording; the table is not changed.

    Parameters
    ----------
    frame : table
        A pandas or polars DataFrame, an Arrow table or record batch, a structured array, or a
        mapping of names to columns (n,). A named index of a pandas DataFrame is also a column.
        Dates are read as times; missing numbers become NaN.
    columns : Columns
        Contents of each column. All columns are in one table, so `second` must be empty.
    limits : mapping of channel to (lowest, highest), optional
        See `inercal.recordings.io.audit.audit`.
    name : str
        Name of the table in messages and in the calibration.

    Raises
    ------
    InputError
        A column is missing or does not contain numbers, or the audit refuses the recording.
    """
    if columns.second or columns.options:
        raise InputError(
            f"{name}: a table in memory cannot have a second file or reader options: join the "
            "tables, and remove the options",
            key="columns",
        )
    table = table_from_frame(frame, read_request(columns), name)
    recording = recording_from_table(table, columns)
    return require_accepted(audit(recording, columns.nonfinite, limits, in_place=True))


def table_from_frame(frame: Any, wanted: ReadRequest, name: str = "frame") -> Table:
    """Convert a table in memory to a `Table`; its hash covers the columns that are read.

    Raises
    ------
    InputError
        The object is not a table, a wanted column is missing, columns have unequal lengths, or a
        column contains neither numbers, dates nor text.
    """
    names = _names(frame, name)
    chosen = column_table.select_columns(names, wanted.names, name)
    found = {column: _column(frame, column, name) for column in chosen}
    column_table.refuse_unequal_lengths(
        {column: values.size for column, values in found.items()}, name
    )
    rows = next(iter(found.values())).size if found else 0
    if rows == 0:
        raise InputError(f"{name} has no rows", names=tuple(chosen))
    read: dict[str, Column] = {}
    for column, values in found.items():
        if values.dtype.kind == "O" or (column in wanted.text and values.dtype.kind in "iub"):
            read[column] = column_table.label_array([_text(one) for one in values], column, name)
        elif values.dtype.kind == "U":
            read[column] = column_table.label_array(cast(Sequence[str], values), column, name)
        elif column in wanted.whole:
            read[column] = wanted.number_column(column, values)
    blank, block = wanted.empty_columns(rows, [column for column in chosen if column not in read])
    for column, place in blank.items():
        place[:] = found[column]
        read[column] = place
    digest = sha256()
    for column in chosen:
        digest.update(column.encode() + b"\0" + np.ascontiguousarray(read[column]).tobytes())
    columns = {column: read[column] for column in chosen}
    return Table(tuple(names), columns, name, digest.hexdigest(), block=block)


def _names(frame: Any, name: str) -> list[str]:
    """Return the column names."""
    fields: tuple[str, ...] | None = getattr(getattr(frame, "dtype", None), "names", None)
    if hasattr(frame, "column_names"):  # Arrow; a record batch has names only in its schema
        return [str(one) for one in frame.column_names]
    if hasattr(frame, "schema") and hasattr(frame, "num_rows"):
        return [str(one) for one in frame.schema.names]
    if hasattr(frame, "columns"):
        index = getattr(getattr(frame, "index", None), "name", None)
        return [str(one) for one in frame.columns] + ([str(index)] if index is not None else [])
    if fields:
        return list(fields)
    if isinstance(frame, Mapping):
        return [str(one) for one in cast(Mapping[object, object], frame)]
    raise InputError(
        f"{name} is a {type(frame).__name__}: give a DataFrame, an Arrow table, a structured "
        "array, or columns by name"
    )


def _column(frame: Any, column: str, name: str) -> NDArray[Any]:
    """Return a column, (n,), as numbers, text, or text objects.

    Dates become ISO 8601 text, and durations become seconds.
    """
    index = getattr(frame, "index", None)
    if hasattr(frame, "columns") and getattr(index, "name", None) == column:
        held: Any = index
    elif hasattr(frame, "num_rows") and hasattr(frame, "schema"):
        held = frame.column(frame.schema.names.index(column))
    else:
        held = frame[column]
    kind = getattr(getattr(held, "dtype", None), "kind", "")
    # With a time zone pandas converts to UTC.
    values = np.asarray(held, "datetime64[ns]") if kind == "M" else np.asarray(held)
    if values.ndim != 1:
        text = f"has the shape {values.shape}; give each axis a column"
        raise column_table.column_error(name, column, text)
    if values.dtype.kind == "M":
        return np.datetime_as_string(values.astype("datetime64[ns]"))
    if values.dtype.kind == "m":
        return values.astype("timedelta64[ns]").astype(np.float64) * 1e-9
    if values.dtype.kind == "O":
        return _objects(values)
    if values.dtype.kind not in "fiubU":
        text = f"has the type {values.dtype}; give real numbers or text"
        raise column_table.column_error(name, column, text)
    return values


def _objects(values: NDArray[Any]) -> NDArray[Any]:
    """Convert objects to numbers if all are numbers or missing; otherwise return them unchanged."""
    if any(isinstance(one, str) for one in values):
        return values
    if all(isinstance(one, int) and not isinstance(one, bool) for one in values):
        return np.array(values.tolist())
    try:
        return np.array([np.nan if one is None else float(one) for one in values])
    except (TypeError, ValueError):
        return values


def _text(value: object) -> str:
    """Return an entry as a label; "" if it is missing."""
    return "" if value is None or value != value else str(value)
