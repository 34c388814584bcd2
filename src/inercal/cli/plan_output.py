"""What plans of a bench have in common: files to write, and what will be known."""

from collections.abc import Sequence
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

from inercal.cli.console import number_column, print_written_files, refuse_overwrite

if TYPE_CHECKING:
    from rich.console import Console

    from inercal.design.expected_uncertainty import ExpectedUncertainty
    from inercal.runfile import Run


def output_files(out: Path, *, page: bool, force: bool) -> dict[str, Path]:
    """Return the files to write, "sheet" and, if there is one, "page".

    Raises
    ------
    InputError
        A name that is no .csv, a folder, or a file that exists, unless by `force`.
    """
    from inercal.errors import InputError

    if out.suffix.lower() != ".csv":
        beside = "; the page is written beside it" if page else ""
        raise InputError(f"--out {out}: name a .csv{beside}")
    files = {"sheet": out} | ({"page": out.with_suffix(".html")} if page else {})
    for path in files.values():
        if path.is_dir():
            raise InputError(f"{path} is a folder; name another with --out")
        refuse_overwrite(path, force=force)
    return files


def print_sheet_files(files: dict[str, Path]) -> None:
    """Say which files were written, and how the table is used."""
    print_written_files(files)
    if "sheet" in files:
        name = files["sheet"].name
        print(
            f'{name}, filled, is calibrated with [data] file = "{name}", kind = "means" '
            "and [data.sd] accelerometer, the standard deviation of a mean"
        )


def uncertainty_as_object(one: "ExpectedUncertainty") -> dict[str, Any]:
    """Return a coefficient and its expected uncertainty for JSON, SI."""
    from inercal.sensors import SI_UNITS

    std = one.std if isfinite(one.std) else None
    return {"name": one.name, "std": std, "unit": SI_UNITS[one.unit]}


def print_uncertainties(
    run: "Run", parts: Sequence[Sequence["ExpectedUncertainty"]], console: "Console"
) -> None:
    """Print the expected uncertainties, part by part."""
    from rich.table import Table

    from inercal.calibration.verdict import COVERAGE
    from inercal.units import format_value_and_uncertainty

    title = f"to expect of {run.sensor.name}: {run.method.name}, {run.estimator}"
    table = Table("coefficient", "meaning", number_column("U (k = 2)"), "unit", title=title)
    for part in parts:
        for one in part:
            known = isfinite(one.std)
            expanded = (
                format_value_and_uncertainty(0.0, COVERAGE * one.std / one.size)[1]
                if known
                else "—"
            )
            table.add_row(one.name, one.meaning, expanded, one.unit)
        table.add_section()
    console.print(table)
