"""`inercal import`: a calibration of another program."""

from pathlib import Path

import typer

from inercal.cli.console import print_json
from inercal.cli.export_command import stated_options

NAME = "import"


def run(
    file: Path = typer.Argument(help="The file of the other program."),
    of: str = typer.Option(
        ...,
        "--from",
        help="Format: imu_tk, imucal, kalibr, px4, ardupilot, or one of another package.",
    ),
    out: Path | None = typer.Option(None, "--out", "-o", help="The calibration file to write."),
    like: Path | None = typer.Option(
        None, "--like", help="A calibration of the same sensor, for its axes and readouts."
    ),
    stated: list[str] = typer.Option(
        [], "--set", metavar="OPTION=VALUE", help="An option of the format: --set part=gyro."
    ),
    name: str | None = typer.Option(None, "--name", help="Name of the sensor."),
    force: bool = typer.Option(False, "--force", help="Write over an existing file."),
    json: bool = typer.Option(False, "--json", help="Print one JSON object."),
) -> None:
    """Read a calibration of another program, which has no uncertainties, for `inercal compare`."""
    from inercal.calibration.files import calibration_object, load, save
    from inercal.cli.outputs import CALIBRATION, check_outputs
    from inercal.export.readers import import_calibration

    path = out or Path(f"{file.name.partition('.')[0]}.calibration.json")
    inputs = [file] if like is None else [file, like]
    check_outputs({path: CALIBRATION}, inputs, force=force)
    calibration = import_calibration(
        file,
        of,
        like=None if like is None else load(like),
        options=stated_options(stated),
        name=name or "",
    )
    save(calibration, path)
    if json:
        print_json({"calibration": str(path), "content": calibration_object(calibration)})
        return
    from inercal.cli.calibration_view import print_calibration_table

    print_calibration_table(calibration)
    print(f"wrote {path}")
