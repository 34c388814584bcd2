"""The entries of `inercal store import`, and its messages."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from inercal.laboratory.store import Register


def enter_path(opened: "Register", path: Path, measured: str | None) -> dict[str, Any]:
    """Enter one path; return run and calibrations."""
    from inercal.basics.errors import InputError

    # A register that is not there yet is created when the first entry is good.
    before = set(opened.calibration_numbers() if opened.exists else ())
    if not path.is_dir():
        numbers = (opened.enter_calibration(path, measured),)
        return _entry_summary(path, None, numbers, before)
    from inercal.host.registration import register_run
    from inercal.host.run_folder import JOURNAL

    if (path / JOURNAL).exists():
        number = register_run(opened, path)
        return _entry_summary(path, number, opened.calibration_numbers(number), before)
    files = sorted(path.glob("*.calibration.json"))
    if not files:
        raise InputError(
            f"{path}: the folder has neither a run of a bench nor *.calibration.json; give the "
            "folder of a run, or calibration files",
            file=path,
        )
    return _entry_summary(path, None, opened.enter_calibrations(files), before)


def _entry_summary(
    path: Path, run: int | None, numbers: tuple[int, ...], before: set[int]
) -> dict[str, Any]:
    new = [number for number in numbers if number not in before]
    return {"path": str(path), "run": run, "calibrations": list(numbers), "new": new}


def entry_line(entered: dict[str, Any]) -> str:
    """Return what of a path was entered, in a line."""
    parts = [] if entered["run"] is None else [f"run {entered['run']}"]
    parts += [
        f"calibration #{number}" + ("" if number in entered["new"] else " (existing)")
        for number in entered["calibrations"]
    ]
    return f"{entered['path']}: {', '.join(parts)}"


def print_dates(opened: "Register", entered: list[dict[str, Any]], measured: str | None) -> None:
    """Say which date was stated, and which new calibrations have but that of their file."""
    if measured is not None:
        number = entered[0]["calibrations"][0]
        print(f"#{number} is dated {opened.calibration(number).measured[:10]}, as stated")
        return
    new = [number for one in entered for number in one["new"]]
    dated = [n for n in new if opened.calibration(n).measured_from == "created"]
    if dated:
        print(
            f"{', '.join(f'#{n}' for n in dated)}: dated by the making of the file; where it was "
            "measured on another day, import it again with --measured DATE"
        )
