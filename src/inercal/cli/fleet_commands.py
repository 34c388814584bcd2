"""`inercal fleet`: calibrate the sensors of a production line in batches, and compare them."""

import sys
from collections.abc import Mapping
from importlib.util import find_spec
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from inercal.basics.atomic_files import write_text
from inercal.basics.errors import InputError
from inercal.basics.units import format_count
from inercal.cli import export_command
from inercal.cli.console import exit_if, open_register, print_json, progress_status, report_line
from inercal.cli.options import (
    Force,
    Json,
    Scheduler,
    Workers,
    assignments,
    flag,
    optional,
    out_option,
    warn_of_root,
)
from inercal.cli.outputs import CALIBRATION, PAGE, OutputKind, check_outputs

if TYPE_CHECKING:
    from inercal.fleet.calibration import Counts
    from inercal.fleet.line import Line

_WORKER_MODULES = """
    fleet.batch calibration.files benches.hand.kind benches.hand.reading methods.six_position
    methods.residuals estimation.fitting pipeline recordings.io.npz
"""
_POLL = 0.5  # s
_REPORT = "report.html"
app = typer.Typer(
    help="Calibrate the sensors of a production line, and compare them.", no_args_is_help=True
)

_Line = Annotated[Path, typer.Argument(help="Folder with run.toml and sensors.csv.")]
_Out = Annotated[
    Path | None,
    typer.Option("--results", help="Folder for the results (default: fleet in the line's folder)."),
]


@app.command()
def calibrate(
    line: _Line,
    workers: Workers = None,
    scheduler: Scheduler = None,
    batch: int | None = optional("Number of sensors in a batch (default: as many as take 2 s)."),
    retry_failed: bool = flag("--retry-failed", "Retry the sensors that failed before."),
    timeout: float | None = optional(
        "Time limit for a sensor, s (default: 20 times that of the others, at least 60).",
        metavar="SECONDS",
    ),
    register: str | None = optional("Enter the calibrations in this register."),
    watch: Path | None = optional("Calibrate each recording as it arrives in this folder."),
    count: int | None = optional("With --watch: stop after this many recordings."),
    out: _Out = None,
    json: Json = False,
) -> None:
    """Calibrate the sensors that have no result yet; a failed sensor is listed with its reason."""
    from inercal.fleet import results
    from inercal.fleet.line import read_line
    from inercal.fleet.status import line_status

    for name, number in (("--batch", batch), ("--count", count)):
        if number is not None and number < 1:
            raise InputError(f"{name} {number}: give 1 or more", key=name)
    if count is not None and watch is None:
        raise InputError(
            "--count works only with --watch; add --watch or remove --count", key="--count"
        )
    if timeout is not None and not 0 < timeout < inf:
        raise InputError(f"--timeout {timeout}: give a number of seconds above 0", key="--timeout")
    read = read_line(line)
    results.schema()  # reports missing packages before any work
    folder = line / results.FOLDER if out is None else out
    if watch is not None:
        batchwise = {"--workers": workers, "--scheduler": scheduler, "--batch": batch,
                     "--retry-failed": retry_failed or None, "--register": register,
                     "--json": json or None}  # fmt: skip
        for name, given in batchwise.items():
            if given is not None:
                raise InputError(f"{name}: --watch takes one recording at a time; remove {name}",
                                 key=name)  # fmt: skip
        _watch(read, watch, folder, count, timeout)
        return
    if register is not None:
        with open_register(register):  # an address that cannot be used is refused before the work
            pass
    counts = _calibrate(read, folder, workers, scheduler, batch, retry_failed, timeout)
    without = counts.failed + counts.lost + counts.kept_failed
    found = line_status(read, out)
    content: dict[str, Any] = {
        **vars(counts), "results": str(folder),
        **{key: found.as_object()[key] for key in ("unreliable", "same_recording")},
        **found.named_sensors(),
    }  # fmt: skip
    if register is not None:
        from inercal.fleet.latest import enter_results

        with open_register(register) as opened, progress_status("entering calibrations") as update:
            content["entered"] = enter_results(
                read, folder, opened, lambda k: update(f"{k} are in the register")
            )
            content["register"] = opened.address
    if json:
        print_json(content)
    else:
        print(
            f"{format_count(counts.sensors, 'sensor')}: {counts.done} calibrated, {counts.kept} "
            "unchanged"
        )
        if without:
            print(f"{format_count(without, 'sensor has', 'sensors have')} no result:")
        for text in found.attention_lines():
            print(text)
        if "entered" in content:
            entered = format_count(content["entered"], "calibration is", "calibrations are")
            print(f"{entered} in {content['register']}")
        print(f"wrote {folder}")
    exit_if(without or found.unreliable or found.same_recording)


