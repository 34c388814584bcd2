"""`inercal compare`: compare two calibration files without a register."""

from pathlib import Path

import typer

from inercal.basics.errors import error_location
from inercal.cli.console import print_json
from inercal.cli.options import Json, optional

REPEATABILITY = optional(
    "A result of inercal repeat, to test the difference against the usual run-to-run scatter.",
    "--repeatability",
)


def run(
    first: Path = typer.Argument(help="A calibration file."),
    second: Path = typer.Argument(help="A later calibration file of the same sensor."),
    repeatability: Path | None = REPEATABILITY,
    json: Json = False,
) -> None:
    """Compare two calibrations, coefficient by coefficient and all together."""
    from inercal.calibration.comparison import compare
    from inercal.calibration.files import load
    from inercal.cli.calibration_view import comparison_object, print_comparison

    pair = load(first), load(second)
    with error_location(f"{first} and {second}"):
        compared = compare(*pair)
    ordinary = None
    if repeatability is not None:
        from inercal.calibration.comparison.run_to_run import against_scatter, scatter_of_file

        ordinary = against_scatter(compared, scatter_of_file(repeatability, compared))
    names = str(first), str(second)
    if json:
        print_json(comparison_object(compared, names, ordinary))
    else:
        print_comparison(compared, names, ordinary)
