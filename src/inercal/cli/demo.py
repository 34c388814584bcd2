"""`inercal demo`: calibrate an IMU on a simulated three-axis table, compare with the truth."""

import sys
from pathlib import Path

import typer

from inercal.cli.show import as_json, as_table, leave, print_written

NAME = "demo"


def run(
    out: Path = typer.Option(Path("inercal-demo"), "--out", "-o", help="Folder for its files."),
    seed: int = typer.Option(0, help="Seed of the simulation."),
    quick: bool = typer.Option(False, "--quick", help="Five minutes of the bench, not 24."),
    json: bool = typer.Option(False, "--json", help="Print one JSON object."),
) -> None:
    """Drive a simulated table and IMU through a whole calibration, with the truth beside it."""
    from inercal.calibration.files import as_object
    from inercal.cli.bench_view import STOP, viewing
    from inercal.demonstration import demo
    from inercal.host.folder import require_free
    from inercal.host.simulated import STARTING

    require_free(out)
    print(STARTING, file=sys.stderr, flush=True)
    with viewing(STOP) as show:
        shown = demo(out, seed, quick=quick, show=show)
    if json:
        result = as_object(shown.outcome.calibration)
        as_json(result | {"truth": dict(shown.truth)} | dict(shown.files))
        leave(shown.outcome)
        return
    as_table(shown.outcome, shown.truth)
    print(f"{shown.seconds / 60:.1f} minutes of the bench in {shown.seconds / shown.speed:.0f} s")
    print(f"normalised error squared against the truth: {shown.nees:.2f} (1 is expected)")
    print_written(shown.files)
    leave(shown.outcome)
