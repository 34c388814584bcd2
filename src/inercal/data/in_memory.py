"""Data in memory as a table of columns: arrays, DataFrames, Arrow tables, recordings."""

from collections.abc import Mapping
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from inercal.io.column_table import ReadRequest
from inercal.io.frames import table_from_frame
from inercal.recording import Recording

ACCEPTED = (
    "the path of a run file or of a recording, a Recording, a DataFrame (pandas, polars), an Arrow "
    "table, a mapping of names to arrays, or an array (samples, columns)"
)
_TABLE_ATTRIBUTES = ("columns", "column_names", "schema", "dtype")
_TIME, _LABEL, _TEMPERATURE = "time", "label", "temperature"


def columns_in_memory(data: object) -> dict[str, NDArray[Any]]:
    """Return the columns by name; those of an array without names are "1", "2", ….

    Raises
    ------
    TypeError
        Not a table; the message says what is accepted.
    InputError
        A column that holds neither numbers, dates nor text.
    """
    if isinstance(data, Recording):
        return _recording_columns(data)
    source = cast(Any, data)
    array = cast(NDArray[Any], data) if isinstance(data, np.ndarray) else None
    if array is not None and array.dtype.names is None:
        if array.ndim == 2:
            return {str(k + 1): array[:, k] for k in range(array.shape[1])}
        raise TypeError(f"data are an array of shape {array.shape}; calibrate takes {ACCEPTED}")
    if not (isinstance(data, Mapping) or any(hasattr(source, name) for name in _TABLE_ATTRIBUTES)):
        raise TypeError(f"data are a {type(source).__name__}; calibrate takes {ACCEPTED}")
    return dict(table_from_frame(source, ReadRequest(), "data").columns)


def _recording_columns(recording: Recording) -> dict[str, NDArray[Any]]:
    columns: dict[str, NDArray[Any]] = {_TIME: recording.time}
    columns |= {name: recording.data[..., k] for k, name in enumerate(recording.channels)}
    if recording.labels is not None:
        columns[recording.label_name or _LABEL] = recording.labels
    if recording.temperature is not None:
        columns[_TEMPERATURE] = recording.temperature
    return columns | dict(recording.readback)


def recording_keys(recording: Recording) -> dict[str, object]:
    """Return the keys of [data] by which a recording's own columns are read."""
    keys: dict[str, object] = {_TIME: _TIME}
    for key, letter in (("accelerometer", "a"), ("gyro", "g")):
        if axes := [name for name in recording.channels if name.startswith(letter)]:
            keys[key] = axes
    if recording.labels is not None:
        keys |= {"label": recording.label_name or _LABEL, "marks": "labels"}
    if recording.temperature is not None:
        keys |= {"temperature": _TEMPERATURE, "temperature_unit": "K"}
    return keys
