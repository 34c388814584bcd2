"""The plan of a rate table, printed and written as the table to be filled."""

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

    from inercal.design.on_table import TableSheet


def plan_table(
    run_file: Path, keys: Mapping[str, object], out: Path | None, *, force: bool, json: bool
) -> None:
    """Print the states of a run on a rate table; with `out`, write the table to be filled.

    Raises
    ------
    InputError
        A file that exists, unless by `force`, or that is no .csv; what `worksheet` refuses.
    NotObserved
        Coefficients that the plan leaves open.
    """
    from inercal.cli.show import as_json, working
    from inercal.design.on_table import as_csv, worksheet
    from inercal.runfile import read

    files = {} if out is None else files_of(out, page=False, force=force)
    with working("working out what the plan gives"):
        sheet = worksheet(read(run_file, keys))
    if out is not None:
        write_text(files["sheet"], as_csv(sheet))
    if json:
        as_json(_as_object(sheet) | {kind: str(path) for kind, path in files.items()})
        return
    _print(sheet)
    print_written(files)


def _as_object(sheet: "TableSheet") -> dict[str, Any]:
    return {
        "steps": [
            {
                "label": row.step.label,
                "mounting": row.mounting,
                "up": row.up,
                "rpm": row.rpm,
                "seconds": row.step.seconds,
                "felt": row.felt.tolist(),
            }
            for row in sheet.rows
        ],
        "seconds": sheet.seconds,
        "notes": list(sheet.notes),
        "expected": [known_as_object(one) for one in sheet.expected],
    }


def _print(sheet: "TableSheet") -> None:
    from rich.console import Console

    console = Console()
    _print_rows(sheet, console)
    print_known(sheet.run, (sheet.expected,), console)
    for note in sheet.notes:
        console.print(f"· {note}", highlight=False, markup=False)


def _print_rows(sheet: "TableSheet", console: "Console") -> None:
    from rich.table import Table

    from inercal.sensors import G0

    channels = sheet.run.sensor.channels
    table = Table(title=f"{len(sheet.rows)} states, {sheet.seconds / 60:.3g} min in all")
    table.add_column("row", justify="right")
    for heading in ("mounting", "up"):
        table.add_column(heading)
    table.add_column("r/min", justify="right")
    table.add_column("for", justify="right")
    for channel in channels:
        table.add_column(f"{channel}, g", justify="right")
    for k, row in enumerate(sheet.rows):
        last = k + 1 == len(sheet.rows) or sheet.rows[k + 1].mounting != row.mounting
        reads = [f"{x + 0.0:+.3f}".replace("-", "−") for x in (row.felt / G0).round(3).tolist()]
        cells = (str(row.number), row.mounting, row.up, f"{row.rpm:.4g}")
        table.add_row(*cells, f"{row.step.seconds:g} s", *reads, end_section=last)
    console.print(table)
