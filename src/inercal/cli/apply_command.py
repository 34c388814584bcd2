"""`inercal apply`: correct a recording with a calibration."""

import sys
from pathlib import Path

import typer

from inercal.cli.console import print_json, progress_status

NAME = "apply"


def run(
    calibration_file: Path = typer.Argument(help="A *.calibration.json file."),
    run_file: Path = typer.Argument(
        help="The run file whose \\[data] names recording and columns."
    ),
    out: Path = typer.Option(..., "--out", "-o", help="The corrected recording to write."),
    force: bool = typer.Option(False, "--force", help="Write over an existing file."),
    json: bool = typer.Option(False, "--json", help="Print one JSON object."),
) -> None:
    """Correct a recording: specific force in m/s², angular rate in rad/s."""
    from inercal.calibration.files import load
    from inercal.cli.outputs import RECORDING, check_outputs
    from inercal.runfile import read

    calibration = load(calibration_file)
    plan = read(run_file)
    # The modules of the work load after the run file was checked.
    from inercal.io.write import write_recording
    from inercal.pipeline import apply

    check_outputs({out: RECORDING}, [calibration_file, *plan.input_files()], force=force)
    with progress_status(f"correcting {plan.data.file}"):
        corrected = apply(calibration, plan)
        write_recording(corrected, out)
    warnings = [f.message for f in corrected.findings if f.severity == "warning"]
    verdict = calibration.verdict
    if verdict is not None and verdict.grade == "unreliable":
        reason = f": {verdict.reasons[0]}" if verdict.reasons else ""
        warnings.insert(0, f"{calibration_file} is {verdict.word}{reason}")
    for warning in warnings:
        print(f"inercal: warning: {warning}", file=sys.stderr)
    if json:
        print_json(
            {"recording": str(out), "samples": int(corrected.time.size), "warnings": warnings}
        )
    else:
        units = ", ".join(dict.fromkeys(corrected.units))
        across = sum(name.startswith("f") for name in corrected.channels) in (1, 2)
        alone = "; specific force across these axes was taken as zero" * across
        print(f"wrote {out}: {corrected.time.size} samples in {units}{alone}")
