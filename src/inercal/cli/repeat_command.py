"""`inercal repeat`: find a sensor's mean and next-use uncertainty from repeated calibrations."""

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import typer

from inercal.basics.atomic_files import write_text
from inercal.basics.units import format_count, format_number, format_value_and_uncertainty
from inercal.cli import console
from inercal.cli.options import Force, Json, RegisterOption, out_option
from inercal.cli.outputs import CALIBRATION, REPEATABILITY, checked_targets
from inercal.cli.session_inputs import SameOption, Sensor, Sessions, read_sessions

if TYPE_CHECKING:
    from inercal.laboratory.repeatability import Repeatability


def run(
    files: list[Path] | None = typer.Argument(
        None, help="Calibration files of one sensor.", metavar="FILE…"
    ),
    table: Sessions = None,
    sensor: Sensor = None,
    register: RegisterOption = None,
    same: SameOption = None,
    scope: Literal["day", "turn-on"] = typer.Option(
        "day", "--next", help="What changes before the next use."
    ),
    mount: Literal["sensor", "bench"] = typer.Option(
        "bench",
        help="Whether U of the next use includes the rotation of a new mounting (sensor), or "
        "the person who mounts the sensor accounts for it (bench).",
    ),
    out: Path | None = out_option("Folder for the result and the calibration for the next use."),
    force: Force = False,
    json: Json = False,
) -> None:
    """Find a sensor's mean over several calibrations, and the uncertainty for its next use."""
    from inercal.basics.documents import document_text
    from inercal.calibration.files import save
    from inercal.laboratory.repeatability import next_use_calibration, repeat, repeatability_object

    given, inputs = read_sessions(files, table, sensor, register, same)
    sessions = [one.session for one in given]
    stem = sessions[-1].calibration.sensor.name.replace("/", "_")
    kinds = {
        f"{stem}.repeatability.json": REPEATABILITY,
        f"{stem}.next_use.calibration.json": CALIBRATION,
    }
    targets = checked_targets(out, kinds, inputs, force=force)
    found = repeat(sessions, scope=scope, mount_owner=mount)
    if targets:
        write_text(targets[0], document_text(repeatability_object(found)))
        save(next_use_calibration(found), targets[1])
    if json:
        console.print_json(repeatability_object(found))
        return
    _print_repeatability(found)
    console.print_written_files(targets)


def _print_repeatability(found: "Repeatability") -> None:
    """Print the mean and next-use uncertainty of each coefficient, the scatter and the findings."""
    from inercal.laboratory.repeatability.repeated_sessions import advice_lines

    matched = found.matched
    count = len(matched.sessions)
    days, mounts, turn_ons = (int(matched.level(which).max()) + 1 for which in range(3))
    console.print_line(
        f"{matched.sensor.name}: {format_count(count, 'session')} of {format_count(days, 'day')}"
        f", {format_count(mounts, 'mounting')}, {format_count(turn_ons, 'turn-on')}; U with 95 "
        f"% coverage; the next use is after another {found.scope}"
    )
    rows: list[tuple[str, ...]] = []
    for k, name in enumerate(found.names):
        term = matched.sensor.coefficient(name)
        mean, next_use = (
            format_value_and_uncertainty(
                float(found.values[k]) / term.si, float(one.expanded[k]) / term.si
            )
            for one in (found.mean, found.next_use)
        )
        rows.append((name, *mean, next_use[1], term.unit))
    heads = ("coefficient", ">mean", ">U of the mean", ">U of the next use", "unit")
    console.print_table(heads, rows, section=console.axis_of)
    console.print_table(
        ("scatter", "with each", ">standard deviation", ">from", ">to", "unit", "in the next use"),
        [
            (one.effect.name, one.effect.level,
             *(format_number(x / one.effect.si, 3) for x in (one.sd, one.low, one.high)),
             one.effect.unit, "yes" if one.effect.is_in_next_use(found.scope) else "no")
            for one in found.components
        ],
    )  # fmt: skip
    console.print_lines((*found.findings, *advice_lines(found)), "· ")
