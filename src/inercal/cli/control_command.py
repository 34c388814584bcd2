"""`inercal control`: control charts for a check standard or a bench."""

from collections.abc import Sequence
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer

from inercal.basics.atomic_files import write_text
from inercal.basics.errors import InputError
from inercal.cli import session_inputs
from inercal.cli.console import open_register, print_json, print_written_files
from inercal.cli.options import Force, Json, RegisterOption, optional, out_option
from inercal.cli.outputs import CONTROL, PAGE, checked_targets

if TYPE_CHECKING:
    from inercal.laboratory.check_standard import ControlCharts
    from inercal.laboratory.check_standard.bench_charts import BenchCharts
    from inercal.laboratory.store import CalibrationEntry


def run(
    files: list[Path] | None = typer.Argument(
        None, help="Calibration files of the check standard.", metavar="FILE…"
    ),
    table: session_inputs.Sessions = None,
    sensor: session_inputs.Sensor = None,
    bench: str | None = optional(
        "A bench in the register, by name or kind: chart its parameters from its own runs."
    ),
    register: RegisterOption = None,
    same: session_inputs.SameOption = None,
    reference: int = typer.Option(20, help="Number of days in the reference."),
    run_length: float = typer.Option(
        370.0, help="Mean number of days between false alarms, over all charts."
    ),
    restart: list[str] | None = optional(
        "Day of a repair, such as 2026-03-01: EWMA and MEWMA restart after it."
    ),
    since: str | None = optional("First day of a new reference; earlier sessions are ignored."),
    lasting: Literal["EWMA", "CUSUM"] = typer.Option(
        "EWMA", help="Type of chart for small lasting changes of a single value."
    ),
    out: Path | None = out_option("Folder for the result and the page with the charts."),
    force: Force = False,
    json: Json = False,
) -> None:
    """Show on control charts whether a bench is in control, and since when it is not."""
    days = [_day(one, "--restart") for one in restart or []]
    begin = "" if since is None else _day(since, "--since")
    options: dict[str, Any] = {
        "reference": reference,
        "run_length": run_length,
        "restarts": days,
        "lasting": lasting,
    }
    from inercal.basics.documents import document_text
    from inercal.cli.control_view import doubtful_object, print_charts, print_doubtful
    from inercal.laboratory.check_standard import chart_texts

    if bench is not None:
        session_inputs.require_single_source(files, table, sensor, bench)
        if same:
            raise InputError(
                "--same: bench runs are always charted by day; remove it", key="--same"
            )
        found, doubtful, inputs = _chart_bench(bench, register, begin, options)
        content = chart_texts.bench_charts_object(found)
        stem = f"{bench.replace('/', '_').replace(' ', '_')}.bench_control"
    else:
        given, inputs = session_inputs.read_sessions(files, table, sensor, register, same)
        found = _chart_sessions(given, begin, options)
        doubtful = None if sensor is None else _doubtful_calibrations(register, sensor, found)
        content = chart_texts.control_charts_object(found)
        stem = f"{found.matched.sensor.name.replace('/', '_')}.control"
    kinds = {f"{stem}.json": CONTROL, f"{stem}.html": PAGE}
    targets = checked_targets(out, kinds, inputs, force=force)
    if targets:
        from inercal.report import report_packages

        write_text(targets[0], document_text(content))
        with report_packages():
            from inercal.report.control_page import charts_page
        write_text(targets[1], charts_page(found, doubtful))
    if json:
        print_json(content | doubtful_object(doubtful))
        return
    print_charts(found)
    print_doubtful(doubtful)
    print_written_files(targets)


def _chart_sessions(
    given: Sequence[session_inputs.DatedSession], begin: str, options: dict[str, Any]
) -> "ControlCharts":
    """Chart the sessions of a check standard from a day on."""
    from inercal.laboratory.check_standard import CheckedSession, control_charts

    undated = [one.session.label for one in given if not one.measured]
    if undated:
        raise InputError(
            f"{undated[0]}: the date of measurement is missing; give the days with --table, or "
            "enter the file into the register"
        )
    charted = [CheckedSession(*one) for one in given if one.measured >= begin]
    if not charted:
        raise InputError(f"--since {begin}: no session since then", key="--since")
    if late := [one for one in options["restarts"] if one > charted[-1].measured]:
        raise InputError(f"--restart {late[0]}: no session since then", key="--restart")
    return control_charts(charted, **options)


def _chart_bench(
    bench: str, register: str | None, begin: str, options: dict[str, Any]
) -> "tuple[BenchCharts, list[CalibrationEntry], list[Path]]":
    """Chart the parameters of a bench in the register, as estimated by its own runs.

    Returns
    -------
    BenchCharts
    list of CalibrationEntry
        Calibrations from days on which the bench was doubtful.
    list of Path
        Files of the register.
    """
    from inercal.laboratory.check_standard.bench_charts import ChartedRun, bench_charts
    from inercal.laboratory.store.uses import calibrations_of_bench

    with open_register(register, create=False) as opened:
        inputs = list(opened.files)
        entries = calibrations_of_bench(opened.calibrations(), bench)
    entries = [one for one in entries if one.measured >= begin]
    if not entries:
        raise InputError(
            f"--since {begin}: no calibration on bench {bench} since then", key="--since"
        )
    runs = [
        ChartedRun(f"#{one.id}", one.measured, one.calibration.bench_estimates or ())
        for one in entries
    ]
    found = bench_charts(bench, runs, **options)
    doubtful = [one for one in entries if any(e.holds(one.measured) for e in found.episodes)]
    return found, doubtful, inputs


def _day(text: str, option: str) -> str:

    try:
        return date.fromisoformat(text).isoformat()
    except ValueError:
        raise InputError(
            f"{option} {text!r}: write a day in ISO 8601, such as 2026-03-01", key=option
        ) from None


def _doubtful_calibrations(
    register: str | None, sensor: str, found: "ControlCharts"
) -> "list[CalibrationEntry]":
    """Return the calibrations that were made while the check standard's benches were doubtful."""
    with open_register(register, create=False) as opened:
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
