"""Sections and data given as arguments of a call, as a run: the same checks as of a run file."""

from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from hashlib import sha256
from json import dumps
from os import PathLike, fspath
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, cast

import numpy as np

from inercal.data.in_memory import columns_in_memory, recording_keys
from inercal.errors import InercalError
from inercal.recording import Recording
from inercal.runfile import Run, from_sections

_CALL = "inercal.calibrate"  # what messages name in place of a run file
_TABLE, _MARKS = "data.npz", "marks.json"


@contextmanager
def stated_run(
    data: object, sections: Mapping[str, object], data_keys: Mapping[str, object]
) -> Generator[Run]:
    """Yield the run of sections that are stated as arguments, with data in memory or in a file.

    Data in memory take the way of a file, so that every check of a file holds for them.

    Parameters
    ----------
    data : object
        As of `inercal.calibrate`.
    sections : mapping of str to mapping
        The sections of a run file but [data], by name; those that are None are not stated. Files
        that they name are relative to the working folder. [method] may be its name alone.
    data_keys : mapping
        Keys of [data] but `file`; `marks` may be a mapping of labels to samples.

    Raises
    ------
    TypeError
        Data of another type.
    InercalError
        The sections or the data cannot be used; also raised from within.
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


def _marks_as_json(marks: Mapping[str, object]) -> str:
    """Return marks as the file of marks has them; samples may be a pair or `start` and `end`."""
    return dumps(
        {
            str(label): dict(zip(("start", "end"), map(int, cast(Any, bounds)), strict=True))
            if isinstance(bounds, tuple | list)
            else bounds
            for label, bounds in marks.items()
        }
    )


def _plain(value: object) -> Any:
    """Return a value as TOML would read it: lists in place of tuples, texts in place of paths."""
    if isinstance(value, Mapping):
        return {str(key): _plain(one) for key, one in cast(Mapping[object, object], value).items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in cast(Sequence[object], value)]
    if isinstance(value, np.generic):
        return cast(object, value.item())
    return fspath(cast("PathLike[str]", value)) if isinstance(value, PathLike) else value
