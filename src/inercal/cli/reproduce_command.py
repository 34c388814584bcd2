"""`inercal reproduce`: recompute a source paper, and judge each of its claims by the numbers."""

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from inercal.cli.worker_option import SCHEDULER, WORKERS

if TYPE_CHECKING:
    from inercal.studies import Study

NAME = "reproduce"
_COLOURS = {"reproduced": "green", "not reproducible": "yellow", "false": "red"}


def run(
    name: str = typer.Argument(
        help="The study: centrifuge, dual-orthogonal, ship-model or turntable."
    ),
    out: Path | None = typer.Option(
        None,
        "--out",
        "-o",
        help="Folder for the page; by default the current one, with --json no page.",
    ),
    trials: int = typer.Option(
        4000, help="Largest number of Monte Carlo trials; slow studies take fewer."
    ),
    seed: int = typer.Option(0, help="Seed of the noise."),
    workers: int | None = WORKERS,
    scheduler: str | None = SCHEDULER,
    json: bool = typer.Option(False, "--json", help="Print one JSON list of the claims."),
) -> None:
    """Recompute a source paper, and judge whether each of its claims holds."""
    from inercal.cli.outputs import PAGE, check_outputs
    from inercal.cli.terminal import terminal
    from inercal.parallel import open_executor
    from inercal.studies import reproduce, results_as_list, write_study

    executor = open_executor(workers, scheduler)
    written: Path | None = None
    folder = Path() if out is None and not json else out
    if folder is not None:
        check_outputs({folder / f"{name}.study.html": PAGE})
    with terminal(stderr=True).status(f"reproducing {name}") as status, executor:
        study = reproduce(name, trials, seed, status.update, executor)
        if folder is not None:
            status.update("writing the page")
            written = write_study(study, folder)
    if json:
        from inercal.cli.console import print_json

        print_json(results_as_list(study))
        return
    _print(study)
    print(f"wrote {written}")


def _print(study: "Study") -> None:
    from rich import box
    from rich.table import Table
    from rich.text import Text

    from inercal.cli.terminal import terminal
    from inercal.studies.claim import format_significant

    table = Table(title=study.title, caption=study.source, box=box.SIMPLE, pad_edge=False)
    table.add_column("claim", ratio=1)
    for heading in ("printed", "computed", "u"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("verdict", max_width=12)
    for section in study.sections:
        for finding in section.findings:
            claim = finding.claim
            u = format_significant(finding.uncertainty) if finding.uncertainty else "0"
            title = claim.title + (f", {claim.unit}" if claim.unit else "")
            verdict = Text(finding.verdict, _COLOURS[finding.verdict])
            if claim.printed is None:
                title += f" (implied: {finding.expected_text})"
            table.add_row(title, finding.printed_text, finding.computed_text, u, verdict)
        table.add_section()
    terminal().print(table)
