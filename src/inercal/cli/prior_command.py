"""`inercal prior`: estimate the prior of a new sensor from earlier sensors of its type."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from inercal.basics.errors import InputError
from inercal.cli import console
from inercal.cli.options import Force, Json, RegisterOption, flag, optional, out_option
from inercal.cli.outputs import TYPE_PRIOR, check_outputs, require_suffix

if TYPE_CHECKING:
    from inercal.calibration import Calibration
    from inercal.calibration.type_prior import TypePrior


def run(
    files: list[Path] | None = typer.Argument(
        None, help="Calibration files of different sensors of one type.", metavar="FILE…"
    ),
    register: RegisterOption = None,
    type_name: str | None = optional(
        "Maker and model as in \\[job], such as 'Q-Flex QA 2000': use the newest calibrations "
        "of these sensors in the register; replaces the files.",
        "--type",
    ),
    coefficients: list[str] | None = optional(
        "Coefficient or group, such as kip; repeatable. Default: all nonlinear and "
        "cross-coupling coefficients that all files have.",
        "--coefficients",
        "-c",
    ),
    without: list[str] | None = optional("Name of a sensor to leave out."),
    each_axis: bool = flag("--each-axis", "Treat each axis of a file as a sensor of its own."),
    out: Path | None = out_option("File to write, for prior_type in a run file: type.prior.toml."),
    force: Force = False,
    json: Json = False,
) -> None:
    """Estimate the prior of a new sensor from earlier sensors of its type."""
    if bool(files) == bool(type_name):
        raise InputError("give the calibrations in one way: files, or --type", key="--type")
    if files and register is not None:
        raise InputError("--register: name the type of the sensors with --type", key="--register")
    if out is not None:
        require_suffix(out, ".toml")
    from inercal.laboratory.store.uses import calibrations_of_type
    from inercal.laboratory.type_prior import type_prior

    inputs = files or []
    if out is not None:
        check_outputs({out: TYPE_PRIOR}, inputs, force=force)
    words = coefficients or ()
    chosen: Sequence[Path] | Mapping[str, Calibration] = inputs
    if type_name:
        with console.open_register(register, create=False) as opened:
            chosen = calibrations_of_type(opened.calibrations(), type_name, words)
    found = type_prior(
        chosen, words, without=without or (), each_axis=each_axis, type_name=type_name or ""
    )
    if out is not None:
        found.save(out)
    if json:
        console.print_json(found.to_object())
        return
    _print_prior(found)
    if out is not None:
        console.print_written_files([out])


def _print_prior(found: "TypePrior") -> None:
    """Print the coefficients of a new sensor, and the outlying sensors."""
    from inercal.basics.units import format_count, format_number
    from inercal.laboratory.type_prior import FALSE_ALARMS

    kind = ("sensor", "sensors") if found.count == len(found.sensor) else ("axis", "axes")
    console.print_line(
        f"{found.type_name or 'Prior of the type'}: a new {kind[0]}, predicted from "
        f"{format_count(found.count, *kind)}; ± U contains 95 % of new ones"
    )
    rows: list[tuple[str, ...]] = []
    for one in found.coefficient:
        term = found.term(one.name)
        sizes = [x / term.si for x in (one.mean, one.between_sensors, one.sd, 2 * one.sd)]
        cells = (*(format_number(x, 3) for x in sizes), format_number(one.dof, 2))
        rows.append((one.name, *cells, f"{100 * one.measurement_share:.0f} %", term.unit))
    heads = ("coefficient", ">mean", ">between sensors", ">new sensor", ">U", ">dof")
    console.print_table((*heads, ">due to measurement", "unit"), rows)
    console.print_lines(
        [
            f"outlying: {one.coefficient} of {one.sensor} (p = {one.p:.1g}). The sensor was used; "
            "check it, or leave it out with --without"
            for one in found.outlying
        ]
        or [f"no outlying sensor (a false alarm occurs in {100 * FALSE_ALARMS:g} % of cases)"],
        "· ",
    )
    console.print_lines(filter(None, (found.correlations, *found.notes)), "· ")
