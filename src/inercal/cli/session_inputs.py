"""Read the sessions for a verb from calibration files, a table of files, or a register."""

from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from inercal.basics.errors import InputError
from inercal.cli.console import open_register

if TYPE_CHECKING:
    from inercal.calibration import Calibration
    from inercal.laboratory.repeatability import RepeatedSession

_FILE, _LEVELS = "file", ("day", "mount", "turn_on")  # columns of a table of sessions


class Same(StrEnum):
    """Conditions that all sessions may have in common."""

    DAY = "day"
    MOUNT = "mount"
    TURN_ON = "turn-on"


Sessions = Annotated[
    Path | None,
    typer.Option(
        "--table",
        "-t",
        help="CSV of sessions with columns file, day, mount, turn_on; replaces the files.",
    ),
]
Sensor = Annotated[str | None, typer.Option(help="A sensor in the register; replaces the files.")]
SameOption = Annotated[
    list[Same] | None,
    typer.Option(
        "--same",
        help="Condition common to all files; by default each has its own day, mount and turn-on.",
    ),
]


class DatedSession(NamedTuple):
    """A session and its time of measurement in ISO 8601, which is empty if unknown."""

    session: "RepeatedSession"
    measured: str


def read_sessions(
    files: list[Path] | None,
    table: Path | None,
    sensor: str | None,
    register: str | None,
    same: list[Same] | None,
) -> tuple[list[DatedSession], list[Path]]:
    """Return the sessions, and the files that were read.

    If all sessions have a time of measurement, they are sorted by it.

    Raises
    ------
    InputError
        The sessions are given in no way or in several ways, or cannot be read.
    """
    require_single_source(files, table, sensor)
    if register is not None and sensor is None:
        raise InputError("--register: name the sensor with --sensor", key="--register")
    if table is not None:
        found, inputs = _of_table(table, same)
    elif sensor is not None:
        found, inputs = _of_register(register, sensor, same), []
    else:
        found, inputs = _of_files(files or [], same), files or []
    if all(one.measured for one in found):
        found.sort(key=lambda one: one.measured)
    return found, inputs


def require_single_source(*ways: object) -> None:
    """Raise an error unless the sessions are given in exactly one way.

    Raises
    ------
    InputError
    """
    if sum(map(bool, ways)) != 1:
        further = " or --bench" if len(ways) > 3 else ""
        raise InputError(
            f"give the sessions in only one way: as files, by --table or by --sensor{further}"
        )


def measured_time(calibration: "Calibration") -> str:
    """Return the time of measurement from [job], or else the time of calibration, in UTC."""
    text = calibration.job.get("measured") or calibration.provenance.get("created", "")
    try:
        time = datetime.fromisoformat(text)
    except ValueError:
        return ""
    return time.astimezone(UTC).isoformat() if time.tzinfo else text


def _labels(same: list[Same] | None, number: int, label: str) -> tuple[str, str, str]:
    """Return the default day, mount and turn-on for a session that states none."""
    day, mount, turn_on = ("same" if one in (same or []) else f"{number} {label}" for one in Same)
    return day, mount, turn_on


def _of_files(files: list[Path], same: list[Same] | None) -> list[DatedSession]:
    from inercal.calibration.files import load
    from inercal.laboratory.repeatability import RepeatedSession

    sessions: list[DatedSession] = []
    for k, file in enumerate(files):
        found = load(file)
        day, *others = _labels(same, k, str(file))
        one = RepeatedSession(str(file), found, _stated_day(found, day, same), *others)
        sessions.append(DatedSession(one, measured_time(found)))
    return sessions


def _of_register(address: str | None, sensor: str, same: list[Same] | None) -> list[DatedSession]:
    from inercal.laboratory.repeatability import RepeatedSession

    with open_register(address, create=False) as opened:
        entries = opened.history(sensor).entries
    sessions: list[DatedSession] = []
    for k, entry in enumerate(entries):
        day, mount, turn_on = _labels(same, k, f"#{entry.id}")
        if Same.DAY not in (same or []):
            day = entry.measured[:10]  # length of a day in ISO 8601
        one = RepeatedSession(f"#{entry.id}", entry.calibration, day, mount, turn_on)
        sessions.append(DatedSession(one, entry.measured))
    return sessions


def _of_table(table: Path, same: list[Same] | None) -> tuple[list[DatedSession], list[Path]]:
    """Return the sessions listed in a table, and the files that were read."""
    from inercal.basics.small_files import csv_lines
    from inercal.calibration.files import load
    from inercal.laboratory.repeatability import RepeatedSession

    sessions: list[DatedSession] = []
    files: list[Path] = []
    for k, (where, cells) in enumerate(csv_lines(table, (_FILE,), "table of sessions")):
        if unknown := sorted(cells.keys() - {_FILE, *_LEVELS}):
            raise InputError(
                f"column {unknown[0]!r} is unknown; the columns are {_FILE}, {', '.join(_LEVELS)}",
                names=(unknown[0],),
            ).located(table)
        if empty := [name for name, cell in cells.items() if not cell.strip()]:
            raise InputError(f"{table}: {where}: column {empty[0]} is empty", file=table)
        file = table.parent / cells[_FILE]
        found = load(file)
        day, *others = _labels(same, k, cells[_FILE])
        default = (_stated_day(found, day, same), *others)
        words = zip(_LEVELS, default, strict=True)
        own = (cells.get(name, word).strip().casefold() for name, word in words)
        session = RepeatedSession(cells[_FILE], found, *own)
        sessions.append(DatedSession(session, _day_of(session.day) or measured_time(found)))
        files.append(file)
    return sessions, [table, *files]


def _stated_day(calibration: "Calibration", default: str, same: list[Same] | None) -> str:
    """Return the day that [job] measured states, unless all sessions are said to be of one day."""
    stated = "" if Same.DAY in (same or []) else calibration.job.get("measured", "")
    return str(stated)[:10] or default


def _day_of(word: str) -> str:
    """Return a table's day in ISO 8601, or an empty text if it is another word."""
    try:
        return datetime.fromisoformat(word).date().isoformat()
    except ValueError:
        return ""
