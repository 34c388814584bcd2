"""A station of a line: each recording that arrives in a folder is calibrated at once."""

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from inercal.calibration.files import parse
from inercal.calibration.specification import conformity_lines
from inercal.errors import InputError
from inercal.fleet import results
from inercal.fleet.batch import Work, result_row
from inercal.fleet.line import BARCODE, ID, Line, SensorRow
from inercal.fleet.recordings import Version, version_of

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


def arriving_files(
    folder: Path,
    poll: Callable[[], bool],
    known: Mapping[str, Version] | None = None,
    suffixes: Collection[str] = (),
) -> Iterator[Path]:
    """Yield each file of a folder once it is complete: of equal size and time at two polls.

    Files that are there at the first poll arrive, too, but for those that are known.

    Parameters
    ----------
    folder : Path
    poll : callable
        Waits for the next poll; false ends it.
    known : mapping of str to Version, optional
        By path: files that do not arrive again unless they change.
    suffixes : collection of str
        Of recordings; none for any file.
    """
    before: dict[Path, Version] = {}
    taken: dict[str, Version] = dict(known or {})
    while True:
        now = {
            path: version_of(folder, path.name)
            for path in sorted(folder.iterdir())
            if path.is_file()
            and not path.name.startswith(_HIDDEN)
            and (not suffixes or path.suffix in suffixes)
        }
        for path, version in now.items():
            place = str(path.resolve())
            if version.size and before.get(path) == version and taken.get(place) != version:
                taken[place] = version
                yield path
        before = now
        if not poll():
            return


def calibrate_arrival(line: Line, path: Path, out: Path) -> StationResult:
    """Calibrate a recording that arrived, and keep its row.

    Its sensor is the row whose column `barcode` or whose id is the file's name without suffix, or
    whose recording it is. A recording of no row is not calibrated: nothing tells its lot or bench.

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
    row = find_row(line, path)
    if row is None:
        named = f"{BARCODE} or {ID}" if BARCODE in line.columns else ID
        return StationResult(path.stem, False, f"no row of the table has this {named}")
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


def find_row(line: Line, path: Path) -> SensorRow | None:
    """Return the row of a recording that arrived, with its path; None for one of no row."""
    place = path.resolve()
    for row in line.rows:
        if (line.folder / row.recording).resolve() == place:
            return row
    for row in line.rows:
        if path.stem in (row.id, row.columns.get(BARCODE)):
            return SensorRow(row.id, str(place), row.columns)
    return None


def known_versions(line: Line, out: Path) -> dict[str, Version]:
    """Return the versions of the recordings that have a result, by their path."""
    columns = ("recording", "size", "mark")
    return {
        str((line.folder / row["recording"]).resolve()): Version(row["size"], row["mark"])
        for row in results.read_results(out, columns).to_pylist()
    }
