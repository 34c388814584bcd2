"""`inercal calibrate`: from a run file to a calibration file and a report."""

from pathlib import Path

import typer

NAME = "calibrate"


def run(
    run_file: Path = typer.Argument(help="The run file (TOML): sensor, bench, data, method."),
    out: Path = typer.Option(Path(), "--out", "-o", help="Folder to write to."),
    with_report: bool = typer.Option(True, "--report/--no-report", help="Write the HTML report."),
    json: bool = typer.Option(False, "--json", help="Print one JSON object instead of a table."),
) -> None:
    """Find a sensor's coefficients and their uncertainties from a recording."""
    from inercal.calibration.files import as_object, save
    from inercal.cli.show import as_json, as_table, told, working
    from inercal.errors import InputError
    from inercal.pipeline import calibrate
    from inercal.pipeline.states import write_states
    from inercal.runfile import read

    if not out.is_dir():
        raise InputError(f"{out}: no such folder to write to")
    plan = read(run_file)
    doing = f"calibrating {plan.sensor.name} from {plan.data.file}"
    with working(doing) as say:
        outcome = calibrate(plan, lambda generation: say(f"{doing}: {told(generation)}"))
        result = out / f"{run_file.stem}.calibration.json"
        page = out / f"{run_file.stem}.report.html"
        if with_report:
            from inercal.report import write_report

            write_report(outcome, page, plan.truth or None)
        save(outcome.calibration, result)
        states = write_states(plan, outcome, out / f"{run_file.stem}.states.csv")
    files = {"calibration_file": str(result)} | ({"report": str(page)} if with_report else {})
    files |= {"states": str(states)} if states else {}
    if json:
        as_json(as_object(outcome.calibration) | files)
        return
    as_table(outcome, plan.truth)
    for path in files.values():
        print(f"wrote {path}")
