"""Results of a fleet in the register: by one writer, after they were computed."""

from collections.abc import Callable
from pathlib import Path

from inercal.calibration.files import parse
from inercal.fleet import results
from inercal.store import Register

_TRANSACTION = 500  # calibrations


def enter_results(
    folder: Path, register: Register, progress: Callable[[int, int], None] | None = None
) -> int:
    """Enter the calibrations of a fleet that the register does not have yet; return their number.

    Parameters
    ----------
    folder : Path
        Of the parts.
    register : Register
    progress : callable, optional
        Called with the numbers of those entered and of all.

    Raises
    ------
    InputError
        The register cannot be written; what was entered stays, and is not entered twice.
    """
    columns = ("status", "calibration", "measured")
    rows = [
        row
        for row in results.read_results(folder, columns).to_pylist()
        if row["status"] == results.DONE
    ]
    for start in range(0, len(rows), _TRANSACTION):
        some = rows[start : start + _TRANSACTION]
        by_time: dict[str | None, list[str]] = {}
        for row in some:
            by_time.setdefault(row["measured"] or None, []).append(row["calibration"])
        for measured, texts in by_time.items():
            register.enter_calibrations([parse(text, str(folder)) for text in texts], measured)
        if progress is not None:
            progress(start + len(some), len(rows))
    return len(rows)
