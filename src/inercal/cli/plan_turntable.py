"""The path of a turntable, printed step by step with what it will give."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from inercal.cli.console import number_column, print_json, progress_status
from inercal.cli.plan_output import print_uncertainties, uncertainty_as_object

if TYPE_CHECKING:
    from inercal.design.turntable_path import PathSheet


def plan_path(
    run_file: Path, keys: Mapping[str, object], out: Path | None, *, force: bool, json: bool
) -> None:
    """Print the path of a run on a turntable, its duration, and what it will give.

    Raises
    ------
    InputError
        `out`, since there is no table to fill; what `turntable_path_sheet` refuses.
    """
    from inercal.design.turntable_path import turntable_path_sheet
    from inercal.errors import InputError
    from inercal.runfile import read

    if out is not None:
        raise InputError("--out: a path is printed; a turntable leaves a recording, no table")
    with progress_status("following the path"):
        sheet = turntable_path_sheet(read(run_file, keys))
    if json:
        print_json(_as_object(sheet))
        return
    _print(sheet)


def _as_object(sheet: "PathSheet") -> dict[str, Any]:
    return {
        "steps": [
            {
                "label": row.step.label,
                "what": row.step.describe(),
                "move_seconds": row.move,
                "seconds": row.seconds,
            }
            for row in sheet.rows
        ],
        "seconds": sheet.seconds,
        "expected": [uncertainty_as_object(one) for one in sheet.expected],
        "undecided": list(sheet.undecided),
    }


def _advice(sheet: "PathSheet") -> str:
    """Say what tells the coefficients that a path leaves open."""
    from inercal.benches.turntable import require_turntable

    bench = require_turntable(sheet.run)
    if len(bench.axes) < len("xyz"):
        return (
            f"A table of axes {bench.axes} does not tell all: name those to find in "
            '[method] coefficients, such as ["gz.bias", "gz.scale"].'
        )
    return "Turn about each axis of the body, hold more attitudes, or give priors."


def _print(sheet: "PathSheet") -> None:
    from rich.console import Console
    from rich.table import Table

    console = Console()
    heads = (
        number_column("row"),
        "label",
        "what the table does",
        number_column("move"),
        number_column("for"),
    )
    table = Table(*heads, title=f"{len(sheet.rows)} steps, {sheet.seconds / 60:.3g} min in all")
    for row in sheet.rows:
        what = row.step.describe().replace("-", "−")
        move = f"{row.move:.1f} s" if row.move else ""
        table.add_row(str(row.number), row.step.label, what, move, f"{row.seconds:.1f} s")
    console.print(table)
    print_uncertainties(sheet.run, (sheet.expected,), console)
    for words in sheet.undecided:
        text = f"left open, in units of g and rad/s: {words}"
        console.print(f"· {text}", highlight=False, markup=False)
    if sheet.undecided:
        console.print(_advice(sheet), highlight=False, markup=False)
    console.print(
        "Expected of noise and table as stated, over the path as an ideal sensor records it."
    )
