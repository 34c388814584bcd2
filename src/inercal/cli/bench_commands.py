"""`inercal bench`: drive a real or simulated table, read an IMU and calibrate live."""

import signal
import sys
from collections.abc import Generator
from contextlib import contextmanager
from datetime import datetime
from functools import partial
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Annotated

import typer

from inercal.basics.errors import InputError, require_extra
from inercal.cli import console
from inercal.cli.device_commands import TABLE_HELP, check_driver, devices
from inercal.cli.options import (
    Explain,
    Json,
    assignments,
    flag,
    optional,
    out_option,
    positive_number,
    run_options,
)

if TYPE_CHECKING:
    from inercal.host.journal import Journal
    from inercal.host.live_estimator import LiveEstimator
    from inercal.host.registration import RegisterSync
    from inercal.host.run_folder import RunFolder
    from inercal.host.tasks import RunOptions
    from inercal.laboratory.store import Register
    from inercal.runfile import Run


@contextmanager
def ended_by_signals() -> Generator[None]:
    """Let SIGTERM end the block as Ctrl-C does, and SIGINT also in the background of a script.

    A shell that starts a program with & in a script makes it ignore SIGINT.
    """
    both = (signal.SIGINT, signal.SIGTERM)
    before = {number: signal.signal(number, signal.default_int_handler) for number in both}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


app = typer.Typer(help="Drive a table, read an IMU and calibrate live.", no_args_is_help=True)

_RunFile = Annotated[Path, typer.Argument(help="The run file (TOML): sensor, bench, data, method.")]
_Clock = Annotated[str, typer.Option(help="Clock of a simulated bench, printed by `simulate`.")]
_Speed = Annotated[
    float | None, typer.Option(help="Largest number of simulated seconds per second.")
]
_Patience = Annotated[
    float, typer.Option(help="End the run after this many seconds without IMU data.")
]
_Temperature = Annotated[
    str, typer.Option(help="Permitted range of the IMU's temperature, °C, such as 15:40.")
]
_Operator = Annotated[
    str, typer.Option(help="Name of the person who confirms mountings; by default your user name.")
]
_Answers = Annotated[
    Path | None,
    typer.Option(
        help="File that confirms the mountings, with one line 'mounted NAME' or 'mounted NAME "
        "OPERATOR' for each; needed on real hardware without a terminal."
    ),
]
_Register = Annotated[
    str | None, typer.Option(help="Enter the run in this register: an address, or default.")
]
_CHAMBER_HELP = "Address of the temperature chamber, for a plan with soaks."
_AlsoImu = Annotated[
    list[str] | None,
    typer.Option(help="A further IMU of the same type, NAME=ADDRESS; can be repeated."),
]
_IMU_HELP = "serial:/dev/ttyUSB0?preset=xsens&baud=921600 or tcp://HOST:PORT?preset=…"


@app.command()
def run(
    run_file: _RunFile,
    table: str = typer.Option(help=f"Address of the table: {TABLE_HELP}"),
    imu: str = typer.Option(help=f"Address of the IMU: {_IMU_HELP}"),
    out: Path | None = out_option("New folder for the run; by default it is named after the time."),
    also_imu: _AlsoImu = None,
    chamber: str = typer.Option("", help=_CHAMBER_HELP),
    clock: _Clock = "",
    speed: _Speed = None,
    patience: _Patience = 120.0,
    temperature: _Temperature = "",
    register: _Register = None,
    operator: _Operator = "",
    answers: _Answers = None,
    explain: Explain = False,
    json: Json = False,
) -> None:
    """Carry out the plan of a run file, and calibrate from the recording."""
    from inercal.host.preparation import check_plan
    from inercal.host.run_folder import create_run
    from inercal.runfile import read

    options = run_options(speed, patience, temperature)
    plan = read(run_file)
    kept = None if register is None else console.open_register(register)
    _require_operator(plan, answers, simulated=bool(clock))
    folder = out or Path(f"{run_file.stem}-{datetime.now():%Y%m%d-%H%M%S}")
    addresses = table, imu, clock
    further = assignments(also_imu or (), "--also-imu", "NAME=ADDRESS")
    result, journal = create_run(folder, plan, addresses, chamber=chamber, further_imus=further)
    with ended_by_signals(), journal, result.removed_on_failure(), result.locked():
        with console.progress_status("checking the plan"):
            warnings = check_plan(plan)
        for words in warnings:
            journal.record_event("warning", words)
            console.report_line(words)
        _complete_run(result, journal, options, kept, operator, answers, explain=explain, json=json)


