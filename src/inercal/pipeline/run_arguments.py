"""Build a run from sections and data in arguments, with the same checks as a run file."""

from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from hashlib import sha256
from json import dumps
from os import PathLike, fspath
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from inercal.basics.errors import InercalError
from inercal.recordings import Recording
from inercal.recordings.io.column_table import ReadRequest
from inercal.recordings.io.frames import table_from_frame
from inercal.runfile import Run, from_sections

ACCEPTED = (
    "the path of a run file or of a recording, a Recording, a DataFrame (pandas, polars), an Arrow "
    "table, a mapping of names to arrays, or an array (samples, columns)"
)
_TABLE_ATTRIBUTES = ("columns", "column_names", "schema", "dtype")
_TIME, _LABEL, _TEMPERATURE = "time", "label", "temperature"


def columns_in_memory(data: object) -> dict[str, NDArray[Any]]:
    """Return the columns of data by name; columns without names are named "1", "2", ….

    Raises
    ------
    TypeError
        If the data are not a table. The message lists the accepted types.
    InputError
        If a column does not contain numbers, dates or text.
    """
    if isinstance(data, Recording):
        return _recording_columns(data)
    source = cast(Any, data)
    array = cast(NDArray[Any], data) if isinstance(data, np.ndarray) else None
    if array is not None and array.dtype.names is None:
        if array.ndim == 2:
            return {str(k + 1): array[:, k] for k in range(array.shape[1])}
        raise TypeError(f"data are an array of shape {array.shape}; calibrate accepts {ACCEPTED}")
    if not (isinstance(data, Mapping) or any(hasattr(source, name) for name in _TABLE_ATTRIBUTES)):
        raise TypeError(f"data are a {type(source).__name__}; calibrate accepts {ACCEPTED}")
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
    """Return the keys of [data] that select the columns of a recording."""
    keys: dict[str, object] = {_TIME: _TIME}
    for key, letter in (("accelerometer", "a"), ("gyro", "g")):
        if axes := [name for name in recording.channels if name.startswith(letter)]:
            keys[key] = axes
    if recording.labels is not None:
        keys |= {"label": recording.label_name or _LABEL, "marks": "labels"}
    if recording.temperature is not None:
        keys |= {"temperature": _TEMPERATURE, "temperature_unit": "K"}
    return keys


_CALL = "inercal.calibrate"  # name that messages use instead of a run file
_TABLE, _MARKS = "data.npz", "marks.json"


@contextmanager
def stated_run(
    data: object, sections: Mapping[str, object], data_keys: Mapping[str, object]
) -> Generator[Run]:
    """Yield a run built from sections in arguments, with data in memory or in a file.

    Data in memory are treated like a file, so the same checks apply.

    Parameters
    ----------
    data : object
        See `inercal.calibrate`.
    sections : mapping of str to mapping
        The sections of a run file except [data], by name; None means that a section is not stated.
        Paths of files are relative to the working folder. [method] may be only the name of the
        method.
    data_keys : mapping
        Keys of [data], except `file`; `marks` may be a mapping from labels to samples.

    Raises
    ------
    TypeError
        If the data have an unsupported type.
    InercalError
        If the sections or the data cannot be used. Errors of this type in the block are raised
        again.
    """
    with TemporaryDirectory(prefix="inercal-") as name:
        folder = Path(name)
        keys: dict[str, Any] = dict(data_keys)
        held: dict[str, Path] = {}
        if isinstance(data, str | PathLike):
            keys["file"] = fspath(data)
        else:
            if isinstance(data, Recording):
                keys = recording_keys(data) | keys
            columns = columns_in_memory(data)
            np.savez(folder / _TABLE, allow_pickle=False, **columns)
            keys["file"], held[_TABLE] = _TABLE, folder / _TABLE
        if isinstance(marks := keys.get("marks"), Mapping):
            path = folder / _MARKS
            path.write_text(_marks_as_json(cast(Mapping[str, object], marks)), encoding="utf-8")
            keys["marks"] = str(path)
        if isinstance(method := sections.get("method"), str):
            sections = {**sections, "method": {"name": method}}
        content = {key: _plain(one) for key, one in sections.items() if one is not None}
        content["data"] = _plain(keys)
        digest = sha256(dumps(content, sort_keys=True, default=str).encode()).hexdigest()
        call = Path.cwd() / _CALL
        try:
            yield replace(from_sections(call, content, digest), held_files=held)
        except InercalError as error:
            error.args = tuple(
                part.replace(f"{folder}/", "").replace(str(call), _CALL)
                if isinstance(part, str)
                else part
                for part in error.args
            )
            raise


def drafted_run(log: Path, sections: Mapping[str, object], data_keys: Mapping[str, object]) -> Run:
    """Draft the run for a recording from a file, with the sections that are known.

    Parameters
    ----------
    log : Path
        The file, a folder, or a name with a star.
    sections : mapping of str to mapping
        Values that the data do not contain, by section, such as {"bench": {"latitude": "48.1 °"}}.
    data_keys : mapping
        Keys of [data], such as `rate`.

    Raises
    ------
    InercalError
        If no method can use the recording, or questions are open.
    """
    from inercal.pipeline.drafts import draft_run_file, recording_name, require_answers
    from inercal.pipeline.drafts.draft_entries import as_sections

    stated = dict(_dotted("", {**sections, "data": data_keys}))
    draft = draft_run_file([log], Path.cwd() / f"{recording_name([log])}.toml", stated)
    require_answers(draft)
    digest = sha256(draft.text.encode()).hexdigest()
    return from_sections(draft.path, as_sections(draft.entries), digest)


def _dotted(place: str, content: Mapping[str, object]) -> Iterator[tuple[str, str]]:
    """Yield the keys with their sections, such as "data.rate", and their values as text."""
    for key, value in content.items():
        if isinstance(value, Mapping):
            yield from _dotted(f"{place}{key}.", cast("Mapping[str, object]", value))
        else:
            plain = _plain(value)
            yield f"{place}{key}", plain if isinstance(plain, str) else dumps(plain)


def _marks_as_json(marks: Mapping[str, object]) -> str:
    """Return marks as text for a file; samples may be a pair, or have `start` and `end`."""
    return dumps(
        {
            str(label): dict(zip(("start", "end"), map(int, cast(Any, bounds)), strict=True))
            if isinstance(bounds, tuple | list)
            else bounds
            for label, bounds in marks.items()
        }
    )


def _plain(value: object) -> Any:
    """Convert a value as if a TOML parser had read it: tuples to lists, and paths to text."""
    if isinstance(value, Mapping):
        return {str(key): _plain(one) for key, one in cast(Mapping[object, object], value).items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in cast(Sequence[object], value)]
    if isinstance(value, np.generic):
        return cast(object, value.item())
    return fspath(cast("PathLike[str]", value)) if isinstance(value, PathLike) else value
