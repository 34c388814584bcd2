"""`inercal store`: manage the register of sensors, runs and calibrations."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from inercal.basics.atomic_files import write_text
from inercal.basics.errors import InercalError, InputError, error_location
from inercal.basics.units import format_count
from inercal.cli.console import open_register, print_json, report_line
from inercal.cli.options import Force, Json, RegisterOption, assignments, flag, optional, out_option
from inercal.cli.outputs import BACKUP, PAGE, check_outputs

if TYPE_CHECKING:
    from inercal.calibration import Calibration
    from inercal.calibration.comparison import Comparison
    from inercal.calibration.comparison.run_to_run import RunToRun
    from inercal.laboratory.store import Register

_LISTED = 50  # calibrations or runs listed in a table by default
app = typer.Typer(
    help="Keep sensors, runs and calibrations in a register, and follow their changes.",
    no_args_is_help=True,
)

_Sensor = Annotated[str, typer.Argument(help="Its name.")]
_All = Annotated[
    bool,
    typer.Option("--all", help=f"List all calibrations and runs, not only the newest {_LISTED}."),
]


@app.command("list")
def list_(
    runs: bool = flag("--runs", "List the runs instead of the sensors."),
    everything: _All = False,
    register: RegisterOption = None,
    json: Json = False,
) -> None:
    """List the sensors with the number of calibrations, the last date, and who entered them."""
    from inercal.cli import store_view

    with open_register(register, create=False) as opened:
        limit = _limit(everything, json)
        sensors = () if runs else opened.sensors()
        found = opened.runs(newest=limit) if runs else ()
        if json:
            listed = [store_view.entry_object(one) for one in (*found, *sensors)]
            print_json({"register": opened.address, "runs" if runs else "sensors": listed})
        elif sensors:
            store_view.print_sensors(sensors)
        elif found:
            store_view.print_runs(found, limit)
        else:
            print(f"{opened.address} is empty; enter calibrations with inercal store import PATH…")


@app.command()
def show(
    what: str = typer.Argument(help="A sensor's name, or the number of a calibration."),
    everything: _All = False,
    register: RegisterOption = None,
    json: Json = False,
) -> None:
    """Show a sensor with its calibrations, runs and noise, or all data of one calibration."""
    from inercal.cli import store_view

    with open_register(register, create=False) as opened:
        # The name of a sensor may be a number.
        is_name = any(one.name == what for one in opened.sensors())
        number = None if is_name else _parse_number(what)
        if number is not None:
            entry = opened.calibration(number)
            if json:
                print_json(store_view.calibration_object(entry, opened.coefficients(number)))
            else:
                runs = [one for one in opened.runs(entry.sensor) if one.id == entry.run]
                store_view.print_calibration(entry, runs[0] if runs else None)
            return
        sensor = opened.sensor(what)
        limit = _limit(everything, json)
        calibrations = opened.calibrations(sensor.id, limit)
        runs = opened.runs(sensor.id, limit)
        noise = opened.noise_history(sensor.id)
        if json:
            print_json(
                {
                    "register": opened.address,
                    "sensor": store_view.entry_object(sensor),
                    "calibrations": [store_view.entry_object(one) for one in calibrations],
                    "runs": [store_view.entry_object(one) for one in runs],
                    "noise": store_view.noise_object_list(noise),
                }
            )
        else:
            store_view.print_sensor(sensor, calibrations, runs, limit)
            store_view.print_newest_noise(noise)


@app.command()
def history(
    sensor: _Sensor,
    coefficients: list[str] | None = typer.Argument(
        None, help="Coefficients to show in full: ax.k0, k0, bias; by default a summary of all."
    ),
    out: Path | None = out_option("The HTML page to write, with figures."),
    limit: list[str] | None = optional(
        "Largest U until the next calibration, such as 'bias=1 mg'; by default the "
        "limits that the newest calibration states."
    ),
    in_use: float | None = optional(
        "Percentage of time in use, to give the interval also in hours."
    ),
    like: list[str] | None = optional(
        "A sensor of the same type, for the interval of a sensor with few "
        "calibrations; by default those with the same model in \\[job]."
    ),
    register: RegisterOption = None,
    json: Json = False,
) -> None:
    """Show how a sensor's coefficients change, and when the next calibration is due."""
    from inercal.cli import store_view
    from inercal.laboratory.store.recalibration import coefficient_limits, needs_pool, recalibration
    from inercal.laboratory.store.type_pool import type_pool

    content: dict[str, Any] = {}
    with open_register(register, create=False) as opened:
        if out is not None:
            check_outputs({out: PAGE}, opened.files)
        entry, noise = opened.sensor(sensor), opened.noise_history(sensor)
        if noise and not entry.calibrations and not coefficients:
            if out is not None:
                from inercal.report import noise_history_page

                write_text(out, noise_history_page(entry, noise))
            if json:
                content = {"sensor": store_view.entry_object(entry)}
            else:
                print(f"{entry.name}: no calibration yet")
        else:
            found = opened.history(sensor)
            chosen = found.select(coefficients or ())
            example = 'coefficient or group = largest U, "bias=1 mg"'
            limits = assignments(limit or (), "--limit", example)
            pool = None
            if like or needs_pool(found):
                pool = type_pool(opened, found, like or (), coefficient_limits(chosen, limits))
            share = None if in_use is None else in_use / 100
            next_one = recalibration(chosen, limits, share, pool)
            if out is not None:
                from inercal.report import write_history

                write_history(chosen, out, next_one, noise)
            if json:
                content = store_view.history_object(chosen)
                content |= {"next_calibration": store_view.recalibration_object(next_one)}
            else:
                store_view.print_history(chosen, detailed=bool(coefficients))
                store_view.print_recalibration(next_one)
    if json:
        more = {} if out is None else {"page": str(out)}
        print_json(content | {"noise": store_view.noise_object_list(noise)} | more)
        return
    if not coefficients:
        store_view.print_noise_history(noise)
    if out is not None:
        print(f"wrote {out}")


