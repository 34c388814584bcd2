"""`inercal calibrate`: make a calibration file and a report from a run file."""

from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from inercal.basics.atomic_files import atomic_write_all, keep_previous, write_text
from inercal.basics.errors import InputError, MissingExtra
from inercal.cli import console, outputs
from inercal.cli.log_drafts import SET, draft_logs
from inercal.cli.options import Explain, Json, Strict, flag, optional

if TYPE_CHECKING:
    from inercal.pipeline.drafts import Draft

_SUFFIX = ".toml"  # of a run file; every other file is a log


def run(
    inputs: list[Path] = typer.Argument(
        metavar="RUN_FILE|LOG…",
        help="A run file (TOML), or a recording, for which a run file is drafted: a file, a file "
        "for the accelerometers and one for the gyros, several files with the same columns, a "
        "folder, or a name with a star.",
    ),
    out: Path = typer.Option(Path(), "--out", "-o", help="Folder to write to; created if needed."),
    stated: list[str] = SET,
    yes: bool = typer.Option(
        False, "--yes", "-y", help="Ask no questions about a log, but list what is assumed."
    ),
    force: bool = flag(
        "--force", "Also overwrite a calibration from another run file, and the run file of a log."
    ),
    with_report: bool = typer.Option(True, "--report/--no-report", help="Write the HTML report."),
    register: str | None = optional(
        "Enter the calibration in this register: an address, or default."
    ),
    auto: bool = flag(
        "--auto", 'Add coefficients that the score tests find: \\[method] also = "auto".'
    ),
    explain: Explain = False,
    strict: Strict = False,
    json: Json = False,
) -> None:
    """Estimate a sensor's coefficients and their uncertainties from a run file or a recording.

    For a recording, a run file is drafted as by inercal init, and written beside the results. In a
    terminal, you are asked for values that cannot be found from the data; otherwise state them with
    --set, or accept typical values with --yes.

    The exit status is 0 on success, 2 if the input cannot be used, 3 if the result is written but
    should not be relied on, and 130 if interrupted.
    """
    from inercal.runfile import read

    run_file, drafted = inputs[0], None
    if len(inputs) > 1 and any(one.suffix == _SUFFIX for one in inputs):
        raise InputError(f"{' '.join(map(str, inputs))}: give either one run file or only logs")
    if run_file.suffix != _SUFFIX:
        drafted = _draft(inputs, out, stated, yes=yes, force=force)
        run_file = drafted.path
        write_text(run_file, drafted.text)
        for line in (*drafted.unused, *drafted.assumptions) if not json else ():
            print(line)
    elif stated or yes:
        raise InputError(
            f"{run_file} is a run file, but --set and --yes are for logs: change its keys instead",
            file=run_file,
        )
    plan = read(run_file)
    # The modules of the work load after the run file was checked.
    from inercal.calibration.files import calibration_object, save
    from inercal.pipeline import calibrate
    from inercal.recordings.io.mean_tables import write_means

    files = {"calibration_file": out / f"{run_file.stem}.calibration.json"}
    kinds = {files["calibration_file"]: outputs.CALIBRATION}
    refused = out / f"{run_file.stem}.refused.html" if with_report else None
    if refused is not None:
        files["report"] = out / f"{run_file.stem}.report.html"
        kinds |= {files["report"]: outputs.PAGE, refused: outputs.PAGE}
    sources = plan.input_files()
    outputs.check_outputs(kinds, sources)
    if not force:
        outputs.require_same_run(files["calibration_file"], run_file, plan.sensor.name)
    doing = f"calibrating {plan.sensor.name} from {plan.data.file}"
    with (
        nullcontext() if register is None else console.open_register(register) as opened,
        console.progress_status(doing) as update,
    ):
        with console.draw_refusal(plan, refused):
            outcome = calibrate(
                plan,
                lambda generation: update(f"{doing}: {console.generation_text(generation)}"),
                also="auto" if auto else None,
            )
        folder = outputs.run_folder(files["calibration_file"], run_file)
        if folder != ".":  # only then the names of the files do not identify the run file
            provenance = {**outcome.calibration.provenance, outputs.FOLDER: folder}
            calibration = replace(outcome.calibration, provenance=provenance)
            outcome = replace(outcome, calibration=calibration)
        if opened is not None:
            opened.require_same_device(outcome.calibration)
        tables = plan.kind.tables(plan, outcome)
        files |= {what: out / f"{run_file.stem}.{what}.csv" for what in tables}
        own = {files[what]: outputs.table_kind(what, columns) for what, columns in tables.items()}
        outputs.check_outputs(own, sources)
        results = [kind for kind in files if kind != "report"]
        keep_previous(files["calibration_file"])
        with atomic_write_all([files[kind] for kind in results]) as parts:
            part = dict(zip(results, parts, strict=True))
            save(outcome.calibration, part["calibration_file"])
            for what, columns in tables.items():
                write_means(part[what], columns)
        history, changed = None, ""
        if opened is not None:
            number = opened.enter_calibration(outcome.calibration)
            history = opened.history(plan.sensor.name)
            if history.entries[-1].id == number:
                from inercal.laboratory.store.history_text import newest_change_text

                changed = newest_change_text(history)
        # The calibration file is written first, so that an error in the page does not lose it.
        missing = None
        if with_report:
            from inercal.report import write_report

            try:
                write_report(outcome, files["report"], plan.truth or None, history)
            except MissingExtra as error:
                missing = error
                del files["report"]
    if drafted is not None:
        files["run_file"] = run_file
    if json:
        found = [one.as_object() for one in outcome.characteristics]
        console.print_json(
            calibration_object(outcome.calibration)
            | ({"characteristics": found} if found else {})
            | {kind: str(path) for kind, path in files.items()}
            | ({} if drafted is None else {"assumptions": list(drafted.assumptions)})
        )
    else:
        console.print_coefficients(outcome, plan.truth)
        console.print_verdict(outcome.verdict, explain=explain)
        console.print_lines([changed] * bool(changed))
        console.print_written_files(files.values())
    if missing is not None:
        console.report_line(f"no report: {missing}")
    console.exit_with_verdict(outcome, strict=strict)


def _draft(
    logs: Sequence[Path], out: Path, stated: Sequence[str], *, yes: bool, force: bool
) -> "Draft":
    """Draft the run file for a recording; raise an error if questions are open."""
    from inercal.pipeline.drafts import recording_name, require_answers

    path = out / f"{recording_name(logs)}{_SUFFIX}"
    if path.exists() and not force:
        raise InputError(
            f"{path} exists: calibrate it with inercal calibrate {path}, or overwrite it with "
            "--force",
            file=path,
        )
    outputs.check_outputs({path: outputs.RUN_FILE}, logs, force=force)
    draft = draft_logs(logs, path, stated, yes=yes)
    require_answers(draft)
    return draft
