"""`inercal demo`: calibrate an IMU on a simulated three-axis table."""

import sys
from functools import cache, partial
from pathlib import Path

import typer

from inercal.cli import console
from inercal.cli.options import Json, flag


def run(
    out: Path = typer.Option(
        Path("inercal-demo"), "--out", "-o", help="Folder for the files from the run."
    ),
    seed: int = typer.Option(0, min=0, help="Seed for the simulation."),
    quick: bool = flag("--quick", "Run for 5 simulated minutes instead of 24."),
    json: Json = False,
) -> None:
    """Calibrate an IMU on a simulated table, and compare the result with the truth."""
    from inercal.calibration.files import calibration_object
    from inercal.cli.bench_view import STOP_HELP, run_display
    from inercal.host.bench_simulator import COMPILATION_MESSAGE, STARTUP_MESSAGE
    from inercal.host.demonstration import demo
    from inercal.host.run_folder import prepare_folder

    prepare_folder(out)

    @cache  # several processes may compile; the user is told once
    def say(text: str) -> None:
        print(text, file=sys.stderr, flush=True)

    say(STARTUP_MESSAGE)
    with run_display(STOP_HELP) as show:
        compiling = partial(say, COMPILATION_MESSAGE)
        shown = demo(out, seed, quick=quick, show=show, compiling=compiling)
    if json:
        result = calibration_object(shown.outcome.calibration)
        console.print_json(result | {"truth": dict(shown.truth)} | dict(shown.files))
        console.exit_with_verdict(shown.outcome)
        return
    console.print_coefficients(shown.outcome, shown.truth)
    console.print_line(shown.outcome.verdict.lines[0], "bold")
    print(f"{shown.seconds / 60:.1f} minutes simulated in {shown.seconds / shown.speed:.0f} s")
    print(f"normalised squared error relative to the truth: {shown.nees:.2f} (1 is expected)")
    console.print_written_files(shown.files.values())
    console.exit_with_verdict(shown.outcome)
