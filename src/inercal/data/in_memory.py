"""Data in memory as a table of columns: arrays, DataFrames, Arrow tables, recordings."""

from collections.abc import Iterable, Mapping
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from inercal.recording import Recording

ACCEPTED = (
    "the path of a run file or of a recording, a Recording, a DataFrame (pandas, polars), an Arrow "
    "table, a mapping of names to arrays, or an array (samples, columns)"
)
_TIME, _LABEL, _TEMPERATURE = "time", "label", "temperature"


def columns_in_memory(data: object) -> dict[str, NDArray[Any]]:
    """Return the columns by name; those of an array without names are "1", "2", ….

    Dates become seconds after the first one.

    Raises
    ------
    TypeError
        Not a table; the message says what is accepted.
    """
    if isinstance(data, Recording):
        return _recording_columns(data)
    if isinstance(data, np.ndarray):
        array = cast(NDArray[Any], data)
        if array.ndim == 2:
            return {str(k + 1): array[:, k] for k in range(array.shape[1])}
        raise TypeError(f"data are an array of shape {array.shape}; calibrate takes {ACCEPTED}")
    source: Any = data
    if isinstance(data, Mapping):
        names: Iterable[Any] = cast(Mapping[Any, Any], data)
    elif hasattr(data, "column_names"):  # an Arrow table, whose `columns` are without names
        names = source.column_names
    elif hasattr(data, "columns") and hasattr(data, "__getitem__"):
        names = source.columns
    else:
        raise TypeError(f"data are a {type(data).__name__}; calibrate takes {ACCEPTED}")
    return {str(name): _column(np.asarray(source[name])) for name in names}


def _column(values: NDArray[Any]) -> NDArray[Any]:
    if values.dtype.kind == "M" and values.size:
        return (values - values[0]) / np.timedelta64(1, "s")
    if values.dtype.kind == "O":
        return values.astype(np.str_)  # what is no text is refused by the reader, with its column
    return values


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
