"""The plan of a dividing head, printed and written as a worksheet."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console

    from inercal.design.on_head import Known, Worksheet


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

    files = {} if out is None else _files(out, force=force)
    with working("working out what the plan gives"):
        sheet = worksheet(read(run_file, keys))
    if out is not None:
        _write(sheet, files)
    if json:
        as_json(_as_object(sheet) | {kind: str(path) for kind, path in files.items()})
        return
    _print(sheet)
    for path in files.values():
        print(f"wrote {path}")
    if out is not None:
        print(
            f'{out.name}, filled, is calibrated with [data] file = "{out.name}", kind = "means" '
            "and [data.sd] accelerometer, the standard deviation of a mean"
        )


def _files(out: Path, *, force: bool) -> dict[str, Path]:
    from inercal.errors import InputError

    if out.suffix.lower() != ".csv":
        raise InputError(f"--out {out}: name a .csv; the page is written beside it")
    files = {"sheet": out, "page": out.with_suffix(".html")}
    for path in files.values():
        if path.is_dir():
            raise InputError(f"{path} is a folder; name another with --out")
        if path.exists() and not force:
            raise InputError(
                f"{path} exists: name another with --out, or write over it with --force"
            )
    return files


def _write(sheet: "Worksheet", files: Mapping[str, Path]) -> None:
    from inercal.design.on_head import as_csv
    from inercal.io.atomic import atomic_write
    from inercal.report import write_worksheet

    table = as_csv(sheet)
    with atomic_write(files["sheet"]) as temporary:
        temporary.write_text(table, encoding="utf-8")
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
        "expected": [_known(one) for one in sheet.expected],
        "together": [_known(one) for one in sheet.together],
    }


def _known(one: "Known") -> dict[str, Any]:
    from inercal.sensors import SI_UNITS

    return {"name": one.name, "std": one.std, "unit": SI_UNITS[one.unit]}


def _print(sheet: "Worksheet") -> None:
    from rich.console import Console

    console = Console()
    _print_rows(sheet, console)
    _print_known(sheet, console)
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


def _print_known(sheet: "Worksheet", console: "Console") -> None:
    from rich.table import Table

    from inercal.calibration.verdict import COVERAGE
    from inercal.units import digits

    run = sheet.run
    table = Table(title=f"to expect of {run.sensor.name}: {run.method.name}, {run.estimator}")
    table.add_column("coefficient")
    table.add_column("meaning")
    table.add_column("U (k = 2)", justify="right")
    table.add_column("unit")
    for part in (sheet.expected, sheet.together):
        for one in part:
            expanded = digits(0.0, COVERAGE * one.std / one.size)[1]
            table.add_row(one.name, one.meaning, expanded, one.unit)
        table.add_section()
    console.print(table)