@app.command()
def diff(
    first: str = typer.Argument(help="The number of a calibration, or a file."),
    second: str = typer.Argument(help="A later calibration: its number, or a file."),
    repeatability: Path | None = optional(
        "A result of inercal repeat, for the usual scatter from run to run; by default "
        "this is taken from the sensor's other calibrations in the register."
    ),
    register: RegisterOption = None,
    json: Json = False,
) -> None:
    """Compare two calibrations, coefficient by coefficient and all together."""
    from inercal.calibration.comparison import compare
    from inercal.cli.calibration_view import comparison_object, print_comparison

    both = [_load_calibration(one, register) for one in (first, second)]
    with error_location(f"{first} and {second}"):
        compared = compare(*both)
    ordinary = _run_to_run(compared, (first, second), repeatability, register)
    names = first, second
    if json:
        print_json(comparison_object(compared, names, ordinary))
    else:
        print_comparison(compared, names, ordinary)


def _run_to_run(
    compared: "Comparison", given: tuple[str, str], file: Path | None, register: str | None
) -> "RunToRun | None":
    """Test a difference against the run-to-run scatter; None with too few calibrations."""
    from inercal.calibration.comparison.run_to_run import against_scatter, scatter_of_file
    from inercal.laboratory.store.history_text import run_scatter

    if file is not None:
        return against_scatter(compared, scatter_of_file(file, compared))
    numbers = [number for one in given if (number := _parse_number(one)) is not None]
    sensors = {one.sensor.name for one in (compared.first, compared.second)}
    if not numbers or len(sensors) > 1:
        return None
    with open_register(register, create=False) as opened:
        history = opened.history(opened.calibration(numbers[-1]).sensor)
    newest, terms = history.calibrations[-1], compared.second
    if (newest.frame, newest.sensor.form) != (terms.frame, terms.sensor.form):
        return None
    scatter = run_scatter(history, numbers)
    return None if scatter is None else against_scatter(compared, scatter)


@app.command("import")
def import_(
    paths: list[Path] = typer.Argument(help="Calibration files, and folders of bench runs."),
    measured: str | None = optional(
        "Date of measurement for a single calibration, such as 2026-03-01."
    ),
    by: str | None = optional("Name of the person who enters the data; by default your user name."),
    register: RegisterOption = None,
    json: Json = False,
) -> None:
    """Enter calibrations and runs in the register; existing entries are kept.

    A calibration without a date can be dated with --measured.
    """
    if measured is not None and (len(paths) > 1 or paths[0].is_dir()):
        raise InputError(
            "--measured is the date for a single calibration: give exactly one calibration file",
            key="--measured",
        )
    entered: list[dict[str, Any]] = []
    with open_register(register, by) as opened:
        is_new = not opened.exists
        try:
            for path in paths:
                entered.append(_enter_path(opened, path, measured))
                if not json:
                    print(_entry_line(entered[-1]))
            if not json:
                _print_dates(opened, entered, measured)
                if is_new:
                    print(f"created the register {opened.address}")
        except InercalError:
            done, left = len(entered), len(paths) - len(entered) - 1
            if done or left:
                text = f"{done} of {format_count(len(paths), 'path')} entered, {left} not read"
                report_line(text)
            raise
        finally:
            if json:
                print_json({"register": opened.address, "entered": entered})


