"""A station of a line: each recording that arrives in a folder is calibrated at once."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from inercal.calibration.files import parse
from inercal.calibration.specification import conformity_lines
from inercal.errors import InputError
from inercal.fleet import results
from inercal.fleet.batch import Work, result_row
from inercal.fleet.line import RECORDING, Line, SensorRow
from inercal.fleet.recordings import Version, version_of

BARCODE = "barcode"
_HIDDEN = (".", "~")


@dataclass(frozen=True)
class StationResult:
    """What a station says of a recording.

    Parameters
    ----------
    id : str
        Of its sensor.
    passed : bool
        A result that is not unreliable, and that passes every limit of [specification]; a
        conditional pass is none.
    reason : str
        The verdict in a word and the worst limit that is not passed, or why there is no result.
    """

    id: str
    passed: bool
    reason: str


def arriving_files(folder: Path, poll: Callable[[], bool]) -> Iterator[Path]:
    """Yield each file of a folder once it is complete: of equal size and time at two polls.

    Files that are there at the first poll arrive, too.

    Parameters
    ----------
    folder : Path
    poll : callable
        Waits for the next poll; false ends it.
    """
    before: dict[Path, Version] = {}
    taken: dict[Path, Version] = {}
    while True:
        now = {
            path: version_of(folder, path.name)
            for path in sorted(folder.iterdir())
            if path.is_file() and not path.name.startswith(_HIDDEN)
        }
        for path, version in now.items():
            if version.size and before.get(path) == version and taken.get(path) != version:
                taken[path] = version
                yield path
        before = now
        if not poll():
            return


def calibrate_arrival(line: Line, path: Path, out: Path) -> StationResult:
    """Calibrate a recording that arrived, and keep its row.

    Its sensor is the one whose column `barcode`, else whose id, is the file's name without suffix,
    or whose recording it is; a sensor that the table lacks has that name as its id.

    Parameters
    ----------
    line : Line
    path : Path
    out : Path
        Folder of the results.

    Raises
    ------
    InputError
        The result cannot be written.
    """
    row = _sensor_row(line, path)
    try:
        version = version_of(line.folder, row.recording)
    except InputError as error:
        return StationResult(row.id, False, str(error))
    found = result_row(line, Work(row, line.digest(row), version))
    results.write_part(out, [found])
    if found["status"] != results.DONE:
        return StationResult(row.id, False, found["error"])
    summary = found["verdict"].partition("\n")[0]
    reason = f"{found['grade']}: {summary}"
    limits = conformity_lines(parse(found["calibration"], str(path)))
    if limits:
        reason = f"{limits[min(1, len(limits) - 1)]}; {reason}"
    accepted = found["conformity"] in (None, "pass")
    return StationResult(row.id, accepted and found["grade"] != "unreliable", reason)


def _sensor_row(line: Line, path: Path) -> SensorRow:
    recording = str(path.resolve())
    for row in line.rows:
        named = row.columns.get(BARCODE) or row.id
        if named == path.stem or (line.folder / row.recording).resolve() == path.resolve():
            return SensorRow(row.id, recording, row.columns)
    missing = sorted(line.placeholders - {"id", RECORDING})
    columns = dict.fromkeys(missing, "")
    return SensorRow(path.stem, recording, columns)
