"""`inercal self-check`: check each method on data with known results."""

from pathlib import Path

import typer

from inercal.basics.atomic_files import write_text
from inercal.cli.console import exit_if, print_json, progress_status
from inercal.cli.options import flag, repeated
from inercal.cli.outputs import SELF_CHECK, check_outputs


def run(
    method: list[str] = repeated("Check only this method."),
    out: Path = typer.Option(Path(), "--out", "-o", help="Folder for the dated report."),
    json: bool = flag("--json", "Print one JSON object, and no report."),
) -> None:
    """Check that each method still gives the known results, and write a dated report.

    Run it before the first use, and after each change of version, libraries or machine. It takes
    about a minute. The exit status is 3 if a method fails.
    """
    from inercal.pipeline.self_check import report_text, self_check

    check_outputs({} if json else {out / "self-check.txt": SELF_CHECK})
    with progress_status("checking") as update:
        check = self_check(tuple(method), lambda name: update(f"checking {name}"))
    if json:
        print_json(check.as_object())
    else:
        text = report_text(check)
        print(text, end="")
        day_and_time = check.begun[:19].replace("-", "").replace(":", "").replace("T", "-")
        path = out / f"self-check-{day_and_time}.txt"
        check_outputs({path: SELF_CHECK})
        print(f"wrote {write_text(path, text)}")
    exit_if(not check.passed)
