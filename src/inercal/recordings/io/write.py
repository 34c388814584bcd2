"""Write a recording to a file that `inercal.recordings.io.read` reads back bit for bit.

A simulated recording is always marked in the file (`inercal.recordings.io.simulation_mark`).
"""

import csv
import os
import zipfile
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from inercal.basics.atomic_files import atomic_write
from inercal.basics.errors import InputError
from inercal.basics.visible_text import visible_text
from inercal.recordings import Recording
from inercal.recordings.io.column_table import Column
from inercal.recordings.io.parquet import write_parquet
from inercal.recordings.io.read import Columns
from inercal.recordings.temperature import temperature_readout

_CHUNK = 10_000  # rows of CSV that are formatted at a time


def write_recording(recording: Recording, path: str | os.PathLike[str]) -> Columns:
    """Write a recording to .csv, .npz or .parquet, completely or not at all.

    Times are in s, readings in output units, temperature in K, and readback in SI. A CSV file
    contains each number with the fewest digits from which it can be read exactly.

    Returns
    -------
    Columns
        The columns that `read_recording` needs to read the file. Readback has the unit "1", because
        it is in SI.

    Raises
    ------
    InputError
        The suffix is unknown, there is a trial axis, two columns have the same name, or the path
        cannot be written.
    """
    columns = Columns(
        channels=tuple((c, c, u) for c, u in zip(recording.channels, recording.units, strict=True)),
        time=recording.time_name,
        label=None if recording.labels is None else recording.label_name,
        temperature=None if recording.temperature is None else "temperature",
        thermometer=temperature_readout("K", allowed=True),
        readback=tuple((name, name, "1") for name in recording.readback),
    )
    write_recordings({Path(path): recording})
    return columns


def write_recordings(recordings: Mapping[Path, Recording]) -> None:
    """Write recordings by path as `write_recording` does, all of them or none.

    Raises
    ------
    InputError
        As in `write_recording`.
    """
    for path in recordings:
        if path.suffix.lower() not in _WRITERS:
            raise InputError(
                f"{path} cannot be written: the suffix must be {' or '.join(_WRITERS)}", file=path
            )
    with ExitStack() as renamed:
        for path, recording in recordings.items():
            arrays = _arrays(recording)
            temporary = renamed.enter_context(atomic_write(path))
            mark = visible_text(recording.simulation)
            _WRITERS[path.suffix.lower()](temporary, arrays, mark)


def _arrays(recording: Recording) -> dict[str, Column]:
    """Return the columns to write by name, in their order."""
    if recording.data.ndim != 2:
        raise InputError(
            "a file can only contain a single run, whose data have the shape (n, m), but these "
            f"data have the shape {recording.data.shape}; write each trial to a separate file"
        )
    pairs: list[tuple[str, Column]] = [(recording.time_name, recording.stamps)]
    pairs += [(name, recording.data[:, k]) for k, name in enumerate(recording.channels)]
    if recording.labels is not None:
        pairs.append((recording.label_name, recording.labels))
    if recording.temperature is not None:
        pairs.append(("temperature", recording.temperature))
    pairs += recording.readback.items()
    names = [name for name, _ in pairs]
    for name in names:
        if names.count(name) > 1:
            raise InputError(
                f"two columns would have the name {name!r}; rename the channel or readback",
                names=(name,),
            )
    return dict(pairs)


def _write_csv(path: Path, columns: dict[str, Column], mark: str) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        if mark:
            file.write(f"# {mark}\n")
        csv.writer(file, lineterminator="\n").writerow(columns)
        # Labels are quoted so that a comma or # inside a label belongs to it.
        rows = csv.writer(file, lineterminator="\n", quoting=csv.QUOTE_NONNUMERIC)
        n = next(iter(columns.values())).size
        for k in range(0, n, _CHUNK):
            chunk = [column[k : k + _CHUNK].tolist() for column in columns.values()]
            rows.writerows(zip(*chunk, strict=True))


def _write_npz(path: Path, columns: dict[str, Column], mark: str) -> None:
    with path.open("wb") as file:  # given a path, NumPy would add its own suffix
        np.savez(file, allow_pickle=False, **columns)
    if mark:
        with zipfile.ZipFile(path, "a") as archive:
            archive.comment = mark.encode()


_WRITERS: dict[str, Callable[[Path, dict[str, Column], str], None]] = {
    ".csv": _write_csv,
    ".npz": _write_npz,
    ".parquet": write_parquet,
}
SUFFIXES = tuple(_WRITERS)
"""The suffixes of files that can be written."""