def _enter_path(opened: "Register", path: Path, measured: str | None) -> dict[str, Any]:
    """Enter one path in the register, and return its run and its calibrations."""
    # A register that does not exist yet is created only when the first entry is valid.
    before = set(opened.calibration_numbers() if opened.exists else ())
    if not path.is_dir():
        numbers = (opened.enter_calibration(path, measured),)
        return _entry_summary(path, None, numbers, before)
    from inercal.host.registration import register_run
    from inercal.host.run_folder import JOURNAL

    if (path / JOURNAL).exists():
        number = register_run(opened, path)
        return _entry_summary(path, number, opened.calibration_numbers(number), before)
    files = sorted(path.glob("*.calibration.json"))
    if not files:
        raise InputError(
            "the folder contains neither a bench run nor *.calibration.json; give the "
            "folder of a run, or calibration files"
        ).located(path)
    return _entry_summary(path, None, opened.enter_calibrations(files), before)


def _entry_summary(
    path: Path, run: int | None, numbers: tuple[int, ...], before: set[int]
) -> dict[str, Any]:
    new = [number for number in numbers if number not in before]
    return {"path": str(path), "run": run, "calibrations": list(numbers), "new": new}


def _entry_line(entered: dict[str, Any]) -> str:
    """Describe in one line which entries were made for a path."""
    parts = [] if entered["run"] is None else [f"run {entered['run']}"]
    parts += [
        f"calibration #{number}" + ("" if number in entered["new"] else " (existing)")
        for number in entered["calibrations"]
    ]
    return f"{entered['path']}: {', '.join(parts)}"


def _print_dates(opened: "Register", entered: list[dict[str, Any]], measured: str | None) -> None:
    """Print the stated date, and the new calibrations that have only the date of their file."""
    if measured is not None:
        number = entered[0]["calibrations"][0]
        print(f"#{number} is dated {opened.calibration(number).measured[:10]}, as stated")
        return
    new = [number for one in entered for number in one["new"]]
    dated = [n for n in new if opened.calibration(n).measured_from == "created"]
    if dated:
        print(
            f"{', '.join(f'#{n}' for n in dated)}: dated by the file; if the "
            "measurement was on another day, import the file again with --measured DATE"
        )


@app.command()
def backup(
    out: Path = typer.Argument(help="The file to write, always in SQLite."),
    force: Force = False,
    register: RegisterOption = None,
    json: Json = False,
) -> None:
    """Write the register, including its certificates, to one file."""
    from inercal.laboratory.store import backup_register
    from inercal.laboratory.store.connection import resolve_address

    file = resolve_address(register).file
    try:
        check_outputs({out: BACKUP}, () if file is None else (file,), force=force)
    except InputError as error:  # the file is an argument of this verb
        raise InputError(str(error).removeprefix("--out "), file=out, key="OUT") from None
    _print_rows(backup_register(register, out), f"wrote {out}", {"backup": str(out)}, json)


@app.command()
def restore(
    file: Path = typer.Argument(help="A file that inercal store backup wrote."),
    register: RegisterOption = None,
    json: Json = False,
) -> None:
    """Read a backup into a register that is empty or does not exist."""
    from inercal.laboratory.store import restore_register
    from inercal.laboratory.store.connection import resolve_address

    shown = resolve_address(register).display_url
    rows = restore_register(file, register)
    _print_rows(rows, f"restored {shown}", {"register": shown}, json)


def _print_rows(rows: dict[str, int], what: str, names: dict[str, str], json: bool) -> None:
    if json:
        print_json({**names, "rows": rows})
        return
    kept = ("sensor", "run", "calibration", "certificate")
    print(f"{what}: " + ", ".join(format_count(rows[name], name) for name in kept))


def _limit(everything: bool, json: bool) -> int | None:
    """Return the number of entries to list, or None for all; JSON output contains all."""
    return None if everything or json else _LISTED


def _parse_number(what: str) -> int | None:
    """Return the number in "#3" or "3", or None for any other text."""
    digits = what.removeprefix("#")
    return int(digits) if digits.isascii() and digits.isdigit() and len(digits) < 10 else None


def _load_calibration(what: str, register: str | None) -> "Calibration":
    """Return a calibration by its number in the register, or from a file."""
    from inercal.laboratory.store.insertions import make_document

    number = _parse_number(what)
    if number is None:
        return make_document(Path(what)).calibration
    with open_register(register, create=False) as opened:
        return opened.calibration(number).calibration
