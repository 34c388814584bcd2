"""Compare a sensor's current inputs with the inputs of its existing result.

The comparison does not use a clock, because two computers may disagree about the time, and a clock
may be set back.
"""

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.metadata import version
from itertools import repeat
from pathlib import Path
from typing import Any

from inercal.basics.errors import InputError
from inercal.fleet.line import Line, SensorRow
from inercal.fleet.recordings import ABSENT, Version, is_address, version_of
from inercal.recordings.io.column_table import file_sha256

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
