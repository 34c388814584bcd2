"""`inercal bundle`: pack a calibration with its run file and data into one file."""

from pathlib import Path

import typer

from inercal.basics.errors import InputError
from inercal.cli.console import print_json
from inercal.cli.options import Force, Json, optional, out_option
from inercal.cli.outputs import BUNDLE, check_outputs


def run(
    run_file: Path = typer.Argument(help="The run file (TOML) of the calibration."),
    calibration: Path | None = optional(
        "Its calibration file (default: the file with the same name in the current folder)."
    ),
    out: Path | None = out_option("The bundle to write (default: the run file's name with .zip)."),
    force: Force = False,
    json: Json = False,
) -> None:
    """Pack run file, data and calibration into one file, which `inercal reproduce` checks.

    The bundle also contains the software versions, the machine and the SHA-256 hash of each file.
    """
    from inercal.pipeline.bundles import write_bundle

    file = calibration or Path(f"{run_file.stem}.calibration.json")
    target = out or Path(f"{run_file.stem}.zip")
    if target.suffix.lower() != ".zip":
        raise InputError(f"--out {target}: a bundle is a ZIP file; give a name with .zip")
    check_outputs({target: BUNDLE}, [run_file, file], force=force)
    names = write_bundle(run_file, file, target)
    if json:
        print_json({"bundle": str(target), "files": names})
        return
    print(f"wrote {target}: {', '.join(names)}")
