"""`inercal repeat`: several calibrations of one sensor, its mean and its next use."""

from pathlib import Path
from typing import Literal

import typer

from inercal.cli.console import print_json
from inercal.cli.session_inputs import Same
from inercal.cli.session_options import REGISTER, SAME, SENSOR, TABLE

NAME = "repeat"


def run(
    files: list[Path] | None = typer.Argument(
        None, help="Calibration files of one sensor, in the order of time.", metavar="FILE…"
    ),
    table: Path | None = TABLE,
    sensor: str | None = SENSOR,
    register: str | None = REGISTER,
    same: list[Same] | None = SAME,
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
    from inercal.basics.atomic_files import write_text
    from inercal.basics.documents import document_text
    from inercal.calibration.files import save
    from inercal.cli.outputs import CALIBRATION, REPEATABILITY, check_outputs
    from inercal.cli.repeat_view import print_repeatability
    from inercal.cli.session_inputs import read_sessions
    from inercal.laboratory.repeatability import repeat
    from inercal.laboratory.repeatability.files import next_use_calibration, repeatability_object

    given, inputs = read_sessions(files, table, sensor, register, same)
    sessions = [one.session for one in given]
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
        write_text(targets[0], document_text(repeatability_object(found)))
        save(next_use_calibration(found), targets[1])
    if json:
        print_json(repeatability_object(found))
        return
    print_repeatability(found)
    for path in targets:
        print(f"wrote {path}")
