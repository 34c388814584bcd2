"""The plan of a dividing head, printed and written as a worksheet."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from inercal.cli.plan_sheet import (
    files_of,
    known_as_object,
    print_known,
    print_written,
    write_text,
)

if TYPE_CHECKING:
    from rich.console import Console

    from inercal.design.on_head import Worksheet


def plan_head(
    run_file: Path, keys: Mapping[str, object], out: Path | None, *, force: bool, json: bool
) -> None:
    """Print the worksheet of a run on a dividing head; with `out`, write its table and its page.

    Raises
    ------
    InputError
        A file that exists, unless by `force`, or that is no .csv; what `worksheet` refuses.
    NotObserved
        Coefficients that the plan leaves open.
    """
    from inercal.cli.show import as_json, working
    from inercal.design.on_head import worksheet
    from inercal.runfile import read

    files = {} if out is None else files_of(out, page=True, force=force)
    with working("working out what the plan gives"):
        sheet = worksheet(read(run_file, keys))
    if out is not None:
        _write(sheet, files)
    if json:
        as_json(_as_object(sheet) | {kind: str(path) for kind, path in files.items()})
        return
    _print(sheet)
    print_written(files)


def _write(sheet: "Worksheet", files: Mapping[str, Path]) -> None:
    from inercal.design.on_head import as_csv
    from inercal.report import write_worksheet

    write_text(files["sheet"], as_csv(sheet))
    write_worksheet(sheet, files["page"], files["sheet"].name)


def _as_object(sheet: "Worksheet") -> dict[str, Any]:
    from math import degrees

    return {
        "steps": [
            {
                "label": row.step.label,
                "what": row.step.in_words(),
                "angle_deg": degrees(row.step.angle),
                "sense": row.sense,
                "pass": row.in_pass,
                "autocollimator": row.autocollimator,
                "seconds": row.step.seconds,
            }
            for row in sheet.rows
        ],
        "seconds": sheet.seconds,
        "notes": list(sheet.notes),
        "expected": [known_as_object(one) for one in sheet.expected],
        "together": [known_as_object(one) for one in sheet.together],
    }


def _print(sheet: "Worksheet") -> None:
    from rich.console import Console

    console = Console()
    _print_rows(sheet, console)
    print_known(sheet.run, (sheet.expected, sheet.together), console)
    for note in sheet.notes:
        console.print(f"· {note}", highlight=False, markup=False)


def _print_rows(sheet: "Worksheet", console: "Console") -> None:
    from rich.table import Table

    title = f"{len(sheet.rows)} positions, {sheet.seconds:.0f} s of holding in all"
    collimated = sheet.bench.collimated != "none"
    table = Table(title=title)
    table.add_column("row", justify="right")
    for heading in ("label", "head at", "pass"):
        table.add_column(heading)
    if collimated:
        table.add_column("autocollimator")
    if sheet.names.level:
        table.add_column("level")
    table.add_column("hold for", justify="right")
    for k, row in enumerate(sheet.rows):
        cells = [str(row.number), row.step.label, row.angle, f"{row.in_pass}, {row.sense}"]
        cells += [row.autocollimator] * collimated + ["read"] * bool(sheet.names.level)
        last = k + 1 == len(sheet.rows) or sheet.rows[k + 1].in_pass != row.in_pass
        table.add_row(*cells, f"{row.step.seconds:g} s", end_section=last)
    console.print(table)
