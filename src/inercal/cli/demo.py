"""`inercal demo`: simulate a MEMS IMU, calibrate it from its recording, compare with the truth."""

from pathlib import Path

import typer

NAME = "demo"


def run(
    out: Path = typer.Option(Path("inercal-demo"), "--out", "-o", help="Folder for its files."),
    seed: int = typer.Option(0, help="Seed of the simulation."),
    json: bool = typer.Option(False, "--json", help="Print one JSON object."),
) -> None:
    """Show the whole path on a simulated MEMS IMU, with the truth beside the result."""
    from inercal.calibration.files import as_object
    from inercal.cli.show import as_json, as_table, working
    from inercal.demonstration import demo

    with working("simulating a MEMS IMU and calibrating it from its recording"):
        shown = demo(out, seed)
    if json:
        result = as_object(shown.outcome.calibration)
        as_json(result | {"truth": dict(shown.truth)} | dict(shown.files))
        return
    as_table(shown.outcome, shown.truth)
    print(f"normalised error squared against the truth: {shown.nees:.2f} (1 is expected)")
    for path in shown.files.values():
        print(f"wrote {path}")
