"""Enters the results of a fleet into the register, by one writer, after they were computed."""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from inercal.calibration.files import parse
from inercal.fleet import results
from inercal.fleet.latest import OUTDATED, latest_rows_by_part
from inercal.fleet.line import Line
from inercal.laboratory.store import Register

_COLUMNS = ("status", "calibration", "measured")


def enter_results(
    line: Line, folder: Path, register: Register, progress: Callable[[int], None] | None = None
) -> int:
    """Enter the calibrations of a fleet that the register lacks; return how many it has now.

    Each part is one transaction and the only one in memory. Outdated results are not entered.

    Parameters
    ----------
    line : Line
    folder : Path
        Of the parts.
    register : Register
    progress : callable, optional
        Called with the number of calibrations in the register.

    Raises
    ------
    InputError
        The register cannot be written. What was entered stays and is not entered again.
    """
    done = 0
    for rows in latest_rows_by_part(line, folder, _COLUMNS):
        found = [row for row in rows if row["status"] == results.DONE and not row[OUTDATED]]
        _enter_part(found, register, str(folder))
        done += len(found)
        if progress is not None:
            progress(done)
    return done


def _enter_part(rows: Sequence[Mapping[str, Any]], register: Register, source: str) -> None:
    hashes = [json.loads(row["calibration"])["sha256"] for row in rows]
    known = register.entered_sha256(hashes)
    by_time: dict[str | None, list[str]] = {}
    for row, digest in zip(rows, hashes, strict=True):
        if digest not in known:
            by_time.setdefault(row["measured"] or None, []).append(row["calibration"])
    for measured, texts in by_time.items():
        register.enter_calibrations([parse(text, source) for text in texts], measured)
