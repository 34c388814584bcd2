"""`inercal import`: read a calibration made by another program."""

from pathlib import Path

import typer

from inercal.cli.console import print_json, print_lines
from inercal.cli.export_command import OPTION_FORM
from inercal.cli.options import Force, Json, assignments, optional, out_option, repeated
from inercal.cli.outputs import CALIBRATION, check_outputs


def run(
    file: Path = typer.Argument(help="The file from the other program."),
    of: str = typer.Option(
        ...,
        "--from",
        help="Format: imu_tk, imucal, kalibr, basalt, realsense, px4, ardupilot, inav, betaflight, "
        "magcal, ros_magnetometer, or a format from another package.",
    ),
    out: Path | None = out_option("The calibration file to write."),
    like: Path | None = optional(
        "A calibration of the same sensor, from which the axes and readouts are taken."
    ),
    stated: list[str] = repeated(
        "An option of the format, such as --set part=gyro.", "--set", metavar="OPTION=VALUE"
    ),
    name: str | None = optional("Name of the sensor."),
    axes: str | None = optional(
        "Body axes of the file's x, y, z, such as 'x -y -z' (default: those that inercal "
        "wrote in the file, or else 'x y z')."
    ),
    force: Force = False,
    json: Json = False,
) -> None:
    """Read a calibration from another program for `inercal compare`, without uncertainties."""
    from inercal.calibration.files import calibration_object, load, save
    from inercal.export.readers import import_calibration

    path = out or Path(f"{file.name.partition('.')[0]}.calibration.json")
    inputs = [file] if like is None else [file, like]
    check_outputs({path: CALIBRATION}, inputs, force=force)
    calibration = import_calibration(
        file,
        of,
        like=None if like is None else load(like),
        options=assignments(stated, "--set", OPTION_FORM),
        name=name or "",
        axes=axes,
    )
    save(calibration, path)
    if json:
        print_json({"calibration": str(path), "content": calibration_object(calibration)})
        return
    from inercal.cli.calibration_view import print_calibration_table

    print_calibration_table(calibration)
    print_lines(calibration.notes, "· ")
    print(f"wrote {path}")
