"""`inercal control`: the control charts of a check standard."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from inercal.cli.console import print_json
from inercal.cli.session_inputs import Same
from inercal.cli.session_options import REGISTER, SAME, SENSOR, TABLE

if TYPE_CHECKING:
    from inercal.laboratory.check_standard import ControlCharts
    from inercal.laboratory.store import CalibrationEntry

NAME = "control"


class Lasting(StrEnum):
    """Charts of small lasting changes."""

    EWMA = "EWMA"
    CUSUM = "CUSUM"


def run(
    files: list[Path] | None = typer.Argument(
        None,
        help="Calibration files of the check standard, in the order of time.",
        metavar="FILE…",
    ),
    table: Path | None = TABLE,
    sensor: str | None = SENSOR,
    bench: str | None = typer.Option(
        None,
        "--bench",
        help="A bench of the register, by its name or kind: chart what its own runs show of it.",
    ),
    register: str | None = REGISTER,
    same: list[Same] | None = SAME,
    reference: int = typer.Option(20, "--reference", help="How many days are the reference."),
    run_length: float = typer.Option(
        370.0, "--run-length", help="Days between false signals of all charts together."
    ),
    restart: list[str] | None = typer.Option(
        None,
        "--restart",
        help="Day of a repair, such as 2026-03-01: EWMA and MEWMA begin anew after it.",
    ),
    since: str | None = typer.Option(
        None, "--since", help="First day of a new reference; earlier sessions are left out."
    ),
    lasting: Lasting = typer.Option(
        Lasting.EWMA, "--lasting", help="Chart of small lasting changes of one value."
    ),
    out: Path | None = typer.Option(
        None, "--out", "-o", help="Folder for the result and the page of the charts."
    ),
    force: bool = typer.Option(False, "--force", help="Write over existing files."),
    json: bool = typer.Option(False, "--json", help="Print one JSON object instead of tables."),
) -> None:
    """Chart a check standard: whether the bench is in control, and since when it is not."""
    days = [_day(one, "--restart") for one in restart or []]
    begin = "" if since is None else _day(since, "--since")
    if bench is not None:
        from inercal.cli.bench_control import ChartOptions, run_bench_charts
        from inercal.cli.session_inputs import require_single_source

        require_single_source(files, table, sensor, bench)
        options = ChartOptions(
            reference, run_length, days, lasting.value, begin, out, force=force, json=json
        )
        run_bench_charts(bench, register, options, same)
        return
    from inercal.basics.atomic_files import write_text
    from inercal.basics.documents import document_text
    from inercal.basics.errors import InputError
    from inercal.cli.control_view import doubtful_object, print_charts, print_doubtful
    from inercal.cli.outputs import CONTROL, PAGE, check_outputs
    from inercal.cli.session_inputs import read_sessions
    from inercal.laboratory.check_standard import CheckedSession, control_charts
    from inercal.laboratory.check_standard.chart_files import control_charts_object

    given, inputs = read_sessions(files, table, sensor, register, same)
    undated = [one.session.label for one in given if not one.measured]
    if undated:
        raise InputError(
            f"{undated[0]}: states no time of measurement; give the days by --table, or enter it "
            "into the register"
        )
    charted = [CheckedSession(*one) for one in given if one.measured >= begin]
    if not charted:
        raise InputError(f"--since {begin}: no session since then", key="--since")
    found = control_charts(
        charted,
        reference=reference,
        run_length=run_length,
        restarts=days,
        lasting=lasting.value,
    )
    doubtful = None if sensor is None else _doubtful_calibrations(register, sensor, found)
    targets: list[Path] = []
    if out is not None:
        stem = found.matched.sensor.name.replace("/", "_")
        targets = [out / f"{stem}.control.json", out / f"{stem}.control.html"]
        kinds = dict(zip(targets, (CONTROL, PAGE), strict=True))
        check_outputs(kinds, inputs, force=force)
        from inercal.report import write_control

        write_text(targets[0], document_text(control_charts_object(found)))
        write_control(found, targets[1], doubtful)
    if json:
        print_json(control_charts_object(found) | doubtful_object(doubtful))
        return
    print_charts(found)
    print_doubtful(doubtful)
    for path in targets:
        print(f"wrote {path}")


def _day(text: str, option: str) -> str:
    from datetime import date

    from inercal.basics.errors import InputError

    try:
        return date.fromisoformat(text).isoformat()
    except ValueError:
        raise InputError(
            f"{option} {text!r}: write a day in ISO 8601, such as 2026-03-01", key=option
        ) from None


def _doubtful_calibrations(
    register: str | None, sensor: str, found: "ControlCharts"
) -> "list[CalibrationEntry]":
    """Return the calibrations on benches of the check standard while these were doubtful."""
    from inercal.laboratory.store import Register

    with Register(register, create=False) as opened:
        entries = opened.calibrations()
        name = opened.sensor(sensor).name
    benches = {(one.kind, one.bench) for one in entries if one.sensor == name}
    return [
        one
        for one in entries
        if one.sensor != name
        and (one.kind, one.bench) in benches
        and any(episode.holds(one.measured) for episode in found.episodes)
    ]
