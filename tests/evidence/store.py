"""The stored table: docs/evidence/violations.json and the page beside it."""

import json
import math
import platform
import subprocess
from dataclasses import asdict
from importlib.metadata import version
from os import cpu_count
from pathlib import Path

from tests.evidence import cannot_tell, tables_of
from tests.evidence.cells import Cell, Count

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs" / "evidence"
DATA, PAGE = FOLDER / "violations.json", FOLDER / "violations.md"
_PAGE = """\
# Violations: what is noticed, counted

Written by `make evidence`; do not edit. Each cell is 40 devices with errors drawn as stated, made
by generators that know nothing of inercal, with one thing that the stated model leaves out. η is
the norm of the whitened residual that it leaves after the fit, computed apart from inercal; at
η = 6 a test at the level of the verdict notices it in nearly all devices. "5 u" is the size that
shifts some coefficient by five standard uncertainties. What η < 6 leaves unsaid is listed in
[what the data cannot tell](../reference/what-the-data-cannot-tell.md).

Seeds: 1 for violations; 1, 2 and 3 for base cases of 300 devices each. Commit {commit}; {machine}.

{summary}

## All cells

{table}
"""


def machine() -> str:
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


def commit() -> str:
    """Return the commit, with a + where the tree has changes in the source."""

    def git(*words: str) -> str:
        done = subprocess.run(
            ["git", *words], cwd=ROOT, capture_output=True, text=True, check=False
        )
        return done.stdout.strip()

    changed = "+" if git("status", "--porcelain", "--", "src", "tests") else ""
    return (git("rev-parse", "--short=12", "HEAD") or "unknown") + changed


def write(counted: dict[Cell, Count]) -> None:
    """Write the table as data and as a page, and the page of what the data cannot tell."""
    FOLDER.mkdir(exist_ok=True)
    cells = [
        {
            key: None if isinstance(value, float) and math.isnan(value) else value
            for key, value in (asdict(cell) | asdict(one)).items()
        }
        for cell, one in counted.items()
    ]
    made = {"commit": commit(), "machine": machine()}
    lines = ",\n".join("  " + json.dumps(cell, ensure_ascii=False) for cell in cells)
    head = json.dumps(made, ensure_ascii=False)[:-1]
    DATA.write_text(f'{head}, "cells": [\n{lines}\n]}}\n', encoding="utf-8")
    page = _PAGE.format(summary=tables_of.summary(counted), table=tables_of.text(counted), **made)
    PAGE.write_text(page, encoding="utf-8")
    cannot_tell.write()


def read() -> list[tuple[Cell, Count]]:
    """Return the stored cells with their counts."""
    stored = json.loads(DATA.read_text(encoding="utf-8"))["cells"]
    names = set(Cell.__dataclass_fields__)
    found: list[tuple[Cell, Count]] = []
    for row in stored:
        whole = {key: math.nan if value is None else value for key, value in row.items()}
        own = {key: value for key, value in whole.items() if key in names}
        rest = {key: value for key, value in whole.items() if key not in names}
        found.append((Cell(**own), Count(**rest)))
    return found
