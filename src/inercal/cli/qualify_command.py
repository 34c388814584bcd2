"""`inercal qualify`: find parameters of a bench from a separate measurement."""

from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from math import sqrt
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from inercal.basics.errors import InputError
from inercal.basics.units import format_count, format_number
from inercal.cli import console
from inercal.cli.options import Force, Json, RegisterOption, flag, optional, out_option
from inercal.cli.outputs import QUALIFICATION, check_outputs

if TYPE_CHECKING:
    from inercal.benches.qualification import Qualification
    from inercal.benches.qualification.result import ParameterDrift
    from inercal.laboratory.store.uses import QualificationUse

_SHOWN = {"rad": "″", "1": "ppm", "(m/s²)⁻¹": "ppm/g", "m": "mm", "m/s²": "m/s²", "s": "ms"}
_LARGEST_CORRELATION = 0.05  # smallest correlation that is printed


def run(
    files: list[Path] = typer.Argument(
        help="Input file with \\[qualification] and \\[measurement]; with --drift, the earlier "
        "and the later qualification.",
        metavar="FILE…",
    ),
    out: Path | None = out_option("The qualification to write, *.qualification.json."),
    force: Force = False,
    drift: bool = flag("--drift", "Compare two successive qualifications of one bench."),
    withdraw: str | None = optional(
        "Withdraw a qualification: mark the file, and list the calibrations that used it.",
        metavar="REASON",
    ),
    register: RegisterOption = None,
    json: Json = False,
) -> None:
    r"""Qualify a bench: find its parameters and their covariance for \[bench] qualification."""
    if drift and withdraw is not None:
        raise InputError("--drift and --withdraw exclude each other: give one", key="--drift")
    wanted = 2 if drift else 1
    if len(files) != wanted:
        raise InputError(f"{format_count(len(files), 'file is', 'files are')} given; give {wanted}")
    if register is not None and withdraw is None:
        raise InputError("--register works only with --withdraw; remove it", key="--register")
    if out is not None and (drift or withdraw is not None):
        raise InputError("--out works only with a measurement; remove it", key="--out")
    if drift:
        _drift(files, json)
    elif withdraw is not None:
        _withdraw(files[0], withdraw, register, json)
    else:
        _qualify(files[0], out, force, json)


def _qualify(file: Path, out: Path | None, force: bool, json: bool) -> None:
    from inercal.benches.qualification.input_file import input_files, qualify
    from inercal.benches.qualification.result import qualification_object, save

    if out is not None:
        check_outputs({out: QUALIFICATION}, input_files(file), force=force)
    found = qualify(file)
    if out is not None:
        save(found, out)
    if json:
        console.print_json(qualification_object(found))
    else:
        _print_qualification(found)
        if out is not None:
            print(f"wrote {out}")
    console.exit_if(not found.consistent)


def _drift(files: list[Path], json: bool) -> None:
    from inercal.benches.qualification.result import drift_between, load

    earlier, later = map(load, files)
    found = drift_between(earlier, later)
    if json:
        console.print_json({"drift": [one._asdict() for one in found]})
        return
    _print_drift(earlier, later, found)


def _withdraw(file: Path, reason: str, address: str | None, json: bool) -> None:

    from inercal.benches.qualification.result import load, save
    from inercal.laboratory.store.uses import qualification_uses

    found = load(file)
    if not reason.strip() and not found.withdrawn:
        raise InputError("--withdraw: the reason is empty; give one", key="--withdraw")
    with console.open_register(address, create=False) as opened:
        uses = qualification_uses(opened, found.determination)
        place = opened.address
    if not found.withdrawn:
        day = datetime.now(UTC).date()
        found = replace(found, withdrawn=f"{day}: {' '.join(reason.split())}")
        save(found, file)
    if json:
        console.print_json(
            {
                "determination": found.determination,
                "withdrawn": found.withdrawn,
                "register": place,
                "uses": [one._asdict() for one in uses],
            }
        )
        return
    _print_uses(found, place, uses)


def _print_qualification(found: "Qualification") -> None:
    """Print the parameters with U, their correlations, the tests and undetectable effects."""
    import numpy as np

    from inercal.basics.units import format_value_and_uncertainty
    from inercal.benches.qualification.result import ANY_BENCH

    place = "the site" if found.bench == ANY_BENCH else f"{found.bench} {found.bench_name}".strip()
    ends = f", valid until {found.valid_until}" if found.valid_until else ""
    console.print_line(f"{found.kind} of {place}, {found.date}{ends}: {found.method}")
    rows: list[tuple[str, ...]] = []
    for one, u in zip(found.parameters, found.std, strict=True):
        unit, si = _shown_unit(one.unit)
        shown = format_value_and_uncertainty(one.value / si, 2 * float(u) / si)
        earlier = one.determination != found.determination
        rows.append((one.name, *shown, unit, f"{one.date} (earlier)" if earlier else ""))
    console.print_table(("parameter", ">value", ">U (k = 2)", "unit", "from"), rows)
    correlation = found.covariance / np.outer(found.std, found.std)
    lines = [
        f"correlation of {found.names[j]} and {name}: {correlation[i, j]:.3f}"
        for i, name in enumerate(found.names)
        for j in range(i)
        if abs(correlation[i, j]) > _LARGEST_CORRELATION
    ]
    if found.dof:
        lines.append(
            f"χ² = {found.chi2:.4g} with {found.dof} degrees of freedom, p = {found.p_value:.2g}"
        )
    lines += [f"inconsistent with the model: {one}" for one in found.suspects]
    lines += found.remarks
    lines += [f"not detectable: {one}" for one in found.unseen]
    if found.expired_parameters(datetime.now(UTC).date()):
        lines.append(f"expired on {found.valid_until}")
    if found.withdrawn:
        lines.append(f"withdrawn, {found.withdrawn}")
    console.print_lines(lines, "· ")


def _shown_unit(unit: str) -> tuple[str, float]:
    """Return the unit for printing a parameter, and its size in SI units."""
    from inercal.basics.units import si_factor

    shown = _SHOWN.get(unit, unit)
    return shown, si_factor(shown)


def _print_drift(
    earlier: "Qualification", later: "Qualification", found: "Sequence[ParameterDrift]"
) -> None:
    """Print the difference between two qualifications, and the random walk between them."""
    days = (later.date - earlier.date).days
    console.print_line(
        f"{later.kind} of {later.bench} {later.bench_name}: {format_count(days, 'day')} between"
    )
    rows: list[tuple[str, ...]] = []
    for one in found:
        unit, si = _shown_unit(one.unit)
        sizes = (one.difference, one.std, sqrt(one.walk), sqrt(one.upper), one.u_year)
        rows.append((one.name, *(format_number(x / si, 3) for x in sizes), unit))
    numbers = (">difference", ">u", ">√q a year", ">at most", ">u after a year")
    console.print_table(("parameter", *numbers, "unit"), rows)


def _print_uses(found: "Qualification", register: str, uses: "Sequence[QualificationUse]") -> None:
    """Print the calibrations and certificates that used a withdrawn qualification."""
    console.print_line(f"withdrawn, {found.withdrawn}: {found.kind} of {found.date}")
    if not uses:
        console.print_line(f"no calibration in {register} used it")
        return
    console.print_table(
        ("calibration", "sensor", "measured", "parameters", "certificates"),
        [
            (f"#{one.calibration}", one.sensor, one.measured[:10], ", ".join(one.parameters),
             ", ".join(one.certificates))
            for one in uses
        ],
    )  # fmt: skip
