"""`inercal calibrate`: from a run file to a calibration file and a report."""

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from inercal.cli.show import (
    as_json,
    as_table,
    drawn_if_refused,
    generation_in_words,
    leave,
    opened,
    print_written,
    working,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from inercal.runfile import Run

NAME = "calibrate"


def run(
    run_file: Path = typer.Argument(help="The run file (TOML): sensor, bench, data, method."),
    out: Path = typer.Option(Path(), "--out", "-o", help="Folder to write to."),
    with_report: bool = typer.Option(True, "--report/--no-report", help="Write the HTML report."),
    register: str | None = typer.Option(
        None, help="Enter the calibration in the register there, or in the 'default' one."
    ),
    strict: bool = typer.Option(
        False, "--strict", help="Exit with status 3 also where there are reservations."
    ),
    json: bool = typer.Option(False, "--json", help="Print one JSON object instead of a table."),
) -> None:
    """Find a sensor's coefficients and their uncertainties from a recording.

    The exit status is 0, 2 for input that cannot be used, 3 where the result is written but is not
    to be relied on, or 130 when interrupted.
    """
    from contextlib import nullcontext

    from inercal.calibration.files import as_object, save
    from inercal.errors import InputError
    from inercal.io.atomic import written_together
    from inercal.io.means import write_means
    from inercal.pipeline import calibrate
    from inercal.runfile import read

    if not out.is_dir():
        raise InputError(f"{out}: no such folder to write to")
    plan = read(run_file)
    doing = f"calibrating {plan.sensor.name} from {plan.data.file}"
    with opened(register) or nullcontext() as kept, working(doing) as say:
        with drawn_if_refused(plan, out / f"{run_file.stem}.refused.html" if with_report else None):
            outcome = calibrate(
                plan, lambda generation: say(f"{doing}: {generation_in_words(generation)}")
            )
        names = {"calibration_file": "calibration.json", "report": "report.html"}
        tables = plan.kind.tables(plan, outcome)
        names |= {what: f"{what}.csv" for what in tables}
        if not with_report:
            del names["report"]
        files = {kind: out / f"{run_file.stem}.{name}" for kind, name in names.items()}
        results = [kind for kind in files if kind != "report"]
        _require_apart(plan, [files[what] for what in tables])
        with written_together([files[kind] for kind in results]) as parts:
            part = dict(zip(results, parts, strict=True))
            save(outcome.calibration, part["calibration_file"])
            for what, columns in tables.items():
                write_means(part[what], columns)
        history = None
        if kept is not None:
            kept.enter_calibration(outcome.calibration)
            history = kept.history(plan.sensor.name)
        # Whatever a page may lack, the result stands before it is drawn.
        if with_report:
            from inercal.report import write_report

            write_report(outcome, files["report"], plan.truth or None, history)
    if json:
        as_json(as_object(outcome.calibration) | {kind: str(path) for kind, path in files.items()})
    else:
        as_table(outcome, plan.truth)
        print_written(files)
    leave(outcome, strict=strict)


def _require_apart(plan: "Run", tables: "Sequence[Path]") -> None:
    """Refuse to write a table over the recording that it is made of."""
    from inercal.errors import InputError

    for path in tables:
        if path.resolve() == plan.file(plan.data.file).resolve():
            raise InputError(
                f"{path} is the recording, and a table of it would be written over it: rename one "
                "of recording and run file"
            )
