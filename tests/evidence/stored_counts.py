"""The stored table: docs/evidence/violations.json and the page beside it."""

import json
import math
import platform
import subprocess
from collections.abc import Mapping
from dataclasses import asdict, fields
from importlib.metadata import version
from os import cpu_count
from pathlib import Path
from typing import Any

from tests.evidence import unobservable_causes, violation_table
from tests.evidence.violation_cells import BASE, CASES, Cell, Count

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs" / "evidence"
DATA, PAGE = FOLDER / "violations.json", FOLDER / "violations.md"
_PAGE = """\
# Violations: what is noticed, counted

Written by `make evidence`; do not edit. Each cell contains 40 devices whose errors were drawn as
stated. The devices were made by generators that are independent of inercal. In each cell, the
devices have one violation, which the stated model leaves out. η is the norm of the whitened
residuals that the violation leaves after the fit; it was computed without inercal. At η = 6, a test
at the level of the verdict notices the violation in nearly all devices. "5 u" is the size that
shifts some coefficient by five standard uncertainties. [What the data cannot
tell](../reference/what-the-data-cannot-tell.md) lists the violations that matter although η is
below 6.

The column "nearest rival" states the angle between the residuals that the violation leaves and the
residuals that the nearest other cause leaves. If this angle is below 30°, the verdict names both
causes together. NEES is the mean of (error)ᵀ covariance⁻¹ (error) over the number of coefficients.

Further causes have pages of their own: [coarse thermometers](temperature.md), [filters and
correlated noise](filtered-noise.md) and [magnetic distortion](magnetometer.md).

A filter or coarse steps of the readings may be counted as consistent: inercal then recognises them
and includes their errors in U, which the NEES of the cell shows.

Seeds: 1 for violations; 1, 2 and 3 for base cases, 300 devices each.

{summary}

## Base cases

In these devices, everything is as the run file states. NEES should be 1; the number behind ± is
three standard deviations of its scatter by chance. If χ² is computed correctly, its p-values over
all devices are uniformly distributed between 0 and 1. The column "p of χ²" is the p-value of a
Kolmogorov–Smirnov test of this. If a method tests its residuals in groups, the same test was made
for each group. A false alarm is a verdict other than "consistent".

{base}

## All cells

{table}

## Runs

{runs}
"""


def describe_machine() -> str:
    """Return cores, processor and versions; nothing that names the machine."""
    model = platform.processor() or platform.machine()
    try:
        for row in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if row.startswith("model name"):
                model = row.partition(":")[2].strip()
                break
    except OSError:
        pass
    versions = f"Python {platform.python_version()}, NumPy {version('numpy')}"
    return f"{cpu_count()} cores of {model}; {versions}, SciPy {version('scipy')}"


def current_commit() -> str:
    """Return the commit, with a + where the tree has changes in source or tests."""

    def git(*words: str) -> str:
        done = subprocess.run(
            ["git", *words], cwd=ROOT, capture_output=True, text=True, check=False
        )
        return done.stdout.strip()

    changed = "+" if git("status", "--porcelain", "--", "src", "tests") else ""
    return (git("rev-parse", "--short=12", "HEAD") or "unknown") + changed


def write_counts(counted: Mapping[Cell, Count]) -> None:
    """Write cells in the place of those stored, the pages with them.

    Of each method, its base cells are replaced where some are given, and so are its other cells.
    """
    made = {_part_of_table(cell) for cell in counted}
    run = {"commit": current_commit(), "machine": describe_machine()}
    before = _stored_rows() if DATA.exists() else {"runs": {}, "cells": []}
    parts = [(name, is_base) for name in CASES for is_base in (False, True)]
    runs: dict[str, Any] = {}
    for part in parts:
        # A base that was worked out together with the other cells has no run of its own.
        own, whole_method = _run_name(part), (part[0], False) in made
        stored = before["runs"].get(own)
        runs[own] = (None if part[1] and whole_method else run) if part in made else stored
    kept = [
        (c, one) for c, one in map(_cell_from_row, before["cells"]) if _part_of_table(c) not in made
    ]
    _write({name: one for name, one in runs.items() if one}, [*kept, *counted.items()])


def add_counts(counted: Mapping[Cell, Count]) -> None:
    """Write cells beside those that are stored; their run is stored as one of its own."""
    before = _stored_rows()
    run = {"commit": current_commit(), "machine": describe_machine()}
    added = {f"{cell.case}, cells added later": run for cell in counted}
    _write(before["runs"] | added, [*map(_cell_from_row, before["cells"]), *counted.items()])


def _write(runs: Mapping[str, Any], cells: list[tuple[Cell, Count]]) -> None:
    known = {name: k for k, name in enumerate(CASES)}
    whole = sorted(
        (one for one in cells if one[0].case in known),
        key=lambda one: (known[one[0].case], one[0].at != BASE),
    )
    lines = ",\n".join("  " + _row_text(cell, one) for cell, one in whole)
    head = json.dumps({"runs": runs}, ensure_ascii=False, indent=1)
    DATA.write_text(f'{head[:-2]},\n "cells": [\n{lines}\n]}}\n', encoding="utf-8")
    table = dict(whole)
    rows = ["| method | commit | machine |", "|---|---|---|"]
    rows += [f"| {k} | {v['commit']} | {v['machine']} |" for k, v in runs.items()]
    page = _PAGE.format(
        summary=violation_table.demand_summary(table),
        base=violation_table.base_table(table),
        table=violation_table.table_text(table),
        runs="\n".join(rows),
    )
    PAGE.write_text(page, encoding="utf-8")
    unobservable_causes.write_page(table)


def read_counts() -> list[tuple[Cell, Count]]:
    """Return the stored cells with their counts."""
    return [_cell_from_row(row) for row in _stored_rows()["cells"]]


def _stored_rows() -> dict[str, Any]:
    return json.loads(DATA.read_text(encoding="utf-8"))


def _part_of_table(cell: Cell) -> tuple[str, bool]:
    return cell.case, cell.at == BASE


def _run_name(part: tuple[str, bool]) -> str:
    name, is_base = part
    return f"{name}, base cases only" if is_base else name


def _row_text(cell: Cell, one: Count) -> str:
    row = asdict(cell) | asdict(one)
    if not one.p_values:
        del row["p_values"]
    sure = {k: None if isinstance(v, float) and math.isnan(v) else v for k, v in row.items()}
    return json.dumps(sure, ensure_ascii=False)


def _cell_from_row(row: dict[str, Any]) -> tuple[Cell, Count]:
    whole: dict[str, Any] = {k: math.nan if v is None else v for k, v in row.items()}
    own = {field.name for field in fields(Cell)}
    if "p_values" in whole:
        whole["p_values"] = {name: tuple(p) for name, p in whole["p_values"].items()}
    return (
        Cell(**{k: v for k, v in whole.items() if k in own}),
        Count(**{k: v for k, v in whole.items() if k not in own}),
    )
