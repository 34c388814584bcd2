"""Sections and data given as arguments of a call, as a run: the same checks as of a run file."""

from collections.abc import Generator, Mapping
from contextlib import contextmanager
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
    data: object,
    method: str | Mapping[str, object],
    sensor: Mapping[str, object],
    bench: Mapping[str, object] | None,
    data_keys: Mapping[str, object],
) -> Generator[Run]:
    """Yield the run of sections that are stated as arguments, with data in memory or in a file.

    Data in memory take the way of a file, so that every check of a file holds for them.

    Parameters
    ----------
    data : object
        As of `inercal.calibrate`.
    method : str or mapping
        Name of the method, or [method].
    sensor, bench : mapping
        [sensor] and [bench].
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
        if isinstance(data, str | PathLike):
            folder = Path.cwd()
            keys["file"] = fspath(data)
        else:
            if isinstance(data, Recording):
                keys = recording_keys(data) | keys
            columns = columns_in_memory(data)
            np.savez(folder / _TABLE, allow_pickle=False, **columns)
            keys["file"] = _TABLE
        if isinstance(marks := keys.get("marks"), Mapping):
            path = Path(name) / _MARKS
            path.write_text(_marks_as_json(cast(Mapping[str, object], marks)), encoding="utf-8")
            keys["marks"] = str(path)
        sections = {
            "sensor": _plain(sensor),
            "bench": _plain(bench or {}),
            "data": _plain(keys),
            "method": {"name": method} if isinstance(method, str) else _plain(method),
        }
        digest = sha256(dumps(sections, sort_keys=True, default=str).encode()).hexdigest()
        try:
            yield from_sections(folder / _CALL, sections, digest)
        except InercalError as error:
            error.args = tuple(
                part.replace(f"{folder}/", "") if isinstance(part, str) else part
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


def _plain(section: Mapping[str, object]) -> dict[str, Any]:
    """Return a section as TOML would read it: lists in place of tuples."""
    return {
        key: list(value) if isinstance(value, tuple) else value  # pyright: ignore[reportUnknownArgumentType]
        for key, value in section.items()
    }
