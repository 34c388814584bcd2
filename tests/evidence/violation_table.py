"""Counts as text: the table of violations, and what the issue demands of it."""

import math
from collections.abc import Mapping

from scipy import stats
from tests.evidence.graded_calibration import TOTAL
from tests.evidence.violation_cells import (
    BASE,
    CASES,
    MIN_RIVAL_ANGLE,
    WITHOUT_SIZE,
    Cell,
    Count,
    find_case,
)

FEWEST, SHARE, NAMED, FALSE = 34 / 40, 0.95, 0.8, 18 / 900
_HEAD = (
    "| method | violation | at | size | η | nearest rival | not consistent | refused "
    "| cause first | cause in group | NEES |\n|" + "---|" * 11
)
Counts = Mapping[Cell, Count]


def format_number(x: float) -> str:
    """Return a number as a table has it."""
    if math.isnan(x):
        return "–"
    return "∞" if math.isinf(x) else f"{x:.3g}"


def cell_unit(cell: Cell) -> str:
    return next((v.unit for v in find_case(cell.case).violations if v.name == cell.violation), "")


def table_line(cell: Cell, one: Count) -> str:
    """Return one line of the table."""
    n = one.devices
    size = f"{format_number(cell.size)} {cell_unit(cell)}" if not math.isnan(cell.size) else ""
    cells = (
        cell.case,
        cell.violation or "none",
        cell.at,
        "" if cell.at == BASE else size,
        "" if cell.at == BASE else format_number(cell.eta),
        "" if cell.at in (BASE, WITHOUT_SIZE) else f"{cell.apart:.0f}°",
        f"{one.noticed} of {n}",
        str(one.refused),
        "" if cell.at in (BASE, WITHOUT_SIZE) else f"{one.first} of {n}",
        "" if cell.at in (BASE, WITHOUT_SIZE) else f"{one.group} of {n}",
        format_number(one.nees),
    )
    return "| " + " | ".join(cells) + " |"


def table_text(counted: Counts) -> str:
    """Return the table."""
    return "\n".join([_HEAD, *(table_line(cell, one) for cell, one in counted.items())])


def missed_cells(counted: Counts) -> list[tuple[Cell, Count]]:
    """Return visible cells in which fewer than 34 of 40 devices were not called consistent."""
    return [
        (cell, one)
        for cell, one in counted.items()
        if cell.visible and one.noticed < FEWEST * one.devices
    ]


def demand_summary(counted: Counts) -> str:
    """Return the demands with their figures."""
    named = {
        (name, v.name) for name in CASES for v in find_case(name).violations if v.suspects
    }  # of the others the sensor's model and the bench have no quantity
    visible = [one for cell, one in counted.items() if cell.visible and cell.at != BASE]
    apart = [
        one
        for cell, one in counted.items()
        if cell.visible
        and cell.at not in (BASE, WITHOUT_SIZE)
        and cell.apart >= MIN_RIVAL_ANGLE
        and (cell.case, cell.violation) in named
    ]
    near = [
        one
        for cell, one in counted.items()
        if cell.visible
        and cell.at not in (BASE, WITHOUT_SIZE)
        and cell.apart < MIN_RIVAL_ANGLE
        and (cell.case, cell.violation) in named
    ]

    def share(ones: list[Count], what: str) -> str:
        total = sum(one.devices for one in ones)
        return f"{sum(getattr(one, what) for one in ones) / total:.3f}" if total else "–"

    gross = [one for cell, one in counted.items() if cell.at == WITHOUT_SIZE]
    lines = [
        "| what | figure | demanded |",
        "|---|---|---|",
        "| visible violations not called consistent, pooled "
        f"| {share(visible, 'noticed')} | ≥ {SHARE} |",
        f"| visible cells below 34 of 40 | {len(missed_cells(counted))} of {len(visible)} | 0 |",
        f"| mistakes without a size, not called consistent, pooled | {share(gross, 'noticed')} | |",
        f"| true cause first, rivals ≥ 30° away, pooled | {share(apart, 'first')} | ≥ {NAMED} |",
        f"| true cause in the named group, nearer rivals, pooled | {share(near, 'group')} | |",
    ]
    return "\n".join(lines)


def base_counts(counted: Counts) -> dict[str, Count]:
    """Return the base cells of each method together, by its name."""
    base: dict[str, Count] = {}
    for cell, one in counted.items():
        if cell.at == BASE:
            base[cell.case] = base.get(cell.case, Count()) + one
    return base


def uniformity(one: Count) -> dict[str, float]:
    """Return the p-value of Kolmogorov and Smirnov of each kind of stored p-values."""
    return {name: float(stats.kstest(p, "uniform").pvalue) for name, p in one.p_values.items() if p}


def base_table(counted: Counts) -> str:
    """Return the base cells: errors, p-values and false alarms of each method."""
    lines = [
        "| method | devices | NEES | p of χ² | p of the groups | false alarms | at most |",
        "|" + "---|" * 7,
    ]
    for name, one in base_counts(counted).items():
        coefficients = len(find_case(name).coefficients)
        chance = 3 * math.sqrt(2 / (coefficients * max(one.devices - one.refused, 1)))
        found = uniformity(one)
        groups = ", ".join(f"{key} {p:.3f}" for key, p in found.items() if key != TOTAL)
        lines.append(
            f"| {name} | {one.devices} | {one.nees:.3f} ± {chance:.3f} "
            f"| {f'{found[TOTAL]:.3f}' if TOTAL in found else '–'} | {groups} "
            f"| {one.noticed} ({100 * one.noticed / one.devices:.1f} %) "
            f"| {math.floor(FALSE * one.devices)} |"
        )
    return "\n".join(lines)
