"""The plan of a bench with a worksheet, printed and written as the table to be filled."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from inercal.cli.console import print_json, progress_status
from inercal.cli.plan_output import (
    output_files,
    print_sheet_files,
    print_uncertainties,
    uncertainty_as_object,
)

if TYPE_CHECKING:
    from rich.console import Console

    from inercal.benches.operator_sheet import Sheet
    from inercal.design.worksheet import Worksheet


def plan_worksheet(
    run_file: Path, keys: Mapping[str, object], out: Path | None, *, force: bool, json: bool
) -> None:
    """Print the rows of a run; with `out`, write the table to be filled, and its page if any.

    Raises
    ------
    InputError
        A file that exists, unless by `force`, or that is no .csv; what `build_worksheet` refuses.
    NotObserved
        Coefficients that the plan leaves open.
    """
    from inercal.design.worksheet import build_worksheet, run_sheet, worksheet_csv
    from inercal.io.atomic_files import write_text
    from inercal.report import write_worksheet
    from inercal.runfile import read

    with progress_status("working out what the plan gives"):
        run = read(run_file, keys)
        page = bool(run_sheet(run).boxes)
        files = {} if out is None else output_files(out, page=page, force=force)
        result = build_worksheet(run)
    if files:
        write_text(files["sheet"], worksheet_csv(result))
    if "page" in files:
        write_worksheet(result, files["page"], files["sheet"].name)
    if json:
        print_json(_as_object(result) | {kind: str(path) for kind, path in files.items()})
        return
    _print(result)
    print_sheet_files(files)


def _as_object(made: "Worksheet") -> dict[str, Any]:
    sheet = made.sheet
    content: dict[str, Any] = {
        "steps": [{"label": row.label, **row.facts, "seconds": row.seconds} for row in sheet.rows],
        "seconds": sheet.seconds,
        "notes": list(sheet.notes),
        "expected": [uncertainty_as_object(one) for one in made.expected],
    }
    if sheet.sums:
        content["together"] = [uncertainty_as_object(one) for one in made.together]
    return content


def _print(made: "Worksheet") -> None:
    from rich.console import Console

    console = Console()
    _print_rows(made.sheet, console)
    print_uncertainties(
        made.run, [part for part in (made.expected, made.together) if part], console
    )
    for note in made.sheet.notes:
        console.print(f"· {note}", highlight=False, markup=False)


def _print_rows(sheet: "Sheet", console: "Console") -> None:
    from rich.table import Table

    table = Table(title=sheet.title)
    for heading in sheet.headings:
        table.add_column(heading.text, justify="right" if heading.align_right else "left")
    for k, row in enumerate(sheet.rows):
        last = k + 1 == len(sheet.rows) or sheet.rows[k + 1].group != row.group
        table.add_row(*row.cells, end_section=last)
    console.print(table)
