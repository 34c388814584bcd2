"""Calibrate each recording at a station of a line as soon as it arrives in a folder."""

from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

from inercal.basics.errors import InputError
from inercal.basics.parallel import SerialExecutor, TimeExceeded, TolerantExecutor, WorkerLost
from inercal.calibration.files import parse
from inercal.fleet import results
from inercal.fleet.batch import Work, failed_row, result_row
from inercal.fleet.inputs import COMPARED, Version, is_address, sensor_inputs, version_of
from inercal.fleet.line import BARCODE, ID, Line, SensorRow
from inercal.fleet.time_limit import TimeLimit
from inercal.recordings.io.column_table import file_sha256

_HIDDEN = (".", "~")


@dataclass(frozen=True)
class StationResult:
    """The result for a recording at a station.

    Parameters
    ----------
    id : str
        Id of the sensor.
    passed : bool
        Whether the result is reliable and passes every limit in [specification]. A conditional pass
        is not enough.
    reason : str
        The verdict in one word and the limit that was missed by most, or the reason why there is no
        result.
    """

    id: str
    passed: bool
    reason: str


class KnownFile(NamedTuple):
    """A file that has arrived, with its version and the SHA-256 hash of its content."""

    version: Version
    sha256: str


def arriving_files(
    folder: Path,
    poll: Callable[[], bool],
    known: Mapping[str, KnownFile] | None = None,
    suffixes: Collection[str] = (),
    say: Callable[[str], None] = print,
) -> Iterator[Path]:
    """Yield each new file in a folder when it is complete (same size and time at two polls).

    Files that already exist at the first poll are also yielded, except known files. Files may
    disappear. If the folder disappears, the function waits until it is back.

    Parameters
    ----------
    folder : Path
    poll : callable
        Function that waits for the next poll, and returns false to stop.
    known : mapping of str to KnownFile, optional
        Known files by path. A known file is only yielded again if its content changes.
    suffixes : collection of str
        Suffixes of recordings; empty to accept any file.
    say : callable
        Function called with a message when the folder disappears and when it is back.
    """
    before: dict[Path, Version] = {}
    taken: dict[str, KnownFile] = dict(known or {})
    away = False
    while True:
        now = _present_files(folder, suffixes)
        if (now is None) != away:
            away = now is None
            say(
                f"{folder} cannot be read; waiting for it"
                if away
                else (f"{folder} can be read again")
            )
        now = now or {}
        for path, version in now.items():
            if not version.size or before.get(path) != version:
                continue
            place = str(path.resolve())
            last = taken.get(place)
            if last is not None and last.version == version:
                continue
            try:
                taken[place] = KnownFile(version, file_sha256(path))
            except OSError:
                continue  # the file has vanished
            if last is None or last.sha256 != taken[place].sha256:
                yield path
        before = now
        if not poll():
            return


def _present_files(folder: Path, suffixes: Collection[str]) -> dict[Path, Version] | None:
    """Return the versions of the recordings in a folder, or None if it cannot be read."""
    found: dict[Path, Version] = {}
    try:
        for path in sorted(folder.iterdir()):
            if path.name.startswith(_HIDDEN) or (suffixes and path.suffix not in suffixes):
                continue
            with suppress(InputError):  # the file has disappeared
                if path.is_file():
                    found[path] = version_of(folder, path.name)
    except OSError:
        return None
    return found


def calibrate_arrival(
    line: Line,
    path: Path,
    out: Path,
    executor: TolerantExecutor | None = None,
    limit: TimeLimit | None = None,
) -> StationResult:
    """Calibrate a recording that arrived, and store its row.

    To find the sensor, the file name without suffix is looked up in the columns `barcode` and `id`,
    and then the path among the recordings in the table. A recording without a row is not
    calibrated, because its lot and bench are unknown.

    Parameters
    ----------
    line : Line
    path : Path
    out : Path
        Folder for the results.
    executor : TolerantExecutor, optional
        Executor for the calibration; by default, the calibration runs in this process.
    limit : TimeLimit, optional
        Time limit for recordings at the station.

    Raises
    ------
    InputError
        The result cannot be written.
    """
    row = find_row(line, path)
    if row is None:
        named = f"{BARCODE} or {ID}" if BARCODE in line.columns else ID
        return StationResult(path.stem, False, f"no row of the table has this {named}")
    try:
        version = version_of(line.folder, row.recording)
    except InputError as error:
        return StationResult(row.id, False, str(error))
    line = replace(line)  # a copy without stored hashes: files named by the line may have changed
    work = Work(row, line.digest(row), version, arrived=True)
    found = _result_within(limit or TimeLimit(), executor or SerialExecutor(), line, work)
    results.open_writer(out).write([found])
    if found["status"] != results.DONE:
        return StationResult(row.id, False, found["error"])
    reason = found["verdict"].partition("\n")[0]
    limits = parse(found["calibration"], str(path)).conformity_lines
    if limits:
        reason = f"{limits[min(1, len(limits) - 1)]}; {reason}"
    accepted = found["conformity"] in (None, "pass")
    return StationResult(row.id, accepted and found["grade"] != "unreliable", reason)


def _result_within(
    limit: TimeLimit, executor: TolerantExecutor, line: Line, work: Work
) -> dict[str, Any]:
    """Return the row for a sensor; its status is "lost" if the process dies or takes too long."""
    size = work.version.size
    executor.limit = lambda _index, _step: limit.seconds(size)
    executor.submit(result_row, replace(line, rows=()), work)
    begin = perf_counter()
    (settled,) = executor.settled()
    if settled.error is None:
        limit.note([size], [perf_counter() - begin])
        return settled.result
    error = settled.error
    if not isinstance(error, WorkerLost):
        raise error
    reason = limit.reason(error.limit) if isinstance(error, TimeExceeded) else str(error)
    return failed_row(line.folder, work, reason, type(error).__name__, status=results.LOST)


def find_row(line: Line, path: Path) -> SensorRow | None:
    """Return the row of an arrived recording with its path; None if the table has no such row."""
    place = path.resolve()
    for row in line.rows:
        if (line.folder / row.recording).resolve() == place:
            return row
    for row in line.rows:
        if path.stem in (row.id, row.columns.get(BARCODE)):
            return SensorRow(row.id, str(place), row.columns)
    return None


def known_files(line: Line, out: Path) -> dict[str, KnownFile]:
    """Return, by path, the recordings with a result for their current content and run file."""
    by_id = {row.id: row for row in line.rows}
    known: dict[str, KnownFile] = {}
    for part in results.part_paths(out):
        for result in results.read_part(part, ("id", *COMPARED)).to_pylist():
            row = by_id.get(result["id"])
            if row is None or is_address(result["recording"]):
                continue
            inputs = sensor_inputs(line, replace(row, recording=result["recording"]))
            if isinstance(inputs.found, Version) and not inputs.difference(result):
                place = str((line.folder / result["recording"]).resolve())
                known[place] = KnownFile(inputs.found, result["recording_sha256"])
    return known