@app.command()
def resume(
    folder: Path = typer.Argument(help="The folder of a run that was interrupted."),
    table: str = typer.Option("", help=f"Needed if the address changed: {TABLE_HELP}"),
    imu: str = typer.Option("", help=f"Needed if the address changed: {_IMU_HELP}"),
    also_imu: _AlsoImu = None,
    chamber: str = typer.Option("", help="Needed if the address changed."),
    clock: _Clock = "",
    speed: _Speed = None,
    patience: _Patience = 120.0,
    temperature: _Temperature = "",
    register: _Register = None,
    operator: _Operator = "",
    answers: _Answers = None,
    explain: Explain = False,
    json: Json = False,
) -> None:
    """Continue an interrupted run; the interrupted step is repeated from the start."""
    from inercal.host.run_folder import reopen_run

    options = run_options(speed, patience, temperature)
    kept = None if register is None else console.open_register(register)
    further = assignments(also_imu or (), "--also-imu", "NAME=ADDRESS")
    result, journal = reopen_run(folder, (table, imu, clock), chamber, further)
    with journal, result.locked():
        _require_operator(result.run, answers, simulated=bool(journal.header().addresses[2]))
        _complete_run(result, journal, options, kept, operator, answers, explain=explain, json=json)


def _complete_run(
    folder: "RunFolder",
    journal: "Journal",
    options: "RunOptions",
    register: "Register | None",
    operator: str,
    answers: Path | None,
    *,
    explain: bool,
    json: bool,
) -> None:
    """Carry out the remaining steps of a run, finish it, and enter it in the register if given."""
    from inercal.calibration.files import calibration_object
    from inercal.host.registration import RegisterSync
    from inercal.host.run_execution import finish_run

    register_sync = RegisterSync(register, folder.path)
    live = None
    if journal.header().state != "carried out":
        live = _carry_out_plan(folder, journal, options, register_sync, operator, answers)
    sensor = folder.run.sensor.name
    try:
        with console.progress_status(f"calibrating {sensor} from {folder.run.data.file}"):
            outcome, files, further = finish_run(
                folder, journal, live, lambda: register_sync.history(sensor)
            )
    finally:
        _enter_run(register_sync)
    if json:
        console.print_json(calibration_object(outcome.calibration) | files)
    else:
        console.print_coefficients(outcome, folder.run.truth)
        console.print_verdict(outcome.verdict, explain=explain)
        for one in further.values():
            console.print_coefficients(one, {})
            console.print_verdict(one.verdict, explain=explain)
        console.print_written_files(files.values())
    for name in journal.further_imus():
        if name not in further:
            console.report_line(f"{name} is not calibrated; {folder.journal} says why")
    console.exit_with_verdict(outcome)


def _require_operator(run: "Run", answers: Path | None, *, simulated: bool) -> None:
    """Raise an error before anything moves if nobody can confirm the mountings.

    Raises
    ------
    InputError
        The hardware is real but there is neither a terminal nor an answer file, or the answers
        cannot be read.
    """
    from inercal.cli.mounting_answers import read_answers
    from inercal.host.tasks import host_plan

    if answers is not None:
        read_answers(answers)
    elif host_plan(run).spins and not simulated and not sys.stdin.isatty():
        raise InputError(
            "an operator must confirm the mountings of this plan, but standard input is not a "
            "terminal: run it in a terminal or with inercal bench serve, or give the "
            "confirmations in a file with --answers FILE",
            key="--answers",
        )


def _enter_run(register_sync: "RegisterSync") -> None:
    """Enter a run in its present state; on failure, print the error and how to enter it later."""
    register_sync.update()
    if register_sync.trouble:
        console.report_line(register_sync.trouble)


def _carry_out_plan(
    folder: "RunFolder",
    journal: "Journal",
    options: "RunOptions",
    register_sync: "RegisterSync",
    operator: str,
    answers: Path | None,
) -> "LiveEstimator | None":
    """Carry out the plan and return the live estimator."""
    from inercal.cli.bench_view import listen_to_keys, run_display
    from inercal.cli.mounting_answers import TypedConfirmation
    from inercal.host.addresses import layout_of_address
    from inercal.host.preparation import precompile_run
    from inercal.host.run_execution import RunInterrupted, execute_run

    with console.progress_status("compiling (only once on each machine)"):
        precompile_run(folder.run, layout_of_address(journal.header().imu))
    try:
        typed = TypedConfirmation()
        with run_display(typed=typed) as show:
            run = execute_run(
                folder,
                journal,
                options,
                show,
                run_context=partial(
                    listen_to_keys, operator=operator, answers=answers, typed=typed
                ),
                background_work=register_sync.background_work,
            )
    except RunInterrupted as error:
        _enter_run(register_sync)
        console.report_line(f"interrupted: {error}")
        if error.can_be_resumed:
            print(f"to continue: inercal bench resume {folder.path}", file=sys.stderr)
        raise typer.Exit(130) from None
    return run.recorder.live_estimator


