"""`inercal measure`: fill a worksheet position by position, with instructions."""

import shlex
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import typer

from inercal.basics.atomic_files import keep_previous
from inercal.basics.errors import InputError
from inercal.basics.units import format_count
from inercal.basics.visible_text import visible_text
from inercal.cli.console import exit_if, print_json
from inercal.cli.options import flag, optional, out_option, repeated
from inercal.cli.outputs import WORKSHEET, check_outputs, require_suffix
from inercal.physics.quantities import QUANTITIES

if TYPE_CHECKING:
    from inercal.host.guided.measurement_table import MeasurementTable
    from inercal.runfile import Run

_OPEN = 130  # the exit status: interrupted and can be resumed


def run(
    plan: Path = typer.Argument(
        help="The run file (.toml), or the worksheet that inercal plan wrote (.csv)."
    ),
    run_file: Path | None = optional(
        "The run file for the worksheet, if no run file in its folder names it.", "--run", "-r"
    ),
    out: Path | None = out_option("The table to fill (.csv); by default \\[data] file."),
    readings: int = typer.Option(
        1, "--readings", "-n", min=1, max=10_000, help="Number of readings per mean."
    ),
    instrument: list[str] = repeated(
        "Address of an instrument that reads the sensor: tcp://HOST:PORT, "
        "serial:PATH?baud=9600 or visa:GPIB0::22::INSTR. Give several in the order of the columns.",
        "--instrument",
        "-i",
    ),
    query: str = typer.Option(
        "READ?",
        help='The command that requests a reading; "" for a device that sends lines by itself.',
    ),
    timeout: float = typer.Option(10.0, min=0.01, help="Longest time to wait for a reading, s."),
    tolerance: float = typer.Option(
        20.0,
        min=0.0,
        help="Ask for a reading again if it differs from that of an ideal sensor by more than "
        "this percentage of the specific force or rate.",
    ),
    force: bool = flag("--force", "Start again; the earlier table is renamed to .previous."),
    json: bool = flag("--json", "Print one JSON object at the end."),
) -> None:
    """Fill a worksheet position by position, with instructions for each reading.

    You can type the readings, pipe them (one per line) or read them from instruments. Each reading
    is stored at once, so an interrupted measurement can be continued. Commands: undo, repeat, keep,
    quit, help.
    """
    planned, path = _run_and_table(plan, run_file, out)
    # The modules of the work load after the run file was checked.
    from inercal.host.guided.dialogue import GuidedMeasurement, ReadingCheck
    from inercal.host.guided.instruments import open_sensor_instrument
    from inercal.host.guided.measurement_table import MeasurementTable, measurement_files

    def say(text: str, end: str = "\n") -> None:
        print(visible_text(text), end=end, file=sys.stderr if json else sys.stdout, flush=True)

    def read_line(prompt: str) -> str | None:
        if sys.stdin.isatty():
            say(prompt, end="")
        try:
            return sys.stdin.readline() or None
        except UnicodeDecodeError:
            raise InputError("standard input is not text; give the readings as text") from None

    before = path.read_bytes() if path.is_file() else None
    with ExitStack() as opened:
        files = measurement_files(path)
        own = planned.file(planned.data.file)
        inputs = [path for path in planned.input_files() if path != own]
        # The readings in an existing table are kept, and the measurement continues in it.
        check_outputs(dict.fromkeys(files, WORKSHEET), inputs, force=True)
        check = ReadingCheck(planned, tolerance / 100)
        table = MeasurementTable(planned, path, readings, anew=force)
        devices = [
            opened.enter_context(open_sensor_instrument(address, query, timeout))
            for address in instrument
        ]
        notes = [f"{one.address}: {name}" for one in devices if (name := one.identity())]
        if force:
            for file in files:
                keep_previous(file)
        table.begin([f"instrument {note}" for note in notes])
        _introduce(table, notes, say)
        units = {name: axis.readout.unit for name, axis in check.axes.items()}
        dialogue = GuidedMeasurement(
            table, check, devices, readings, table.sheet.entry_units | units,
            read_line, say, interactive=sys.stdin.isatty(),
        )  # fmt: skip
        try:
            complete = dialogue.run()
        except KeyboardInterrupt:
            print(file=sys.stderr)
            print(_how_to_continue(table), file=sys.stderr)
            raise
    after = _how_to_continue(table)
    if complete:
        command = f"inercal calibrate {planned.path}"
        after = f"next: {command}"
        if own.resolve() != path.resolve():
            after = f'next: set [data] file = "{path.name}" in {planned.path}, then run {command}'
    if json:
        content = {"table": str(path), "measured": table.measured, "rows": len(table.rows)}
        print_json(content | {"complete": complete, "next": after})
    else:
        if not path.is_file() or path.read_bytes() != before:
            print(f"wrote {path}")
        print(after)
    exit_if(not complete, _OPEN)


