"""`inercal reproduce`: recompute the results of a source paper or of a bundle."""

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from inercal.basics.errors import InputError
from inercal.basics.units import format_count, format_number
from inercal.cli.console import exit_if, print_json, progress_status
from inercal.cli.options import Scheduler, Workers, flag, optional, out_option, warn_of_root
from inercal.cli.outputs import PAGE, check_outputs

if TYPE_CHECKING:
    from inercal.studies import Study

_COLOURS = {"reproduced": "green", "not reproducible": "yellow", "false": "red"}


def run(
    name: str = typer.Argument(
        help="The study: centrifuge, dual-orthogonal, one-sensor, ship-model or turntable; or a "
        "bundle (.zip)."
    ),
    out: Path | None = out_option(
        "Folder for the page; by default the current one, and no page with --json."
    ),
    trials: int | None = optional(
        "Largest number of Monte Carlo trials of a study (default: 4000)."
    ),
    seed: int | None = optional("Seed of the noise of a study (default: 0)."),
    workers: Workers = None,
    scheduler: Scheduler = None,
    json: bool = flag("--json", "Print one JSON list of the claims."),
) -> None:
    """Recompute the claims of a source paper, or the calibration in a bundle.

    For a paper, each claim is judged as holding or not. For a bundle, the exit status is 3 if the
    recomputed calibration differs.
    """
    if Path(name).suffix.lower() == ".zip":
        options = {"--out": out, "--trials": trials, "--seed": seed, "--workers": workers,
                   "--scheduler": scheduler}  # fmt: skip
        if given := [option for option, value in options.items() if value is not None]:
            raise InputError(f"{', '.join(given)}: not possible with a bundle; omit it")
        _reproduce_bundle(Path(name), json)
        return
    from inercal.basics.parallel import open_executor
    from inercal.cli.terminal import terminal
    from inercal.studies import STUDIES, TRIALS, reproduce, results_as_list, write_study

    modules = [STUDIES[name], "inercal.estimation.loaded_numba"] if name in STUDIES else ()
    executor = open_executor(workers, scheduler, modules)
    written: Path | None = None
    folder = Path() if out is None and not json else out
    if folder is not None:
        check_outputs({folder / f"{name}.study.html": PAGE})
    warn_of_root(scheduler)
    with terminal(stderr=True).status(f"reproducing {name}") as status, executor:
        counts = (TRIALS if trials is None else trials, seed or 0)
        study = reproduce(name, *counts, status.update, executor)
        if folder is not None:
            status.update("writing the page")
            written = write_study(study, folder)
    if json:
        print_json(results_as_list(study))
        return
    _print(study)
    print(f"wrote {written}")


def _reproduce_bundle(path: Path, json: bool) -> None:
    from inercal.pipeline.bundles import TOLERANCE, is_bundle, reproduce_bundle

    if not is_bundle(path):
        raise InputError(f"{path}: no such bundle; check the path", file=path)
    with progress_status(f"computing {path.name} again"):
        found = reproduce_bundle(path)
    changed = {
        name: [text, found.here.get(name, "")]
        for name, text in found.made_with.items()
        if found.here.get(name) != text
    }
    grades = [
        "" if one is None else one.grade for one in (found.stored.verdict, found.outcome.verdict)
    ]
    if json:
        result = {"reproduced": found.reproduced, "difference": found.difference}
        print_json(result | {"tolerance": TOLERANCE, "grades": grades, "changed": changed})
    else:
        print(
            f"{found.stored.sensor.name}: {format_count(found.stored.values.size, 'coefficient')}"
        )
        print(f"largest difference of a value or of its u: {format_number(found.difference, 2)} u")
        print(f"verdict: {' and '.join(dict.fromkeys(grades))}")
        for name, (before, now) in changed.items():
            print(f"{name}: {before} then, {now} here")
        print(
            "reproduced"
            if found.reproduced
            else f"not reproduced: a difference of more than {TOLERANCE} u, or a different verdict"
        )
    exit_if(not found.reproduced)


def _print(study: "Study") -> None:
    from rich import box
    from rich.table import Table
    from rich.text import Text

    from inercal.cli.terminal import terminal
    from inercal.studies.claim import shown

    table = Table(title=study.title, caption=study.source, box=box.SIMPLE, pad_edge=False)
    table.add_column("claim", ratio=1)
    for heading in ("printed", "computed", "u"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("verdict", max_width=12)
    for section in study.sections:
        for finding in section.findings:
            claim = finding.claim
            u = shown(finding.uncertainty) if finding.uncertainty else "0"
            title = claim.title + (f", {claim.unit}" if claim.unit else "")
            verdict = Text(finding.verdict, _COLOURS[finding.verdict])
            if claim.printed is None:
                title += f" (implied: {finding.expected_text})"
            table.add_row(title, finding.printed_text, finding.computed_text, u, verdict)
        table.add_section()
    terminal().print(table)
