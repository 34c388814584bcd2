"""Qualifications of a bench for the terminal."""

from collections.abc import Sequence
from datetime import UTC, datetime
from math import sqrt
from typing import TYPE_CHECKING

import numpy as np

from inercal.basics.units import format_value_and_uncertainty, si_factor
from inercal.benches.qualification import Qualification
from inercal.benches.qualification.result import ANY_BENCH
from inercal.benches.qualification.succession import ParameterDrift
from inercal.cli.calibration_view import print_line
from inercal.cli.tables import add_row, make_table, number_columns
from inercal.cli.terminal import terminal

if TYPE_CHECKING:
    from inercal.laboratory.store.qualification_uses import (
        QualificationUse,  # needs the extra "store"
    )

_SHOWN = {"rad": "″", "1": "ppm", "(m/s²)⁻¹": "ppm/g", "m": "mm", "m/s²": "m/s²", "s": "ms"}
_LARGEST_CORRELATION = 0.05  # that is left out


def print_qualification(found: Qualification) -> None:
    """Print the parameters with U, their correlations, the tests and what was not seen."""
    place = "the place" if found.bench == ANY_BENCH else f"{found.bench} {found.bench_name}".strip()
    ends = f", valid until {found.valid_until}" if found.valid_until else ""
    print_line(f"{found.kind} of {place}, {found.date}{ends}: {found.method}")
    table = make_table("parameter", *number_columns(("value", "U (k = 2)")), "unit", "from")
    for one, u in zip(found.parameters, found.std, strict=True):
        unit = _SHOWN.get(one.unit, one.unit)
        si = si_factor(unit)
        value, expanded = format_value_and_uncertainty(one.value / si, 2 * float(u) / si)
        earlier = one.determination != found.determination
        add_row(table, one.name, value, expanded, unit, f"{one.date} (earlier)" if earlier else "")
    terminal().print(table)
    correlation = found.covariance / np.outer(found.std, found.std)
    for i, name in enumerate(found.names):
        for j in range(i):
            if abs(correlation[i, j]) > _LARGEST_CORRELATION:
                print_line(f"· correlation of {found.names[j]} and {name}: {correlation[i, j]:.3f}")
    if found.dof:
        print_line(
            f"· χ² {found.chi2:.4g} with {found.dof} degrees of freedom (p {found.p_value:.2g})"
        )
    for one in found.suspects:
        print_line(f"· does not agree with the model: {one}")
    for one in found.remarks:
        print_line(f"· {one}")
    for one in found.unseen:
        print_line(f"· not seen: {one}")
    if found.expired_parameters(datetime.now(UTC).date()):
        print_line(f"· expired on {found.valid_until}")
    if found.withdrawn:
        print_line(f"· withdrawn, {found.withdrawn}")


def print_drift(
    earlier: Qualification, later: Qualification, found: Sequence[ParameterDrift]
) -> None:
    """Print the difference of two qualifications, and the random walk between them."""
    days = (later.date - earlier.date).days
    print_line(f"{later.kind} of {later.bench} {later.bench_name}: {days} days between")
    heads = number_columns(("difference", "u", "√q a year", "at most", "u after a year"))
    table = make_table("parameter", *heads, "unit")
    for one in found:
        unit = _SHOWN.get(one.unit, one.unit)
        si = si_factor(unit)
        sizes = (one.difference, one.std, sqrt(one.walk), sqrt(one.upper), one.u_year)
        add_row(table, one.name, *(f"{x / si:.3g}" for x in sizes), unit)
    terminal().print(table)


def print_uses(found: Qualification, register: str, uses: "Sequence[QualificationUse]") -> None:
    """Print the calibrations and certificates that used a withdrawn qualification."""
    print_line(f"withdrawn, {found.withdrawn}: {found.kind} of {found.date}")
    if not uses:
        print_line(f"no calibration in {register} used it")
        return
    table = make_table("calibration", "sensor", "measured", "parameters", "certificates")
    for one in uses:
        add_row(
            table,
            f"#{one.calibration}",
            one.sensor,
            one.measured[:10],
            ", ".join(one.parameters),
            ", ".join(one.certificates),
        )
    terminal().print(table)
