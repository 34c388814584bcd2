"""`inercal bench`: drive a three-axis table, read an IMU, calibrate live; simulated or on iron."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from inercal.cli import bench_devices, bench_serve
from inercal.cli.bench_options import (
    CLOCK,
    PATIENCE,
    SPEED,
    TABLE,
    TEMPERATURE,
    above_zero,
    of_runs,
)
from inercal.cli.show import as_json, as_table, leave, opened, print_written, working

if TYPE_CHECKING:
    from inercal.host.folder import Folder
    from inercal.host.journal import Journal
    from inercal.host.live import Live
    from inercal.host.options import Options
    from inercal.host.registration import RegisterSync
    from inercal.store import Register

NAME = "bench"
app = typer.Typer(
    help="Drive a three-axis table, read an IMU, calibrate live.", no_args_is_help=True
)

_RunFile = Annotated[Path, typer.Argument(help="The run file (TOML): sensor, bench, data, method.")]
_Clock = Annotated[str, typer.Option(help=CLOCK)]
_Speed = Annotated[float | None, typer.Option(help=SPEED)]
_Patience = Annotated[float, typer.Option(help=PATIENCE)]
_Within = Annotated[str, typer.Option("--temperature", help=TEMPERATURE)]
_Json = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of a table.")]
_Register = Annotated[
    str | None,
    typer.Option(help="Enter the run in the register there, or in the 'default' one."),
]
_IMU = "serial:/dev/ttyUSB0?preset=xsens&baud=921600 or tcp://HOST:PORT?preset=…"


@app.command()
def run(
    run_file: _RunFile,
    table: Annotated[str, typer.Option(help=TABLE)],
    imu: Annotated[str, typer.Option(help=_IMU)],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="New folder of the run; by its time.")
    ] = None,
    clock: _Clock = "",
    speed: _Speed = None,
    patience: _Patience = 120.0,
    temperature: _Within = "",
    register: _Register = None,
    json: _Json = False,
) -> None:
    """Carry out the plan of a run file, and calibrate from what it leaves."""
    from datetime import datetime

    from inercal.host.folder import begin
    from inercal.runfile import read

    options = of_runs(speed, patience, temperature)
    plan = read(run_file)
    kept = opened(register)
    folder = out or Path(f"{run_file.stem}-{datetime.now():%Y%m%d-%H%M%S}")
    made, journal = begin(folder, plan, (table, imu, clock))
    with journal, made.kept_if_begun():
        _go(made, journal, options, json, kept)


@app.command()
def resume(
    folder: Annotated[Path, typer.Argument(help="The folder of a run that was interrupted.")],
    table: Annotated[str, typer.Option(help=f"Where it has another address now: {TABLE}")] = "",
    imu: Annotated[str, typer.Option(help=f"The same: {_IMU}")] = "",
    clock: _Clock = "",
    speed: _Speed = None,
    patience: _Patience = 120.0,
    temperature: _Within = "",
    register: _Register = None,
    json: _Json = False,
) -> None:
    """Go on with a run that was interrupted: the step that was in hand is repeated whole."""
    from inercal.host.folder import resumed

    options = of_runs(speed, patience, temperature)
    kept = opened(register)
    made, journal = resumed(folder, (table, imu, clock))
    with journal:
        _go(made, journal, options, json, kept)


def _go(
    folder: "Folder",
    journal: "Journal",
    options: "Options",
    json: bool,
    register: "Register | None",
) -> None:
    """Carry out what is left of a run, and finish it; a register is told of it, if there is one."""
    from inercal.calibration.files import as_object
    from inercal.host.finish import finish
    from inercal.host.registration import RegisterSync

    keeper = RegisterSync(register, folder.path)
    live = None
    if journal.header().state != "carried out":
        live = _carried_out(folder, journal, options, keeper)
    sensor = folder.run.sensor.name
    try:
        with working(f"calibrating {sensor} from {folder.run.data.file}"):
            outcome, files = finish(folder, journal, live, lambda: keeper.history(sensor))
    finally:
        _enter(keeper)
    if json:
        as_json(as_object(outcome.calibration) | files)
    else:
        as_table(outcome, folder.run.truth)
        print_written(files)
    leave(outcome)


def _enter(keeper: "RegisterSync") -> None:
    """Enter a run as it is now; what fails is said, and how to do it later."""
    keeper.enter()
    if keeper.trouble:
        print(f"inercal: {keeper.trouble}", file=sys.stderr)


def _carried_out(
    folder: "Folder", journal: "Journal", options: "Options", keeper: "RegisterSync"
) -> "Live | None":
    """Have the plan carried out; return what was found while it was."""
    from inercal.cli.bench_keys import keys
    from inercal.cli.bench_view import viewing
    from inercal.host.addresses import layout_of_address
    from inercal.host.compile import compiled
    from inercal.host.execute import Interrupted, carried_out

    with working("compiling what a run needs, once on each machine"):
        compiled(folder.run, layout_of_address(journal.header().imu))
    try:
        with viewing() as show:
            run = carried_out(
                folder, journal, options, show, beside=keys, meanwhile=keeper.meanwhile
            )
    except Interrupted as error:
        _enter(keeper)
        print(f"inercal: interrupted: {error}", file=sys.stderr)
        print(f"go on by: inercal bench resume {folder.path}", file=sys.stderr)
        raise typer.Exit(130) from None
    return run.account.live


@app.command()
def simulate(
    run_file: _RunFile,
    seed: Annotated[int, typer.Option(help="Of noise, and of what is imperfect.")] = 0,
    preset: Annotated[str, typer.Option(help="Of the IMU's packets.")] = "fixed",
    rate: Annotated[
        float | None, typer.Option(help="Packets a second; else as the run file has it.")
    ] = None,
    pace: Annotated[
        str, typer.Option(help="Bench seconds in one of the wall's; or granted: by the host.")
    ] = "granted",
    tcp: Annotated[bool, typer.Option("--tcp", help="The IMU on TCP, not on a terminal.")] = False,
) -> None:
    """Simulate the bench of a run file, until Ctrl-C: a Turbo PMAC, and an IMU on a terminal.

    Lines typed here make things go wrong: `imu fault loss 0.01`, `table fault amplifier 2`.
    """
    from inercal.errors import InputError
    from inercal.host.simulated import SimulatedBench

    paced = pace if pace == "granted" else above_zero("--pace", pace, ", or granted")
    with SimulatedBench(run_file, seed, preset, rate, paced, terminal=not tcp) as bench:
        clock = f" --clock {bench.clock}" if bench.clock else ""
        print(f"inercal bench run {run_file} --table '{bench.table}' --imu '{bench.imu}'{clock}")
        sys.stdout.flush()
        for line in sys.stdin:
            which, _, words = line.strip().partition(" ")
            try:
                if which not in ("table", "imu"):
                    raise InputError(f"{line.strip()!r}; possible: table WORDS or imu WORDS")
                bench.tell(which, words)
                print("ok", flush=True)
            except InputError as error:
                print(f"no: {error}", flush=True)


for verb in (bench_devices.devices, bench_serve.serve):
    app.command()(verb)