def _run_and_table(plan: Path, run_file: Path | None, out: Path | None) -> "tuple[Run, Path]":
    """Return the run and the table to fill.

    Raises
    ------
    InputError
        There is no run file, the run file uses a recording, or the table is not a .csv file.
    """
    from inercal.physics.section_settings import key_error
    from inercal.runfile import read

    is_table = plan.suffix.lower() == ".csv"
    if is_table and out is not None:
        raise InputError(f"--out: {plan} is the table already; remove --out", key="--out")
    if not is_table and run_file is not None:
        raise InputError(f"--run: {plan} is the run file already; remove --run", key="--run")
    run = read((run_file or _run_file_of(plan)) if is_table else plan)
    if run.data.kind != "means":
        raise key_error(
            "[data] kind",
            'must be "means" for a guided measurement: state kind = "means", and the table to fill '
            "as file",
            run.path,
        )
    for axis in run.sensor.axes:
        section = QUANTITIES[axis.measures].sensor
        if section not in run.data.sd:
            raise key_error(
                f"[data.sd] {section}",
                "is missing: state the standard deviation of a mean",
                run.path,
            )
    path = plan if is_table else out or run.file(run.data.file)
    require_suffix(path, ".csv", key="[data] file" if out is None else "--out")
    return run, path


def _run_file_of(table: Path) -> Path:
    """Return the only run file in a table's folder whose [data] names the table."""
    from inercal.basics.small_files import read_toml

    found: list[Path] = []
    for path in sorted(table.parent.glob("*.toml")):
        try:
            data: Any = read_toml(path, "run file").get("data")
        except InputError:
            continue
        if isinstance(data, dict) and cast(dict[str, Any], data).get("file") == table.name:
            found.append(path)
    if len(found) != 1:
        if not table.exists():
            raise InputError(f"{table}: no such file; check the path", file=table)
        what = f"{', '.join(map(str, found))} name" if found else "no run file in its folder names"
        raise InputError(
            f"{table}: {what} it as [data] file; give the run file by --run FILE", key="--run"
        )
    return found[0]


def _introduce(
    table: "MeasurementTable", instruments: Sequence[str], say: Callable[[str], None]
) -> None:
    say(table.sheet.title)
    for note in (*table.sheet.notes, *instruments):
        say(f"· {note}")
    if sys.stdin.isatty():
        say("· Type the readings for a row, or a command: undo, repeat, keep, quit or help.")
    if table.left_out:
        say(f"· The table has no row for {', '.join(table.left_out)}.")
    if table.measured:
        left = ": the others follow." if table.measured < len(table.rows) else "."
        rows = format_count(len(table.rows), "row is", "rows are")
        say(f"· {table.measured} of {rows} measured{left}")


def _how_to_continue(table: "MeasurementTable") -> str:
    command = shlex.join(["inercal", *(word for word in sys.argv[1:] if word != "--force")])
    return (
        f"{table.measured} of {format_count(len(table.rows), 'row is', 'rows are')} measured; to "
        f"go on: {command}"
    )
