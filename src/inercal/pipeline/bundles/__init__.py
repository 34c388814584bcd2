"""Bundle a calibration with all its input files, and reproduce it from the bundle.

A bundle is a ZIP file. It contains the run file, the files that the run file names (with their
relative paths), the calibration file, and `manifest.json`. The manifest states versions, the
machine and the SHA-256 hash of every file.
"""

import json
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Any
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo, is_zipfile

from inercal.basics.atomic_files import atomic_write
from inercal.basics.errors import InputError
from inercal.calibration import Calibration
from inercal.calibration.comparison import largest_change
from inercal.calibration.files import load
from inercal.pipeline import Outcome, calibrate
from inercal.pipeline.self_check import machine, versions
from inercal.recordings.io.column_table import file_sha256
from inercal.recordings.io.damaged_files import refuse_damage
from inercal.runfile import read

SCHEMA = "inercal/bundle/1"
MANIFEST = "manifest.json"
TOLERANCE = 1e-3
"""Largest difference of a value or its u, in u, for which a calibration counts as reproduced."""
_LARGEST_MANIFEST = 10_000_000  # bytes
_FIRST_DAY = (1980, 1, 1, 0, 0, 0)  # earliest ZIP date, so equal files give equal bundles


@dataclass(frozen=True, eq=False)
class Reproduction:
    """The calibration from a bundle, and what the same data give on this machine.

    Parameters
    ----------
    stored : Calibration
        Calibration stored in the bundle.
    outcome : Outcome
        Result computed on this machine.
    made_with, here : mapping of str to str
        Versions and machine with which the bundle was made, and versions and machine used now.
    difference : float
        Largest difference of a value or its u, in units of the stored u; inf if the coefficients
        differ.
    """

    stored: Calibration
    outcome: Outcome
    made_with: Mapping[str, str]
    here: Mapping[str, str]
    difference: float

    @property
    def reproduced(self) -> bool:
        """Whether all coefficients agree within `TOLERANCE` u and the verdict is the same."""
        stored = self.stored.verdict
        equal = stored is None or stored.grade == self.outcome.verdict.grade
        return equal and self.difference <= TOLERANCE


def write_bundle(run_file: Path, calibration_file: Path, target: Path) -> list[str]:
    """Write a bundle atomically, and return the names of the files in it.

    Raises
    ------
    InputError
        If the calibration is from another run file or recording, if the run file names a file
        outside its folder, or if a file cannot be read.
    """
    run = read(run_file)
    calibration = load(calibration_file)
    for what, path in (("run file", run_file), ("recording", run.file(run.data.file))):
        stated = calibration.provenance.get(f"{what} sha256", "")
        if path.is_file() and stated != file_sha256(path):
            raise InputError(
                f"the calibration is from another {what} than {path}; calibrate again, or give "
                "the files that it came from",
                names=(str(path),),
            ).located(calibration_file)
    folder = run_file.resolve().parent
    named: dict[str, Path] = {}
    for path in run.input_files():
        if not path.resolve().is_relative_to(folder):
            raise InputError(
                f"{path} is outside the folder of the run file; copy it into that folder and name "
                "the copy",
                names=(str(path),),
            ).located(run_file)
        named[path.resolve().relative_to(folder).as_posix()] = path
    named[f"result/{calibration_file.name}"] = calibration_file
    hashes = {name: file_sha256(path) for name, path in named.items()}
    manifest = {
        "schema": SCHEMA,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "run_file": run_file.name,
        "calibration": f"result/{calibration_file.name}",
        "made_with": {**versions(), **machine()},
        "files": {
            name: {"sha256": hashes[name], "bytes": path.stat().st_size}
            for name, path in sorted(named.items())
        },
    }
    with atomic_write(target) as part, ZipFile(part, "w", ZIP_DEFLATED) as archive:
        text = json.dumps(manifest, indent=1, ensure_ascii=False)
        archive.writestr(ZipInfo(MANIFEST, _FIRST_DAY), text)
        for name, path in sorted(named.items()):
            entry = ZipInfo(name, _FIRST_DAY)
            entry.compress_type = ZIP_DEFLATED
            with path.open("rb") as source, archive.open(entry, "w", force_zip64=True) as copy:
                shutil.copyfileobj(source, copy)
    return sorted(named)


def is_bundle(path: Path) -> bool:
    """Return whether a file is a ZIP file."""
    return path.is_file() and is_zipfile(path)


def reproduce_bundle(path: Path) -> Reproduction:
    """Compute the calibration in a bundle again, in a temporary folder.

    Raises
    ------
    InputError
        If the file is not a bundle, is damaged or was changed, or if the run in it cannot be
        calibrated on this machine.
    """
    with TemporaryDirectory() as name:
        folder = Path(name)
        manifest = _extract(path, folder)
        stored = load(folder / manifest["calibration"])
        outcome = calibrate(read(folder / manifest["run_file"]))
    return Reproduction(
        stored,
        outcome,
        manifest["made_with"],
        {**versions(), **machine()},
        largest_change(outcome.calibration, stored.sensor.coefficients, stored.values, stored.std),
    )


def _extract(path: Path, folder: Path) -> dict[str, Any]:
    """Extract the files of a bundle into a folder, and return its manifest.

    Only files that the manifest lists with a plain relative name are written, and only if their
    size and SHA-256 hash match.
    """
    try:
        with refuse_damage(path, "a bundle", "bundle it again"), ZipFile(path) as archive:
            manifest = _manifest(archive, path)
            need = sum(one["bytes"] for one in manifest["files"].values())
            if need > shutil.disk_usage(folder).free:
                raise InputError(
                    f"its files take {need / 1e9:.1f} GB, more than is free in {folder}; set "
                    "TMPDIR to a folder with more space"
                ).located(path)
            for name, one in manifest["files"].items():
                target = folder / name
                target.parent.mkdir(parents=True, exist_ok=True)
                if archive.getinfo(name).file_size != one["bytes"]:
                    raise _damaged(path, name)
                with archive.open(name) as source, target.open("wb") as copy:
                    shutil.copyfileobj(source, copy)
                if file_sha256(target) != one["sha256"]:
                    raise _damaged(path, name)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error}", file=path) from None
    return manifest


def _manifest(archive: ZipFile, path: Path) -> dict[str, Any]:
    other = InputError(
        f"not an inercal bundle: it has no {MANIFEST} of {SCHEMA}; give a file that `inercal "
        "bundle` wrote"
    ).located(path)
    names = archive.namelist()
    if MANIFEST not in names or archive.getinfo(MANIFEST).file_size > _LARGEST_MANIFEST:
        raise other
    try:
        manifest: dict[str, Any] = json.loads(archive.read(MANIFEST))
        if manifest["schema"] != SCHEMA:
            raise other
        files: dict[str, Any] = manifest["files"]
        good = all(
            isinstance(one["bytes"], int) and isinstance(one["sha256"], str)
            for one in files.values()
        )
        named = {manifest["run_file"], manifest["calibration"]} <= set(files)
        facts = isinstance(manifest["made_with"], dict)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise other from None
    if not (good and named and facts):
        raise other
    for name in files:
        parts = PurePosixPath(name).parts
        if name.startswith("/") or ".." in parts or "\\" in name or ":" in name or not parts:
            raise InputError(
                f"the bundle names {name!r}, which is outside the bundle, so the bundle is not "
                "used",
                names=(name,),
            ).located(path)
    return manifest


def _damaged(path: Path, name: str) -> InputError:
    return InputError(
        f"{name} is not the file that was bundled: its SHA-256 or its size differs", names=(name,)
    ).located(path)
