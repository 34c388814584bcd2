"""The plan of a bench with a worksheet, printed and written as the table to be filled."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from inercal.cli.plan_sheet import files_of, known_as_object, print_known, print_sheet_written
from inercal.cli.show import as_json, working

if TYPE_CHECKING:
    from rich.console import Console

    from inercal.benches.sheet import Sheet
    from inercal.design.worksheet import Worksheet


def plan_worksheet(
    run_file: Path, keys: Mapping[str, object], out: Path | None, *, force: bool, json: bool
) -> None:
    """Print the rows of a run; with `out`, write the table to be filled, and its page if any.

    Raises
    ------
    InputError
        A file that exists, unless by `force`, or that is no .csv; what `worksheet` refuses.
    NotObserved
        Coefficients that the plan leaves open.
    """
    from inercal.design.worksheet import as_csv, sheet_of, worksheet
    from inercal.io.atomic import write_text
    from inercal.report import write_worksheet
    from inercal.runfile import read

    with working("working out what the plan gives"):
        run = read(run_file, keys)
        page = bool(sheet_of(run).boxes)
        files = {} if out is None else files_of(out, page=page, force=force)
        made = worksheet(run)
    if files:
        write_text(files["sheet"], as_csv(made))
    if "page" in files:
        write_worksheet(made, files["page"], files["sheet"].name)
    if json:
        as_json(_as_object(made) | {kind: str(path) for kind, path in files.items()})
        return
    _print(made)
    print_sheet_written(files)


def _as_object(made: "Worksheet") -> dict[str, Any]:
    sheet = made.sheet
    content: dict[str, Any] = {
        "steps": [{"label": row.label, **row.facts, "seconds": row.seconds} for row in sheet.rows],
        "seconds": sheet.seconds,
        "notes": list(sheet.notes),
        "expected": [known_as_object(one) for one in made.expected],
    }
    if sheet.sums:
        content["together"] = [known_as_object(one) for one in made.together]
    return content


def _print(made: "Worksheet") -> None:
    from rich.console import Console

    console = Console()
    _print_rows(made.sheet, console)
    print_known(made.run, [part for part in (made.expected, made.together) if part], console)
    for note in made.sheet.notes:
        console.print(f"· {note}", highlight=False, markup=False)


def _print_rows(sheet: "Sheet", console: "Console") -> None:
    from rich.table import Table

    table = Table(title=sheet.title)
    for heading in sheet.headings:
        table.add_column(heading.text, justify="right" if heading.right else "left")
    for k, row in enumerate(sheet.rows):
        last = k + 1 == len(sheet.rows) or sheet.rows[k + 1].group != row.group
        table.add_row(*row.cells, end_section=last)
    console.print(table)
