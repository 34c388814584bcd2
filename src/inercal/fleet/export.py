"""Results of a fleet as one table: a row a sensor, value and U of each coefficient in its unit."""

import csv
import math
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, cast

from inercal.errors import InputError
from inercal.fleet import results
from inercal.fleet.line import Line
from inercal.io.atomic_files import atomic_write
from inercal.uncertainty.coverage import COVERAGE

COLUMNS = (
    "id", "recording", "lot", "station", "measured", "status", "error", "grade", "conformity",
    "chi2", "dof", "recording_sha256",
)  # fmt: skip
SUFFIXES = (".csv", ".parquet")


def export_table(line: Line, folder: Path, path: Path) -> int:
    """Write the results of a line as a CSV or Parquet table; return the number of sensors.

    Parameters
    ----------
    line : Line
        Its sensors are written; those that it lacks are left out.
    folder : Path
        Of the parts.
    path : Path
        Its suffix says the format.

    Raises
    ------
    InputError
        Another suffix, no results, or the file cannot be written.
    """
    if path.suffix not in SUFFIXES:
        raise InputError(f"{path}: the suffix must be {' or '.join(SUFFIXES)}", file=path)
    columns = (*COLUMNS, "table", "coefficients", "value", "std")
    by_id = {row.id: row for row in line.rows}
    rows = [r for r in results.read_results(folder, columns).to_pylist() if r["id"] in by_id]
    if not rows:
        raise InputError(f"{folder}: no results; calibrate the line first", file=folder)
    # One sensor of each set of coefficients says their units.
    sets = {row["coefficients"]: by_id[row["id"]] for row in rows if row["coefficients"]}
    units: dict[str, tuple[str, float]] = {}
    for names, one in sets.items():
        sensor = line.run(one).sensor.with_coefficients(*names.split())
        terms = [sensor.coefficient(name) for name in sensor.coefficients]
        units |= dict(zip(sensor.coefficients, [(t.unit, t.si) for t in terms], strict=True))
    table = [_wide_row(row, units) for row in rows]
    with atomic_write(path) as temporary:
        if path.suffix == ".csv":
            with temporary.open("w", encoding="utf-8", newline="") as file:
                writer = csv.DictWriter(file, list(table[0]))
                writer.writeheader()
                writer.writerows(
                    {name: "" if one != one else one for name, one in row.items()} for row in table
                )
        else:
            arrow: Any = import_module("pyarrow")
            parquet: Any = import_module("pyarrow.parquet")
            parquet.write_table(arrow.Table.from_pylist(table), temporary)
    return len(table)


def _wide_row(row: Mapping[str, Any], units: Mapping[str, tuple[str, float]]) -> dict[str, Any]:
    wide: dict[str, Any] = {name: row[name] for name in COLUMNS}
    wide |= dict(cast("list[tuple[str, str]]", row["table"] or []))
    names: Sequence[str] = (row["coefficients"] or "").split()
    values = dict(zip(names, zip(row["value"] or (), row["std"] or (), strict=True), strict=True))
    for name, (unit, si) in units.items():
        value, std = values.get(name, (math.nan, math.nan))
        wide[f"{name} [{unit}]"] = value / si
        wide[f"U({name}) [{unit}]"] = COVERAGE * std / si
    return wide
