"""`inercal repeat`: several calibrations of one sensor, its mean and its next use."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import typer

from inercal.cli.console import print_json

if TYPE_CHECKING:
    from inercal.repeatability import RepeatedSession

NAME = "repeat"
_FILE, _LEVELS = "file", ("day", "mount", "turn_on")  # columns of a table of sessions


class Same(StrEnum):
    """What all sessions have in common."""

    DAY = "day"
    MOUNT = "mount"
    TURN_ON = "turn-on"


def run(
    files: list[Path] | None = typer.Argument(
        None, help="Calibration files of one sensor, in the order of time.", metavar="FILE…"
    ),
    table: Path | None = typer.Option(
        None,
        "--table",
        "-t",
        help="CSV of sessions with columns file, day, mount, turn_on; instead of files.",
    ),
    sensor: str | None = typer.Option(
        None, "--sensor", help="A sensor of the register; instead of files."
    ),
    register: str | None = typer.Option(
        None,
        "--register",
        help="A path, sqlite:///PATH or postgresql://USER@HOST/DATABASE; else $INERCAL_REGISTER.",
    ),
    same: list[Same] | None = typer.Option(
        None,
        "--same",
        help="What all files have in common; otherwise each is of another day, mounting and "
        "turn-on.",
    ),
    scope: Literal["day", "turn-on"] = typer.Option(
        "day", "--next", help="What is new in the next use."
    ),
    mount: Literal["sensor", "bench"] = typer.Option(
        "bench",
        "--mount",
        help="Whether U of the next use holds the rotation of a new mounting (sensor), or whoever "
        "mounts answers for it (bench).",
    ),
    out: Path | None = typer.Option(
        None, "--out", "-o", help="Folder for the result and the calibration of the next use."
    ),
    force: bool = typer.Option(False, "--force", help="Write over existing files."),
    json: bool = typer.Option(False, "--json", help="Print one JSON object instead of tables."),
) -> None:
    """State a sensor's mean over several calibrations and the uncertainty of its next use."""
    from inercal.calibration.files import save
    from inercal.cli.outputs import CALIBRATION, REPEATABILITY, check_outputs
    from inercal.cli.repeat_view import print_repeatability
    from inercal.errors import InputError
    from inercal.io.atomic_files import write_text
    from inercal.repeatability import repeat
    from inercal.repeatability.files import as_object, next_use_calibration, to_text

    if sum(map(bool, (files, table, sensor))) != 1:
        raise InputError("give the sessions in one way: files, --table or --sensor")
    if register is not None and sensor is None:
        raise InputError("--register: name the sensor by --sensor", key="--register")
    if table is not None:
        sessions, inputs = _of_table(table, same)
    elif sensor is not None:
        sessions, inputs = _of_register(register, sensor, same), []
    else:
        sessions, inputs = _of_files(files or [], same), files or []
    targets: list[Path] = []
    if out is not None:
        stem = sessions[-1].calibration.sensor.name.replace("/", "_")
        targets = [
            out / f"{stem}.{kind}.json" for kind in ("repeatability", "next_use.calibration")
        ]
        kinds = dict(zip(targets, (REPEATABILITY, CALIBRATION), strict=True))
        check_outputs(kinds, inputs, force=force)
    found = repeat(sessions, scope=scope, mount_owner=mount)
    if targets:
        write_text(targets[0], to_text(found))
        save(next_use_calibration(found), targets[1])
    if json:
        print_json(as_object(found))
        return
    print_repeatability(found)
    for path in targets:
        print(f"wrote {path}")


def _labels(same: list[Same] | None, number: int, label: str) -> tuple[str, str, str]:
    """Return day, mount and turn-on of a session of which nothing else is stated."""
    day, mount, turn_on = ("same" if one in (same or []) else f"{number} {label}" for one in Same)
    return day, mount, turn_on


def _of_files(files: list[Path], same: list[Same] | None) -> list["RepeatedSession"]:
    from inercal.calibration.files import load
    from inercal.repeatability import RepeatedSession

    return [
        RepeatedSession(str(file), load(file), *_labels(same, k, str(file)))
        for k, file in enumerate(files)
    ]


def _of_register(
    address: str | None, sensor: str, same: list[Same] | None
) -> list["RepeatedSession"]:
    from inercal.repeatability import RepeatedSession
    from inercal.store import Register

    with Register(address, create=False) as opened:
        entries = opened.history(sensor).entries
    sessions: list[RepeatedSession] = []
    for k, entry in enumerate(entries):
        day, mount, turn_on = _labels(same, k, f"#{entry.id}")
        if Same.DAY not in (same or []):
            day = entry.measured[:10]  # of ISO 8601
        sessions.append(RepeatedSession(f"#{entry.id}", entry.calibration, day, mount, turn_on))
    return sessions


def _of_table(table: Path, same: list[Same] | None) -> tuple[list["RepeatedSession"], list[Path]]:
    """Return the sessions of a table, and its files."""
    from inercal.calibration.files import load
    from inercal.errors import InputError
    from inercal.repeatability import RepeatedSession
    from inercal.small_files import csv_lines

    sessions: list[RepeatedSession] = []
    files: list[Path] = []
    for k, (where, cells) in enumerate(csv_lines(table, (_FILE,), "table of sessions")):
        if unknown := sorted(cells.keys() - {_FILE, *_LEVELS}):
            raise InputError(
                f"{table}: column {unknown[0]!r} is not known; there are {_FILE}, "
                f"{', '.join(_LEVELS)}",
                file=table,
                names=(unknown[0],),
            )
        if empty := [name for name, cell in cells.items() if not cell.strip()]:
            raise InputError(f"{table}: {where}: column {empty[0]} is empty", file=table)
        file = table.parent / cells[_FILE]
        default = _labels(same, k, cells[_FILE])
        own = (cells.get(name, word) for name, word in zip(_LEVELS, default, strict=True))
        sessions.append(RepeatedSession(cells[_FILE], load(file), *own))
        files.append(file)
    return sessions, [table, *files]