@app.command()
def status(line: _Line, out: _Out = None, json: Json = False) -> None:
    """Show how many sensors are calibrated, failed or missing, and why they failed."""
    from inercal.fleet.latest import outdated_lines
    from inercal.fleet.line import read_line
    from inercal.fleet.status import line_status

    read = read_line(line)
    found = line_status(read, out)
    if json:
        print_json(found.as_object())
        return
    print(f"{line}: {format_count(len(read.rows), 'sensor')}")
    for what, number in found.counts.items():
        print(f"{number:>9}  {what}")
    for what, number in found.conformity.items():
        print(f"{number:>9}  {what} by [specification]")
    if found.outdated:
        print(f"{len(found.outdated):>9}  outdated; calibrate again")
    for text in (*found.attention_lines(), *outdated_lines(found.outdated)):
        print(text)


@app.command()
def report(
    line: _Line,
    page: Path | None = out_option(
        "The page (default: report.html in the line's folder, which is renewed)."
    ),
    out: _Out = None,
    force: bool = flag("--force", "Also overwrite a file that is not a page of inercal."),
    json: bool = flag("--json", "Print one JSON object; write a page only with --out."),
) -> None:
    """Compare the sensors of a line: distributions, lots, outliers, drift, stations and yield."""
    from inercal.fleet import results
    from inercal.fleet.findings import statistics_object, summary_lines
    from inercal.fleet.line import read_line
    from inercal.fleet.population import read_population
    from inercal.fleet.statistics import fleet_statistics

    path, read = line / _REPORT if page is None and not json else page, read_line(line)
    if path is not None:
        from inercal.report import require_report_packages

        require_report_packages()
        check_outputs({path: PAGE}, read.input_files, force=force or None)
    with progress_status(f"comparing the sensors of {line}"):
        folder = line / results.FOLDER if out is None else out
        found = fleet_statistics(read_population(read, folder))
        if path is not None:
            from inercal.fleet.report_page import fleet_page

            write_text(path, fleet_page(found, line.resolve().name))
    if json:
        print_json(statistics_object(found))
        return
    summary, remarks = summary_lines(found)
    print(summary)
    for text in remarks:
        print(f"· {text}")
    print(f"wrote {path}")


@app.command()
def export(
    line: _Line,
    path: Path = typer.Argument(help="The table to write (.csv or .parquet); with --to, a folder."),
    sensor: str | None = optional("Write the calibration file of this sensor instead."),
    to: str | None = optional("Write one file per sensor for this target (inercal export --help)."),
    stated: list[str] = export_command.SET,
    column: list[str] | None = optional(
        "With --to: take an option from a column of sensors.csv: acc_id=device_id.",
        metavar="OPTION=COLUMN",
    ),
    axes: str = export_command.AXES,
    lossless: bool = export_command.LOSSLESS,
    out: _Out = None,
    force: Force = False,
) -> None:
    """Write the results as one table, the calibration file of one sensor, or files for a target."""
    from inercal.calibration.files import OUTDATED, save
    from inercal.fleet import results
    from inercal.fleet.export import export_files, export_table, sensor_calibration
    from inercal.fleet.line import read_line

    folder = line / results.FOLDER if out is None else out
    if to is not None:
        if sensor is not None:
            raise InputError(
                "--sensor and --to exclude each other: --to writes all sensors", key="--sensor"
            )
        options = assignments(stated, "--set", export_command.OPTION_FORM)
        columns = assignments(column or (), "--column", "OPTION=COLUMN")
        with progress_status(f"writing files for {to}"):
            made = export_files(
                read_line(line),
                folder,
                path,
                to,
                columns=columns,
                force=force,
                options=options,
                axes=axes,
                lossless=lossless,
            )
        for name in made.unreliable:
            report_line(f"warning: {name} should not be relied on")
        _warn_of_outdated(made.outdated)
        print(f"wrote {path}: {format_count(len(made.files), 'file')}")
        for name, reason in made.without.items():
            print(f"no file was written for {name}: {reason}")
        return
    for option, given in (
        ("--set", stated),
        ("--column", column),
        ("--axes", axes != export_command.AXES.default),
        ("--lossless", lossless),
    ):
        if given:
            raise InputError(f"{option} needs --to: name a target", key=option)
    kind = CALIBRATION if sensor is not None else OutputKind("table of sensors")
    read = read_line(line)
    inputs = {*read.input_files, *results.part_paths(folder)}
    check_outputs({path: kind}, inputs, force=force, key="PATH")
    if sensor is not None:
        calibration = sensor_calibration(read, folder, sensor)
        save(calibration, path)
        if (verdict := calibration.verdict) and verdict.grade == "unreliable":
            report_line(f"warning: {sensor} should not be relied on")
        _warn_of_outdated({sensor: calibration.provenance.get(OUTDATED, "")})
        print(f"wrote {path}")
        return
    outdated = export_table(read, folder, path)
    _warn_of_outdated(outdated)
    print(f"wrote {path}: {format_count(len(outdated), 'sensor')}")


