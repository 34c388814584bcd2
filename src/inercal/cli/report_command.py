"""`inercal report`: write the HTML report of a run."""

from pathlib import Path

import typer

from inercal.cli import console
from inercal.cli.options import Explain, Json, Strict, flag, out_option
from inercal.cli.outputs import PAGE, check_outputs


def run(
    run_file: Path = typer.Argument(help="The run file (TOML)."),
    out: Path | None = out_option("The page to write."),
    for_customer: bool = flag("--for-customer", "Omit run-file keys and next steps."),
    explain: Explain = False,
    strict: Strict = False,
    json: Json = False,
) -> None:
    """Calibrate a sensor, but write only the HTML report.

    The exit status is 0, or 3 if the page is written but the result should not be relied on.
    """
    from inercal.runfile import read

    plan = read(run_file)
    # The modules of the work load after the run file was checked.
    from inercal.calibration.verdict_object import verdict_object
    from inercal.pipeline import calibrate
    from inercal.report import write_report

    page = out or Path(f"{run_file.stem}.report.html")
    refused = page.parent / f"{run_file.stem}.refused.html"
    check_outputs({page: PAGE, refused: PAGE}, plan.input_files())
    with console.progress_status(f"writing {page}") as update:
        with console.draw_refusal(plan, refused):
            outcome = calibrate(
                plan,
                lambda generation: update(f"writing {page}: {console.generation_text(generation)}"),
            )
        write_report(outcome, page, plan.truth or None, for_customer=for_customer)
    if json:
        console.print_json({"report": str(page), "verdict": verdict_object(outcome.verdict)})
    else:
        console.print_verdict(outcome.verdict, explain=explain)
        console.print_written_files([page])
    console.exit_with_verdict(outcome, strict=strict)
