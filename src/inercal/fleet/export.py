"""Results of a fleet as one table: a row a sensor, value and U of each coefficient in its unit."""

import csv
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, cast

from inercal.calibration import Calibration
from inercal.calibration.files import parse
from inercal.calibration.grade import COVERAGE
from inercal.errors import InputError
from inercal.fleet import results
from inercal.io.atomic_files import atomic_write

COLUMNS = (
    "id", "recording", "lot", "station", "measured", "status", "error", "grade", "conformity",
    "chi2", "dof", "recording_sha256",
)  # fmt: skip
SUFFIXES = (".csv", ".parquet")


def export_table(folder: Path, path: Path, names: Collection[str] | None = None) -> int:
    """Write the results of a fleet as a CSV or Parquet table; return the number of sensors.

    Parameters
    ----------
    folder : Path
        Of the parts.
    path : Path
        Its suffix says the format.
    names : collection of str, optional
        The sensors to write; all that have a result by default.

    Raises
    ------
    InputError
        Another suffix, no results, or the file cannot be written.
    """
    if path.suffix not in SUFFIXES:
        raise InputError(f"{path}: the suffix must be {' or '.join(SUFFIXES)}", file=path)
    columns = (*COLUMNS, "table", "coefficients", "value", "std")
    rows = results.read_results(folder, columns).to_pylist()
    if names is not None:
        rows = [row for row in rows if row["id"] in names]
    if not rows:
        raise InputError(f"{folder}: no results; calibrate the line first", file=folder)
    units = coefficient_units(folder, rows)
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


def coefficient_units(
    folder: Path, rows: Iterable[Mapping[str, Any]]
) -> dict[str, tuple[str, float]]:
    """Return the usual unit of each coefficient of the rows and its size in SI, by name."""
    units: dict[str, tuple[str, float]] = {}
    seen: set[str] = set()
    for row in rows:
        names = row["coefficients"]
        if not names or names in seen:
            continue
        seen.add(names)
        sensor = first_calibration(folder, row["id"]).sensor
        for name in names.split():
            term = sensor.coefficient(name)
            units[name] = term.unit, term.si
    return units


def first_calibration(folder: Path, name: str) -> Calibration:
    """Return the calibration of a sensor."""
    return parse(results.calibration_text(folder, name), str(folder))


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
