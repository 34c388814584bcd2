"""Export the results of a fleet: one table with a row per sensor, or one file per sensor."""

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from inercal.basics.atomic_files import atomic_write, atomic_write_all, make_folder
from inercal.basics.errors import InputError
from inercal.basics.visible_text import spreadsheet_cell
from inercal.calibration import Calibration
from inercal.calibration.files import marked_as_outdated, parse
from inercal.estimation.uncertainty import COVERAGE
from inercal.fleet import results
from inercal.fleet.latest import OUTDATED, latest_results, latest_rows_by_part
from inercal.fleet.line import RECORDING, Line, SensorRow
from inercal.fleet.status import same_recordings, shared_with

COLUMNS = (
    "id", "recording", "lot", "station", "measured", "status", "error", "grade", "verdict",
    "conformity", "beyond", "chi2", "dof", "recording_sha256", OUTDATED,
)  # fmt: skip
SUFFIXES = (".csv", ".parquet")


def export_table(line: Line, folder: Path, path: Path) -> dict[str, str]:
    """Write the results of a line as a CSV or Parquet table.

    Return, by sensor, the reason why its result is outdated; empty if the result is not outdated.
    Sensors that were calibrated from the same readings get an `error` and no `conformity`.

    Parameters
    ----------
    line : Line
        The line; the table contains only its sensors.
    folder : Path
        Folder with the parts of the results.
    path : Path
        File to write; its suffix determines the format.

    Raises
    ------
    InputError
        The suffix is unknown, there are no results, or the file cannot be written.
    """
    if path.suffix not in SUFFIXES:
        raise InputError(f"{path}: the suffix must be {' or '.join(SUFFIXES)}", file=path)
    columns = (*COLUMNS, "coefficients", "value", "std", "readings")
    by_id = {row.id: row for row in line.rows}
    rows = latest_results(line, folder, columns).to_pylist()
    if not rows:
        raise InputError(f"{folder} contains no results; calibrate the line first", file=folder)
    shared = shared_with(same_recordings(line, rows))
    for row in rows:
        if others := shared.get(row["id"]):
            what = f"calibrated from the same readings as {others}"
            row |= {"error": what, "conformity": None, "beyond": None}
    # The units of a set of coefficients come from one sensor with this set.
    sets = {row["coefficients"]: by_id[row["id"]] for row in rows if row["coefficients"]}
    units: dict[str, tuple[str, float]] = {}
    for names, one in sets.items():
        sensor = line.run(one).sensor.with_coefficients(*names.split())
        terms = [sensor.coefficient(name) for name in sensor.coefficients]
        units |= dict(zip(sensor.coefficients, [(t.unit, t.si) for t in terms], strict=True))
    table = [_wide_row(by_id[row["id"]], row, units) for row in rows]
    with atomic_write(path) as temporary:
        if path.suffix == ".csv":
            with temporary.open("w", encoding="utf-8", newline="") as file:
                writer = csv.writer(file)
                writer.writerow(map(_cell, table[0]))
                writer.writerows(map(_cell, row.values()) for row in table)
        else:
            arrow: Any = results.arrow()
            parquet: Any = results.arrow("pyarrow.parquet")
            parquet.write_table(arrow.Table.from_pylist(table), temporary)
    return {row["id"]: row[OUTDATED] for row in rows}


def _cell(value: Any) -> Any:
    """Return a cell for a CSV file: NaN becomes empty, and text is never read as a formula."""
    if isinstance(value, str):
        return spreadsheet_cell(value)
    return "" if value is None or value != value else value


def _wide_row(
    sensor: SensorRow, row: Mapping[str, Any], units: Mapping[str, tuple[str, float]]
) -> dict[str, Any]:
    wide: dict[str, Any] = {name: row[name] for name in COLUMNS}
    wide["verdict"] = (row["verdict"] or "").partition("\n")[0]
    if not row["arrived"]:
        wide[RECORDING] = sensor.recording
    # These columns come from the current table, because columns that do not affect a result may
    # have changed since then.
    wide |= sensor.columns
    names: Sequence[str] = (row["coefficients"] or "").split()
    values = dict(zip(names, zip(row["value"] or (), row["std"] or (), strict=True), strict=True))
    for name, (unit, si) in units.items():
        value, std = values.get(name, (math.nan, math.nan))
        wide[f"{name} [{unit}]"] = value / si
        wide[f"U({name}) [{unit}]"] = COVERAGE * std / si
    return wide


