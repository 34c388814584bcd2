"""`inercal apply`: correct a recording with a calibration."""

import os
import signal
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from inercal.basics.errors import InercalError, InputError
from inercal.cli.console import print_json, print_lines, progress_status, report_line
from inercal.cli.options import Force, Json, flag, optional, out_option
from inercal.cli.outputs import RECORDING, check_outputs

if TYPE_CHECKING:
    from types import FrameType

    from inercal.calibration import Calibration
    from inercal.host.correction import LiveCorrection
    from inercal.runfile import Run


def run(
    calibration_file: Path = typer.Argument(help="A *.calibration.json file."),
    run_file: Path = typer.Argument(
        help="The run file whose \\[data] names the recording and its columns."
    ),
    out: Path | None = out_option(
        "What to write, required without --stream: a .csv, .npz or .parquet file, an .mcap "
        "file with messages of ROS 2, or a new folder (a name without a suffix) for a ROS 2 bag."
    ),
    stream: str | None = optional(
        "Correct samples while they arrive, until Ctrl-C: - for standard input, a file, a "
        "serial port, tcp://HOST:PORT, or udp://HOST:PORT for datagrams to this port."
    ),
    to: str | None = optional(
        "With --stream: tcp://HOST:PORT to which readers connect, or udp://HOST:PORT to which "
        "datagrams are sent, instead of standard output."
    ),
    form: str | None = optional(
        "With --stream: csv (the default), json for JSON lines, or msgpack. For the folder of "
        "a ROS 2 bag: mcap (the default) or sqlite3.",
        "--format",
    ),
    frame_id: str | None = optional("The frame that messages of ROS 2 name (default: imu_link)."),
    extrapolate: bool = flag(
        "--extrapolate",
        "Also correct samples outside the calibration's temperature range, and mark them.",
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
        if out is not None or force or json or frame_id is not None:
            raise InputError(
                "--stream writes to standard output or --to; remove --out, --frame-id, --force and "
                "--json",
                key="--stream",
            )
        _apply_stream(calibration, plan, stream, to, form or "csv", extrapolate=extrapolate)
        return
    if out is None or to is not None:
        text = "--to needs --stream" if out else "give --out FILE, or --stream SOURCE"
        raise InputError(f"inercal apply: {text}", key="--out")
    # The modules for the work are imported only after the run file has been checked.
    from inercal.pipeline import apply
    from inercal.pipeline.correction import as_written
    from inercal.recordings.io.bag_writing import FRAME_ID, is_bag, write_bag
    from inercal.recordings.io.write import write_recording

    storage = _checked_storage(out, form, frame_id)
    check_outputs({out: RECORDING}, [calibration_file, *plan.input_files()], force=force)
    left_out: tuple[str, ...] = ()
    with progress_status(f"correcting {plan.data.file}"):
        corrected = apply(calibration, plan, extrapolate=extrapolate)
        if is_bag(out):
            frame = FRAME_ID if frame_id is None else frame_id
            left_out = write_bag(corrected, out, frame_id=frame, storage=storage)
        else:
            written = as_written(corrected, plan, text=out.suffix.lower() == ".csv")
            write_recording(written, out)
    warnings = unreliable_text(calibration)
    warnings += [f.message for f in corrected.findings if f.severity == "warning"]
    moved = [f.message for f in corrected.findings if f.what == "delay"]
    if left_out:
        warnings.append(
            f"not written, because no message has a field for it: {', '.join(left_out)}"
        )
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
                "moved": moved,
                "warnings": warnings,
            }
        )
    else:
        units = ", ".join(dict.fromkeys(corrected.units))
        print(f"wrote {out}: {corrected.time.size} samples in {units}")
        for text in (*moved, *assumed_zero_texts(calibration)):
            print(text)
        if not calibration.states_uncertainty:
            print_lines(calibration.notes, "· ")


def _checked_storage(out: Path, form: str | None, frame_id: str | None) -> str:
    """Return how to store a bag, after the options for the kind of output have been checked."""
    from inercal.recordings.io.bag_writing import STORAGES, is_bag
    from inercal.recordings.io.write import SUFFIXES

    if not is_bag(out):
        if out.suffix.lower() not in SUFFIXES:
            raise InputError(
                f"--out {out}: give the name of a {', '.join(SUFFIXES)} or .mcap file, or a name "
                "without a suffix for the folder of a ROS 2 bag",
                key="--out",
            )
        if form is not None or frame_id is not None:
            raise InputError(
                "--format needs --stream or the folder of a bag, and --frame-id a bag; remove them "
                f"for --out {out}",
                key="--out",
            )
    elif out.suffix:
        if form not in (None, "mcap"):
            raise InputError(
                f"--format {form}: {out} is an MCAP file; give the name of a folder for other "
                "formats",
                key="--format",
            )
    elif os.path.exists(out):  # Path.exists raises an error if a name is too long
        advice = "name a new folder for the bag; --force does not replace folders"
        if not os.path.isdir(out):
            advice = (
                f"give a name that ends in {', '.join(SUFFIXES)} or .mcap; a name without a suffix "
                "is the new folder of a bag"
            )
        raise InputError(
            f"{out} exists: {advice}",
            file=out,
            key="--out",
        )
    elif form is not None and form not in STORAGES:
        raise InputError(
            f"no format {form!r} of a bag; possible: {', '.join(STORAGES)}", key="--format"
        )
    return form or "mcap"


def unreliable_text(calibration: "Calibration") -> list[str]:
    """Return a warning about an unreliable calibration, if it is one."""
    verdict = calibration.verdict
    if verdict is None or verdict.grade != "unreliable":
        return []
    reason = f": {verdict.reasons[0]}" if verdict.reasons else ""
    return [f"the calibration of {calibration.sensor.name} is {verdict.word}{reason}"]


def assumed_zero_texts(calibration: "Calibration") -> list[str]:
    """Return what is assumed about errors and motion that were not or cannot be measured."""
    from inercal.export.term_kinds import undetermined
    from inercal.physics.quantities import QUANTITIES

    return list(undetermined(calibration.sensor).values()) + [
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


def _apply_stream(
    calibration: "Calibration",
    run: "Run",
    source: str,
    to: str | None,
    form: str,
    *,
    extrapolate: bool,
) -> None:
    """Correct samples until the source ends or Ctrl-C is pressed, and print a summary."""
    from inercal.calibration.delays import uncorrected_delays
    from inercal.host.correction import open_correction

    correction = open_correction(
        calibration, run, source, to=to, form=form, extrapolate=extrapolate, tell=report_line
    )
    late = uncorrected_delays(calibration.conditions)
    for text in (*unreliable_text(calibration), *late, *assumed_zero_texts(calibration)):
        report_line(text)
    with _interrupts_stop(correction):
        report_line(str(correction.run()))


@contextmanager
def _interrupts_stop(correction: "LiveCorrection") -> Generator[None]:
    """Let the first Ctrl-C stop a correction, and a second one the program."""

    def stop(number: int, frame: "FrameType | None") -> None:
        correction.stop()
        signal.signal(number, before)

    before = signal.signal(signal.SIGINT, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
