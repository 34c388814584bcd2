"""Compare a sensor's current inputs with the inputs of its existing result.

The comparison does not use a clock, because two computers may disagree about the time, and a clock
may be set back.

The recordings of a fleet are files in a folder or objects in a store.
"""

from collections.abc import Generator, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import cached_property
from importlib import import_module
from importlib.metadata import version
from itertools import repeat
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from inercal.basics.errors import InputError, require_extra
from inercal.fleet.line import Line, SensorRow
from inercal.recordings.io.column_table import file_sha256


@dataclass(frozen=True)
class Version:
    """Version of a recording, which shows that it changed without the need to read it.

    Parameters
    ----------
    size : int
        Size in bytes.
    mark : str
        Times of the last change to the content and to the attributes, or the store's content tag.
        Marks are only compared for equality. The attribute time is needed because loggers without a
        clock always write the same content time. A copy that keeps the content time has a new
        attribute time.
    """

    size: int
    mark: str


ABSENT = Version(0, "")  # version of a missing recording


def is_address(recording: str) -> bool:
    """Return whether a recording is an object in a store, such as "s3://bucket/name"."""
    return "://" in recording


def version_of(folder: Path, recording: str) -> Version:
    """Return the version of a recording from its size and time.

    Raises
    ------
    InputError
        There is no such recording.
    """
    if is_address(recording):
        store, path = _store(recording)
        try:
            info: dict[str, Any] = store.info(path)
        except (OSError, ValueError) as error:
            raise InputError(f"{recording}: {error}", file=recording) from None
        mark = info.get("ETag") or info.get("LastModified") or info.get("mtime") or ""
        return Version(int(info["size"] or 0), str(mark))
    path = folder / recording
    try:
        found = path.stat()
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}", file=path) from None
    return Version(found.st_size, f"{found.st_mtime_ns} {found.st_ctime_ns}")


@contextmanager
def local_copy(recording: str) -> Generator[Path]:
    """Yield the path of a local copy of an object; the copy is removed afterwards.

    Raises
    ------
    InputError
        The object cannot be read.
    """
    store, path = _store(recording)
    with TemporaryDirectory(prefix="inercal-") as folder:
        copy = Path(folder) / path.rsplit("/", 1)[-1]
        try:
            store.get_file(path, str(copy))
        except OSError as error:
            raise InputError(f"{recording}: {error}", file=recording) from None
        yield copy


def _store(address: str) -> tuple[Any, str]:
    with require_extra("fleet", f"{address} needs fsspec", ("fsspec",)):
        core: Any = import_module("fsspec.core")
    try:
        store, path = core.url_to_fs(address)
    except ImportError:
        scheme = address.split("://")[0]
        extra = {"s3": "s3"}.get(scheme)
        how = (
            f"pip install 'inercal[{extra}]'" if extra else f"install fsspec's driver for {scheme}"
        )
        raise InputError(f"{address}: {how}", file=address) from None
    except ValueError as error:
        raise InputError(f"{address}: {error}", file=address) from None
    return store, path


INSTALLED = version("inercal")
_REQUESTS = 16  # simultaneous requests to a store; each takes about 50 ms, and a sensor needs one


@dataclass(frozen=True)
class SensorInputs:
    """The inputs from which a sensor would be calibrated now.

    Parameters
    ----------
    folder : Path
        Folder of the line.
    row : SensorRow
    digest : str
        Digest of the sensor's run file (`Line.digest`).
    found : Version or InputError
        Version of the recording, or the error if there is no recording.
    """

    folder: Path
    row: SensorRow
    digest: str
    found: Version | InputError

    @cached_property
    def recording_sha256(self) -> str:
        """Return the SHA-256 hash of the recording, or "" if it is in a store or unreadable."""
        if not is_address(self.row.recording):
            with suppress(OSError):
                return file_sha256(self.folder / self.row.recording)
        return ""

    def difference(self, result: Mapping[str, Any]) -> str:
        """Describe why a new calibration might give a different result; empty if it would not.

        Parameters
        ----------
        result : mapping of str to object
            A row of the results with the columns in `COMPARED`.
        """
        if result["sections_sha256"] != self.digest:
            return "the run file or a file that it names has changed since then"
        if result["inercal"] != INSTALLED:
            return f"it was computed by inercal {result['inercal']}"
        stated = Version(result["size"], result["mark"])
        if isinstance(self.found, InputError):
            return "" if stated == ABSENT else "its recording cannot be found"
        if self.found == stated:
            return ""
        # The file was copied or touched, so only its content shows whether it has changed.
        if self.recording_sha256 and self.recording_sha256 == result["recording_sha256"]:
            return ""
        return "its recording has changed since then"


COMPARED = (
    "recording", "recording_sha256", "size", "mark", "sections_sha256", "inercal", "arrived",
)  # fmt: skip


def sensor_inputs(line: Line, row: SensorRow) -> SensorInputs:
    """Return the inputs from which a sensor would be calibrated now."""
    try:
        found = version_of(line.folder, row.recording)
    except InputError as error:
        return SensorInputs(line.folder, row, line.digest(row), error)
    return SensorInputs(line.folder, row, line.digest(row), found)


def line_inputs(line: Line) -> dict[str, SensorInputs]:
    """Return the inputs from which each sensor of a line would be calibrated now, by id."""
    return {one.row.id: one for one in _each(line, line.rows)}


def _each(line: Line, rows: Sequence[SensorRow]) -> Iterator[SensorInputs]:
    if not any(is_address(row.recording) for row in rows):
        yield from (sensor_inputs(line, row) for row in rows)
        return
    with ThreadPoolExecutor(_REQUESTS) as pool:
        yield from pool.map(sensor_inputs, repeat(line), rows)


def result_difference(line: Line, now: SensorInputs, result: Mapping[str, Any]) -> str:
    """Describe why calibrating a sensor now might give a different result, or return "".

    The recording named in the table is used. If it does not exist, a recording that arrived at a
    station is used.

    Parameters
    ----------
    line : Line
    now : SensorInputs
        Current inputs of the sensor according to the table.
    result : mapping of str to object
        A row of the results with the columns in `COMPARED`.
    """
    if result["arrived"] and isinstance(now.found, InputError):
        now = sensor_inputs(line, replace(now.row, recording=result["recording"]))
    return now.difference(result)