def _warn_of_outdated(reasons: Mapping[str, str]) -> None:
    from inercal.fleet.latest import outdated_lines

    for text in outdated_lines(reasons):
        report_line(f"warning: {text}; calibrate the line again")


def _calibrate(
    line: "Line",
    folder: Path,
    workers: int | None,
    scheduler: str | None,
    batch: int | None,
    retry_failed: bool,
    timeout: float | None,
) -> "Counts":
    from inercal.basics.parallel import open_tolerant_executor
    from inercal.fleet.calibration import calibrate_line

    modules = ["scipy.special", *(f"inercal.{name}" for name in _WORKER_MODULES.split())]
    with (
        progress_status(format_count(len(line.rows), "sensor")) as update,
        open_tolerant_executor(workers, scheduler, modules) as executor,
    ):

        def show(counts: "Counts") -> None:
            without = counts.failed + counts.lost
            failed = f", {without} without a result" * bool(without)
            update(f"{counts.settled} of {format_count(counts.sensors, 'sensor')}{failed}")

        warn_of_root(scheduler)
        if executor.dashboard and find_spec("bokeh"):
            print(f"the cluster's page is {executor.dashboard}", file=sys.stderr)
        return calibrate_line(
            line,
            executor,
            out=folder,
            batch=batch,
            retry_failed=retry_failed,
            timeout=timeout,
            progress=show,
        )


def _watch(line: "Line", folder: Path, out: Path, count: int | None, timeout: float | None) -> None:
    """Print a line for each recording that arrives; exit with status 3 if any did not pass."""
    import time

    from inercal.basics.parallel import open_tolerant_executor
    from inercal.fleet.station import StationResult, arriving_files, calibrate_arrival, known_files
    from inercal.fleet.time_limit import TimeLimit

    if not folder.is_dir():
        raise InputError(f"--watch {folder}: no such folder", key="--watch")

    def poll() -> bool:
        time.sleep(_POLL)
        return True

    line.run(line.rows[0])  # a wrong template causes an error before any recording
    suffixes = {Path(row.recording).suffix for row in line.rows}
    print(f"watching {folder}: {format_count(len(line.rows), 'sensor')}", flush=True)

    limit = TimeLimit(timeout)
    failed = done = 0
    try:
        with open_tolerant_executor(1) as executor:
            for path in arriving_files(folder, poll, known_files(line, out), suffixes, report_line):
                try:
                    result = calibrate_arrival(line, path, out, executor, limit)
                except InputError as error:  # a disk is full or was removed
                    result = StationResult(path.stem, False, f"its result was not stored: {error}")
                word = "PASS" if result.passed else "FAIL"
                print(f"{word} {result.id}: {result.reason}", flush=True)
                failed += not result.passed
                done += 1
                if done == count:
                    break
    except KeyboardInterrupt:
        pass  # the usual way to end a station
    print(f"{done - failed} passed, {failed} failed")
    exit_if(failed)
