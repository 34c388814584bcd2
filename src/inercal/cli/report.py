"""`inercal report`: the HTML report of a run."""

from pathlib import Path

import typer

NAME = "report"


def run(
    run_file: Path = typer.Argument(help="The run file (TOML)."),
    out: Path | None = typer.Option(None, "--out", "-o", help="The page to write."),
    json: bool = typer.Option(False, "--json", help="Print one JSON object."),
) -> None:
    """Calibrate and write the HTML report alone."""
    from inercal.cli.show import as_json, told, working
    from inercal.pipeline import calibrate
    from inercal.report import write_report
    from inercal.runfile import read

    plan = read(run_file)
    page = out or Path(f"{run_file.stem}.report.html")
    with working(f"writing {page}") as say:
        outcome = calibrate(plan, lambda generation: say(f"writing {page}: {told(generation)}"))
        write_report(outcome, page, plan.truth or None)
    if json:
        as_json({"report": str(page), "verdict": list(outcome.verdict)})
    else:
        print(f"wrote {page}")
