"""`inercal apply`: correct a recording with a calibration."""

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from inercal.basics.errors import InercalError, InputError
from inercal.cli.console import print_json, print_lines, progress_status, report_line
from inercal.cli.options import Force, Json
from inercal.cli.outputs import RECORDING, check_outputs

if TYPE_CHECKING:
    from inercal.calibration import Calibration


def run(
    calibration_file: Path = typer.Argument(help="A *.calibration.json file."),
    run_file: Path = typer.Argument(
        help="The run file whose \\[data] names the recording and its columns."
    ),
    out: Path | None = typer.Option(
        None, "--out", "-o", help="The corrected recording to write; required without --stream."
    ),
    stream: str | None = typer.Option(
        None,
        help="Correct samples while they arrive, until Ctrl-C: - for standard input, a file, a "
        "serial port, tcp://HOST:PORT, or udp://HOST:PORT for datagrams to this port.",
    ),
    to: str | None = typer.Option(
        None,
        help="With --stream: tcp://HOST:PORT to which readers connect, or udp://HOST:PORT to which "
        "datagrams are sent, instead of standard output.",
    ),
    form: str | None = typer.Option(
        None, "--format", help="With --stream: csv (the default), json for JSON lines, or msgpack."
    ),
    extrapolate: bool = typer.Option(
        False,
        "--extrapolate",
        help="Also correct samples outside the calibration's temperature range, and mark them.",
    ),
    force: Force = False,
    json: Json = False,
) -> None:
    """Correct a recording or a stream: specific force in m/s², angular rate in rad/s."""
    from inercal.calibration.files import load
    from inercal.runfile import read

    try:
        calibration = load(calibration_file)
        plan = read(run_file)
    except InercalError as error:
        raise _of_another_kind(calibration_file, run_file) or error from None
    if stream is not None:
        from inercal.cli.apply_stream import apply_stream

        if out is not None or force or json:
            raise InputError(
                "--stream writes to standard output or --to; remove --out, --force and --json",
                key="--stream",
            )
        apply_stream(calibration, plan, stream, to, form or "csv", extrapolate=extrapolate)
        return
    if out is None or to is not None or form is not None:
        text = "--to and --format need --stream" if out else "give --out FILE, or --stream SOURCE"
        raise InputError(f"inercal apply: {text}", key="--out")
    # The modules for the work are imported only after the run file has been checked.
    from inercal.pipeline import apply
    from inercal.pipeline.correction import as_written
    from inercal.recordings.io.write import write_recording

    check_outputs({out: RECORDING}, [calibration_file, *plan.input_files()], force=force)
    with progress_status(f"correcting {plan.data.file}"):
        corrected = apply(calibration, plan, extrapolate=extrapolate)
        written = as_written(corrected, plan, text=out.suffix.lower() == ".csv")
        write_recording(written, out)
    warnings = unreliable_text(calibration)
    warnings += [f.message for f in corrected.findings if f.severity == "warning"]
    marked = corrected.readback.get("extrapolated")
    count = 0 if marked is None else int(marked.sum())
    for warning in warnings:
        report_line(f"warning: {warning}")
    if json:
        print_json(
            {
                "recording": str(out),
                "samples": int(corrected.time.size),
                "extrapolated": count,
                "warnings": warnings,
            }
        )
    else:
        units = ", ".join(dict.fromkeys(corrected.units))
        print(f"wrote {out}: {corrected.time.size} samples in {units}")
        for text in assumed_zero_texts(calibration):
            print(text)
        if not calibration.states_uncertainty:
            print_lines(calibration.notes, "· ")


def unreliable_text(calibration: "Calibration") -> list[str]:
    """Return a warning about an unreliable calibration, if it is one."""
    verdict = calibration.verdict
    if verdict is None or verdict.grade != "unreliable":
        return []
    reason = f": {verdict.reasons[0]}" if verdict.reasons else ""
    return [f"the calibration of {calibration.sensor.name} is {verdict.word}{reason}"]


def assumed_zero_texts(calibration: "Calibration") -> list[str]:
    """Return what is assumed about the motion that the axes of a sensor do not measure."""
    from inercal.physics.quantities import QUANTITIES

    return [
        f"The {one.name} across the axes is not measured and was assumed to be zero."
        for one in QUANTITIES.values()
        if 0 < calibration.sensor.rank(one.symbol) < len("xyz")
    ]


def _of_another_kind(calibration_file: Path, run_file: Path) -> InputError | None:
    """Return the error for swapped files or for a log, or None for other files."""
    usage = "inercal apply CALIBRATION RUN_FILE --out CORRECTED"
    if calibration_file.suffix == ".toml" and run_file.suffix == ".json":
        return InputError(
            f"{calibration_file} is the run file and {run_file} the calibration file: give the "
            f"calibration file first, {usage}",
            file=calibration_file,
        )
    for path, wanted in ((calibration_file, ".json"), (run_file, ".toml")):
        if path.suffix == wanted or not path.is_file():
            continue
        if wanted == ".json":
            text = "a calibration file (*.calibration.json), which inercal calibrate writes"
        else:
            text = (
                "a run file (.toml), whose [data] names the recording and its columns: change "
                f"[data] file in the calibration's run file, or use inercal init {path}"
            )
        return InputError(f"{path}: this must be {text}; {usage}", file=path)
    return None