class FleetExport(NamedTuple):
    """The files that were exported from a fleet for a target.

    Parameters
    ----------
    files : tuple of Path
        The files that were written.
    without : mapping of str to str
        Reasons why sensors have no file, by id.
    unreliable : tuple of str
        Ids of the sensors that have a file although their calibration is not reliable.
    outdated : mapping of str to str
        Reasons why exported results are outdated, by id; the files state the same reasons.
    """

    files: tuple[Path, ...]
    without: Mapping[str, str]
    unreliable: tuple[str, ...]
    outdated: Mapping[str, str]


def export_files(
    line: Line,
    folder: Path,
    out: Path,
    to: str,
    *,
    options: Mapping[str, Any] | None = None,
    columns: Mapping[str, str] | None = None,
    axes: str = "x y z",
    lossless: bool = False,
    force: bool = False,
) -> FleetExport:
    """Write each sensor's calibration as a file for a target, named `ID.TARGET` plus suffix.

    Parameters
    ----------
    line : Line
        The line. All its sensors that have a calibration are written.
    folder : Path
        Folder with the parts of the results.
    out : Path
        Folder for the files.
    to : str
        Name of the target.
    options, axes, lossless
        See `export_calibration`; the values apply to all sensors.
    columns : mapping of str to str, optional
        Options of the target, such as the device id, and the columns in the table of sensors that
        contain their values.
    force : bool
        Whether to overwrite files.

    Raises
    ------
    InputError
        There are no results, a column is missing or empty, a file already exists, or the target
        cannot represent a sensor, which the message names. In each of these cases, no file is
        written.
    """
    from inercal.export import TARGETS, export_calibration

    target = TARGETS.find(to)
    if target.is_folder:
        raise InputError(
            f"target {to} writes a folder, but an export of a fleet has one file per sensor; save "
            "the calibration of one sensor with --sensor, and export it with inercal export",
            key="--to",
        )
    texts: dict[Path, str] = {}
    without: dict[str, str] = {}
    unreliable: list[str] = []
    outdated: dict[str, str] = {}
    by_id = {row.id: row for row in line.rows}
    inputs = line.input_files
    columns_read = ("status", "error", "grade", "calibration")
    for rows in latest_rows_by_part(line, folder, columns_read):
        for row in rows:
            if row["status"] != results.DONE:
                without[row["id"]] = row["error"] or row["status"]
                continue
            path = out / f"{row['id']}{target.file_suffix}"
            if path.exists() and (not force or path.resolve() in inputs):
                how = ", or use --force" if path.resolve() not in inputs else ""
                raise InputError(f"{path} already exists; give another folder{how}", file=path)
            if row["grade"] == "unreliable":
                unreliable.append(row["id"])
            if row[OUTDATED]:
                outdated[row["id"]] = row[OUTDATED]
            try:
                stated = dict(options or {}) | _from_columns(by_id[row["id"]], columns or {})
                calibration = marked_as_outdated(
                    parse(row["calibration"], row["id"]), row[OUTDATED]
                )
                made = export_calibration(
                    calibration,
                    to,
                    options=stated,
                    axes=axes,
                    lossless=lossless,
                    source=f"{row['id']}.calibration.json",
                )
            except InputError as error:
                raise error.located(f"sensor {row['id']}") from None
            texts[path] = made.text
    if not texts:
        raise InputError(
            f"{folder} contains no calibrated sensors; calibrate the line first", file=folder
        )
    make_folder(out)
    with atomic_write_all(list(texts)) as parts:
        for part, text in zip(parts, texts.values(), strict=True):
            part.write_text(text, encoding="utf-8")
    return FleetExport(tuple(texts), without, tuple(unreliable), outdated)


def sensor_calibration(line: Line, folder: Path, name: str) -> Calibration:
    """Return the calibration of a sensor; its provenance states whether it is outdated, and why.

    Raises
    ------
    InputError
        There is no such sensor, or it has no calibration.
    """
    sensor = tuple(row for row in line.rows if row.id == name)
    columns = ("status", "error", "calibration")
    parts = latest_rows_by_part(replace(line, rows=sensor), folder, columns)
    found = next((row for rows in parts for row in rows), None)
    if found is None:
        what = "it has no result yet; calibrate the line" if sensor else "it is not in the table"
        raise InputError(f"{folder}: sensor {name!r}: {what}", file=folder, names=(name,))
    if found["status"] != results.DONE:
        raise InputError(f"sensor {name!r} was not calibrated: {found['error']}").located(folder)
    return marked_as_outdated(parse(found["calibration"], name), found[OUTDATED])


def _from_columns(row: SensorRow, columns: Mapping[str, str]) -> dict[str, str]:
    known = {"id": row.id, **row.columns}
    for option, column in columns.items():
        if not known.get(column):
            raise InputError(
                f"the table of sensors has no {column!r} for --column {option}; it has "
                f"{', '.join(known)}",
                key="--column",
                names=(column,),
            )
    return {option: known[column] for option, column in columns.items()}
