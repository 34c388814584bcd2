"""Select the valid result for each sensor.

If a sensor has several results, a result from the current run file and recording is preferred.
Among the others, a calibration is preferred to a failure, and then the latest generation is
preferred. If a new calibration might differ from a result, the result is marked as outdated, with
the reason.
"""

import json
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from inercal.calibration.files import OUTDATED, parse
from inercal.fleet.inputs import COMPARED, SensorInputs, line_inputs, result_difference
from inercal.fleet.line import Line
from inercal.fleet.results import DONE, Table, arrow, part_paths, read_part, schema

if TYPE_CHECKING:  # only `enter_results` needs a register
    from inercal.laboratory.store import Register

_ENTERED = ("status", "calibration", "measured")
_COUNTED_BY = ("id", "status", "generation", *COMPARED)
_NAMES = 3  # largest number of outdated sensors that are listed


def latest_results(
    line: Line,
    folder: Path,
    columns: Iterable[str] | None = None,
    now: Mapping[str, SensorInputs] | None = None,
) -> Table:
    """Return the valid result for each sensor of a line, sorted by id.

    The column `OUTDATED` states why a new calibration might give a different result. It is empty if
    a new calibration would give the same result.

    Parameters
    ----------
    line : Line
    folder : Path
        Folder with the parts of the results; it need not exist.
    columns : iterable of str, optional
        Columns to read, in addition to the columns that decide which result is valid.
    now : mapping of str to SensorInputs, optional
        Result of `line_inputs`, if it is already known.

    Raises
    ------
    InputError
        A part is damaged.
    """
    pa: Any = arrow()
    wanted = None if columns is None else (*_COUNTED_BY, *columns)
    tables = [read_part(path, wanted) for path in part_paths(folder)]
    counting = _counting_rows(line, tables, line_inputs(line) if now is None else now)
    fields = [one for one in schema() if wanted is None or one.name in wanted]
    chosen = [pa.schema([*fields, (OUTDATED, pa.string())]).empty_table()]
    for table, rows in zip(tables, counting, strict=True):
        reasons = pa.array(rows.values(), pa.string())
        taken = table.take(pa.array(rows, pa.int64()))
        chosen.append(taken.append_column(OUTDATED, reasons))
    return pa.concat_tables(chosen).sort_by("id")


def latest_rows_by_part(
    line: Line, folder: Path, columns: Iterable[str]
) -> Iterator[list[dict[str, Any]]]:
    """Yield the valid results part by part, with only one part in memory at a time.

    Parameters
    ----------
    line : Line
        The line; only its sensors are returned.
    folder : Path
        Folder with the parts.
    columns : iterable of str
        Columns of the rows, in addition to `id` and `OUTDATED`.

    Raises
    ------
    InputError
        A part is damaged.
    """
    paths = part_paths(folder)
    counting = _counting_rows(
        line, (read_part(path, _COUNTED_BY) for path in paths), line_inputs(line)
    )
    for path, rows in zip(paths, counting, strict=True):
        if rows:
            found = read_part(path, ("id", *columns)).take([*rows]).to_pylist()
            reasons = rows.values()
            yield [{**row, OUTDATED: one} for row, one in zip(found, reasons, strict=True)]


def outdated_lines(reasons: Mapping[str, str]) -> list[str]:
    """Return a line for each reason why results are outdated.

    Parameters
    ----------
    reasons : mapping of str to str
        Reasons by sensor id; an empty reason means that the result is not outdated.
    """
    texts: list[str] = []
    for reason, count in Counter(filter(None, reasons.values())).items():
        names = [name for name, one in reasons.items() if one == reason][:_NAMES]
        more = f" and {count - _NAMES} more" * (count > _NAMES)
        texts.append(f"{', '.join(names)}{more}: the result is outdated, because {reason}")
    return texts


def _counting_rows(
    line: Line, tables: Iterable[Table], now: Mapping[str, SensorInputs]
) -> list[dict[int, str]]:
    """Return the valid rows in each table, with the reasons why they are outdated."""
    best: dict[str, tuple[tuple[bool, bool, int], int, int, str]] = {}
    number = 0
    for part, table in enumerate(tables):
        number += 1
        for row, result in enumerate(table.select(_COUNTED_BY).to_pylist()):
            if (inputs := now.get(result["id"])) is None:
                continue
            reason = result_difference(line, inputs, result)
            done = not reason and result["status"] == DONE
            rank = (not reason, done, result["generation"] or 0)
            other = best.get(result["id"])
            if other is None or rank > other[0]:
                best[result["id"]] = (rank, part, row, reason)
    counting: list[dict[int, str]] = [{} for _ in range(number)]
    for _, part, row, reason in sorted(best.values(), key=lambda one: one[1:3]):
        counting[part][row] = reason
    return counting


def enter_results(
    line: Line, folder: Path, register: "Register", progress: Callable[[int], None] | None = None
) -> int:
    """Enter missing calibrations of a fleet in the register, and return their total number.

    Each part is entered in one transaction, and only one part is in memory at a time. Outdated
    results are not entered.

    Parameters
    ----------
    line : Line
    folder : Path
        Folder with the parts.
    register : Register
    progress : callable, optional
        Function called with the number of calibrations in the register.

    Raises
    ------
    InputError
        The register cannot be written. Entries that the register already has are kept and not
        entered again.
    """
    done = 0
    for rows in latest_rows_by_part(line, folder, _ENTERED):
        found = [row for row in rows if row["status"] == DONE and not row[OUTDATED]]
        _enter_part(found, register, str(folder))
        done += len(found)
        if progress is not None:
            progress(done)
    return done


def _enter_part(rows: Sequence[Mapping[str, Any]], register: "Register", source: str) -> None:
    hashes = [json.loads(row["calibration"])["sha256"] for row in rows]
    known = register.entered_sha256(hashes)
    by_time: dict[str | None, list[str]] = {}
    for row, digest in zip(rows, hashes, strict=True):
        if digest not in known:
            by_time.setdefault(row["measured"] or None, []).append(row["calibration"])
    for measured, texts in by_time.items():
        register.enter_calibrations([parse(text, source) for text in texts], measured)
