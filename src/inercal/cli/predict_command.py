"""`inercal predict`: error and uncertainty of a calibrated sensor at operating points."""

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from inercal.basics.atomic_files import write_text
from inercal.basics.errors import InputError, error_location
from inercal.cli import console
from inercal.cli.options import Force, Json, flag, optional, out_option, repeated
from inercal.cli.outputs import PAGE, PREDICTIONS, check_outputs, require_suffix, source_files

if TYPE_CHECKING:
    from inercal.calibration.prediction import Prediction

_LEAST_SHARE = 0.005  # smallest share that is printed


def run(
    calibration_file: Path = typer.Argument(help="A *.calibration.json file."),
    at: list[str] = repeated(
        'A point, such as "f = 0.5 g, -1 g, 0; w = 0, 0, 30 °/s; T = 40 °C"; m is the field.'
    ),
    points: Path | None = optional(
        "A table of points: columns fx \\[g], …, wx \\[°/s], …, mx \\[µT], …, T \\[°C]."
    ),
    sweep: str = typer.Option(
        "", help='A part that varies, such as "fx = -1 g … 1 g"; --at states the other parts.'
    ),
    out: Path | None = out_option("File to write: .csv of --points, .html with plots of --sweep."),
    extrapolate: bool = flag(
        "--extrapolate",
        "Also accept points outside the validity; U then includes undetectable effects.",
    ),
    force: Force = False,
    json: Json = False,
) -> None:
    """Predict the raw error and the uncertainty after correction at operating points."""
    from inercal.calibration.files import load

    if (points is None) != bool(at or sweep) or (sweep and len(at) > 1):
        raise InputError("give --at, or --points, or --sweep with at most one --at", key="--at")
    if out is None and not (at and not sweep):
        raise InputError("name the file to write with --out", key="--out")
    calibration = load(calibration_file)
    if out is not None:
        require_suffix(out, ".html" if sweep else ".csv")
        inputs = source_files(out, calibration_file, calibration.provenance)
        inputs.append(points or calibration_file)
        check_outputs({out: PAGE if sweep else PREDICTIONS}, inputs, force=force)
    from inercal.basics.documents import record_object
    from inercal.pipeline.operating_points import (
        points_from_table,
        points_from_texts,
        prediction_columns,
        swept_points,
    )

    name = ""
    chosen = points_from_texts(at, calibration) if points is None else points_from_table(points)
    if sweep:
        name, chosen = swept_points(sweep, chosen)
    with error_location(f"{points or calibration_file}"):
        found = calibration.predict(**chosen, extrapolate=extrapolate)
    if sweep and out is not None:
        from inercal.report import report_packages

        with report_packages():
            from inercal.report.budget_page import prediction_page
        write_text(out, prediction_page(calibration, found, name))
    elif out is not None:
        from inercal.recordings.io.mean_tables import write_means

        write_means(out, prediction_columns(found))
    verdict = calibration.verdict
    if verdict is not None and verdict.grade == "unreliable":
        console.report_line(f"warning: {calibration_file} is {verdict.word}")
    if json:
        more = {"expanded": found.expanded.tolist(), "file": None if out is None else str(out)}
        parts = {name: one for name, one in record_object(found).items() if one is not None}
        console.print_json(parts | more)
        return
    for j in range(len(found.outside) if out is None else 0):
        _print_point(found, j)
    console.print_lines(found.remarks)
    if out is not None:
        console.print_written_files([out])


def _print_point(found: "Prediction", j: int) -> None:
    """Print the quantities of a point, the shares of all causes, and the validity."""
    from math import isfinite

    from inercal.basics.units import format_quantity
    from inercal.estimation.uncertainty import COVERAGE
    from inercal.pipeline.operating_points import point_text, quantity_cells

    console.print_line(point_text(found, j), "bold")
    console.print_table(
        ("", ">reading", ">raw error", ">corrected ± U (k = 2)"),
        ((name, *quantity_cells(found, j, k)) for k, name in enumerate(found.names)),
    )
    shares: list[tuple[str, ...]] = []
    for causes in (found.groups, found.bench, found.effects):
        for name, share in causes.items():
            if abs(share[j]).max() >= _LEAST_SHARE:
                percent = (f"{round(100 * x) + 0} %" for x in share[j].tolist())
                shares.append((name, *(cell.replace("-", "−") for cell in percent)))
        shares.append(())
    console.print_table(("share of u²", *(f">{name}" for name in found.names)), shares)
    if found.heading_std is not None and isfinite(found.heading_std[j]):
        heading = format_quantity(COVERAGE * float(found.heading_std[j]), 0.0, "°", 2)
        console.print_line(f"Magnetic heading from the corrected f and m: U = {heading} (k = 2).")
    console.print_lines(f"Outside the validity: {one.text}." for one in found.outside[j])
    if not found.outside[j]:
        console.print_line("Inside the ranges that the calibration states.")
    elif found.effects:
        console.print_line("U includes the effects in the last rows, which the data cannot show.")


__all__ = ["run"]
