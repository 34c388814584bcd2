"""Calibrations that other programs made, read into a `Calibration` without covariance.

Their files state no uncertainties: the covariance is zero, a note states it, and `inercal compare`
compares differences with the U of only the other calibration. Each format is a module with
`READER = CalibrationReader(...)`; a package of its own registers one by the entry point
`inercal.calibration_readers`.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from inercal.basics.errors import InputError
from inercal.basics.registry import Registry
from inercal.basics.small_files import read_small_file
from inercal.calibration import Calibration
from inercal.export.options import resolve_options
from inercal.export.readers.coefficients import build_calibration
from inercal.export.readers.reader_definition import CalibrationReader

READERS: Registry[CalibrationReader] = Registry(
    "inercal.calibration_readers",
    "format",
    {
        name: f"inercal.export.readers.{name}:READER"
        for name in ("imu_tk", "imucal", "kalibr", "px4", "ardupilot")
    },
)
_LARGEST = 4 << 20  # bytes: parameters of a flight controller are 100 kilobytes
WITHOUT_COVARIANCE = "imported without covariance: its uncertainties are not known"


def import_calibration(
    path: str | Path,
    of: str,
    *,
    like: Calibration | None = None,
    options: Mapping[str, Any] | None = None,
    name: str = "",
) -> Calibration:
    """Return the calibration of a file that another program made.

    Parameters
    ----------
    path : path
    of : str
        Name of the format, one of `READERS`.
    like : Calibration, optional
        A calibration of the same sensor: its axes with their names and readouts are taken, so that
        both can be compared. Otherwise axes are ax, ay, az, gx, gy, gz with readings in SI.
    options : mapping of str to object, optional
        What the format takes, by name.
    name : str
        Of the sensor; by default that of `like`, else that of the file.

    Returns
    -------
    Calibration
        With a covariance of zero.

    Raises
    ------
    InputError
        No such format, a file that is none of this format, or a sensor that does not fit.
    """
    reader = READERS.find(of)
    resolved = resolve_options(reader, options or {})
    path = Path(path)
    raw = read_small_file(path, f"{reader.meaning} file", _LARGEST)
    try:
        stated = reader.read(raw.decode("utf-8-sig"), resolved)
        named = name or (path.name.partition(".")[0] if like is None else like.sensor.name)
        calibration = build_calibration(stated, like, named, of)
    except UnicodeDecodeError:
        raise InputError(f"{path}: no text; give a {reader.meaning} file", file=path) from None
    except InputError as error:
        raise error.located(path) from None
    provenance = {
        "imported file": path.name,
        "imported file sha256": hashlib.sha256(raw).hexdigest(),
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "inercal": version("inercal"),
    }
    notes = (WITHOUT_COVARIANCE, *stated.notes)
    return replace(calibration, provenance=provenance, notes=notes)


__all__ = ["READERS", "import_calibration"]