@app.command()
def simulate(
    run_file: _RunFile,
    seed: int = typer.Option(0, min=0, help="Seed for the noise and for the errors of the bench."),
    preset: str = typer.Option("fixed", help="Preset of the IMU's packets."),
    rate: float | None = optional("Packets per second; by default the rate in the run file."),
    pace: str = typer.Option(
        "granted", help="Simulated seconds per second; granted: as fast as the host permits."
    ),
    tcp: bool = flag("--tcp", "Connect the IMU by TCP instead of a pseudo-terminal."),
    imus: int = typer.Option(
        1, min=1, help="Number of IMUs; IMU n has the true errors divided by n."
    ),
) -> None:
    """Simulate the table and the IMU of a run file, until you press Ctrl-C.

    You can type lines to inject faults, such as `imu fault loss 0.01` or `table fault amplifier 2`.
    """
    from inercal.host.bench_simulator import BenchSimulator
    from inercal.host.tasks import has_soaks
    from inercal.runfile import read

    if rate is not None:
        positive_number("--rate", str(rate))
    paced = pace if pace == "granted" else positive_number("--pace", pace, ", or granted")
    with (
        ended_by_signals(),
        BenchSimulator(run_file, seed, preset, rate, paced, not tcp, imus) as bench,
    ):
        clock = f" --clock {bench.clock}" if bench.clock else ""
        chamber = f" --chamber '{bench.chamber}'" if has_soaks(read(run_file)) else ""
        if chamber:
            print(f"chamber at {bench.chamber}", file=sys.stderr)
        also = "".join(f" --also-imu '{n}={at}'" for n, at in bench.further_imus.items())
        addresses = f"--table '{bench.table}' --imu '{bench.imu}'{also}{chamber}{clock}"
        print(f"inercal bench run {run_file} {addresses}")
        sys.stdout.flush()
        for line in sys.stdin:
            which, _, words = line.strip().partition(" ")
            try:
                if which not in ("table", "imu"):
                    raise InputError(
                        f"{line.strip()!r} is not a command; type table or imu and then a fault, "
                        "such as imu fault unplug"
                    )
                bench.inject_fault(which, words)
                print("ok", flush=True)
            except InputError as error:
                print(f"no: {error}", flush=True)
        # Standard input may be closed from the beginning, for example in a service or with nohup.
        Event().wait()


@app.command()
def serve(
    plans: Annotated[
        Path, typer.Option(help="Folder with the run files to offer on the page.")
    ] = Path(),
    runs: Annotated[Path, typer.Option(help="Folder in which each run gets a subfolder.")] = Path(
        "runs"
    ),
    register: Annotated[
        str | None, typer.Option(help="The register: a path, sqlite:///… or postgresql://…")
    ] = None,
    table: Annotated[
        str, typer.Option(help="Address of a table to offer on the page; see `run --help`.")
    ] = "",
    imu: Annotated[
        str, typer.Option(help="Address of an IMU to offer on the page; see `run --help`.")
    ] = "",
    clock: _Clock = "",
    speed: _Speed = None,
    patience: _Patience = 120.0,
    temperature: _Temperature = "",
    host: Annotated[
        str, typer.Option(help="Address to listen on; any other than 127.0.0.1 needs a token.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port to listen on; 0 takes any free port.")] = 8765,
    token: Annotated[
        str | None,
        typer.Option(
            envvar="INERCAL_TOKEN",
            help="Token that a browser must present; by default one is created if needed.",
        ),
    ] = None,
    read_token: Annotated[
        str | None,
        typer.Option(
            envvar="INERCAL_READ_TOKEN",
            help="Token for scripts that only read; by default one is created if a token is "
            "needed.",
        ),
    ] = None,
) -> None:
    """Serve the live page: set up, watch, pause, stop and resume runs in a browser.

    A run continues even if the page is closed or this server ends. The software stop is not a
    safety function.
    """
    runs_options = run_options(speed, patience, temperature)
    if not 0 <= port < 65536:
        raise InputError(f"--port {port}: give a port from 0 to 65535", key="--port")
    packages = ("starlette", "uvicorn", "websockets", "tomlkit")
    with require_extra("host", f"the live page needs {', '.join(packages)}", packages):
        from inercal.host.web.server import ServerOptions
        from inercal.host.web.server import serve as served
    served(
        ServerOptions(
            plans, runs, register, table, imu, clock, runs_options, host, port, token, read_token
        )
    )


app.command()(devices)
app.command()(check_driver)
