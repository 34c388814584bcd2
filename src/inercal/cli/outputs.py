"""Check the output files of all verbs, before any work begins."""

import csv
import os
from collections.abc import Iterable, Mapping, Sequence
from io import StringIO
from pathlib import Path
from typing import NamedTuple
from uuid import uuid4

from inercal.basics.atomic_files import writable_target
from inercal.basics.errors import InputError

FOLDER = "run file folder"
"""Key of the provenance: folder of the run file, relative to the folder of the calibration file."""
_HEAD = 4096  # number of bytes by which a file is recognised


class OutputKind(NamedTuple):
    """A kind of output file, and the mark by which earlier files of this kind are recognised.

    Parameters
    ----------
    name : str
        Name for messages, such as "page".
    mark : bytes
        Text among the first bytes of each such file; empty if there is no mark, as in a recording.
    """

    name: str
    mark: bytes = b""


PAGE = OutputKind("page", b'<meta name="generator" content="inercal">')
CALIBRATION = OutputKind("calibration file", b'"schema": "inercal/calibration/')
REPEATABILITY = OutputKind("result of repeat", b'"schema": "inercal/repeatability/')
QUALIFICATION = OutputKind("qualification", b'"schema": "inercal/qualification/')
TYPE_PRIOR = OutputKind("type prior", b'schema = "inercal/type-prior/')
CONTROL = OutputKind("result of control", b'"schema": "inercal/control/')
BUDGET = OutputKind("budget file", b'"schema": "inercal budget ')
RECORDING, WORKSHEET = OutputKind("recording"), OutputKind("worksheet")
PREDICTIONS = OutputKind("table of predictions")
RUN_FILE, BACKUP = OutputKind("run file"), OutputKind("backup")
CERTIFICATE, BUNDLE = OutputKind("certificate"), OutputKind("bundle")
SELF_CHECK = OutputKind("report of a self-check", b"Self-check of inercal")


def table_kind(name: str, columns: Iterable[str]) -> OutputKind:
    """Return the kind for a table with these columns, which is recognised by its header."""
    header = StringIO()
    csv.writer(header, lineterminator="\n").writerow(columns)
    return OutputKind(f"table of {name}", header.getvalue().encode())


def check_outputs(
    files: Mapping[Path, OutputKind],
    inputs: Iterable[Path] = (),
    *,
    force: bool | None = None,
    key: str = "--out",
) -> None:
    """Raise an error if an output file would destroy something or cannot be written.

    A verb may write a new file, or overwrite a regular file of the same kind. It never overwrites
    an input of the run, not even through a link, nor a device or a FIFO.

    Parameters
    ----------
    files : mapping of path to OutputKind
        The files to write.
    inputs : iterable of path
        The files that the verb reads.
    force : bool or None
        Whether to overwrite any regular file except an input; None if the verb has no `--force`.
    key : str
        The option or argument that names the files.

    Raises
    ------
    InputError
        A file must not or cannot be written; the message describes the obstacle.
    """
    read = {identity for path in inputs if (identity := _identity(path)) is not None}
    targets: dict[Path, Path] = {}
    for path, kind in files.items():
        try:
            target = writable_target(path)
            _check_folder(path, target.parent)
            _check_existing(path, target, kind, read, force)
            if kind == PAGE and path.suffix.lower() not in (".html", ".htm"):
                raise InputError(
                    f"{path}: the page is HTML; give the name of an .html file", file=path
                )
        except InputError as error:
            error.key = key
            raise
        if (other := targets.setdefault(target, path)) != path:
            raise InputError(f"{path} and {other} are the same file: name another", file=path)


def checked_targets(
    out: Path | None, kinds: Mapping[str, OutputKind], inputs: Iterable[Path], *, force: bool
) -> list[Path]:
    """Return the files to write to a folder, after `check_outputs`; empty without a folder.

    Parameters
    ----------
    out : Path or None
        The folder.
    kinds : mapping of str to OutputKind
        Kinds of the files, by name.
    inputs, force
        See `check_outputs`.
    """
    if out is None:
        return []
    targets = {out / name: kind for name, kind in kinds.items()}
    check_outputs(targets, inputs, force=force)
    return list(targets)


def check_output_folder(
    folder: Path, files: Sequence[str], inputs: Iterable[Path] = (), *, force: bool = False
) -> None:
    """Raise an error if writing files below a folder would destroy something or is impossible.

    Parameters
    ----------
    folder : Path
    files : sequence of str
        Paths within the folder; only a folder that already has the first file may have others.
    inputs, force
        See `check_outputs`.

    Raises
    ------
    InputError
        A file must not or cannot be written, or the folder contains something else.
    """
    kind = OutputKind("export")
    check_outputs({folder / name: kind for name in files}, inputs, force=force)
    if folder.is_dir() and any(folder.iterdir()) and not (folder / files[0]).is_file():
        raise InputError(
            f"{folder}: the folder is not empty and is not an earlier export of this "
            "calibration; name a new folder",
            file=folder,
            key="--out",
        )


def require_suffix(path: Path, suffix: str, more: str = "", key: str = "--out") -> None:
    """Raise an error if a file name has another suffix.

    Parameters
    ----------
    path : Path
    suffix : str
        ".csv".
    more : str
        Additional text about the file, for the message.
    key : str
        The option, or the key of the run file, that names the file.

    Raises
    ------
    InputError
    """
    if path.suffix.lower() != suffix:
        raise InputError(f"{key} {path}: give the name of a {suffix} file{more}", key=key)


def source_files(path: Path, calibration_file: Path, provenance: Mapping[str, str]) -> list[Path]:
    """Return a calibration file, the inputs that its folder has, and `path` if it is an input.

    Parameters
    ----------
    path : Path
        A file to write, which is compared by its content.
    calibration_file : Path
    provenance : mapping of str to str
        Names and SHA-256 hashes of the inputs, as the calibration states them.
    """
    from inercal.recordings.io.column_table import file_sha256

    is_source = os.path.isfile(path) and file_sha256(path) in provenance.values()
    named = [calibration_file.parent / name for name in provenance.values()]
    return [calibration_file, *named, *[path] * is_source]


def run_folder(path: Path, run_file: Path) -> str:
    """Return the folder of a run file, relative to the folder of a file to write."""
    return os.path.relpath(run_file.parent.resolve(), path.parent.resolve())


def require_same_run(path: Path, run_file: Path, sensor: str) -> None:
    """Raise an error before overwriting a calibration from another run file or sensor.

    Parameters
    ----------
    path : Path
        The calibration file to write.
    run_file : Path
    sensor : str
        Name of the sensor.

    Raises
    ------
    InputError
        The file exists and belongs to another run, or does not state its run.
    """
    if not path.exists():
        return
    from inercal.calibration.files import load

    try:
        found = load(path)
    except InputError:
        raise InputError(
            f"{path} exists but is damaged: move it, or replace it with --force",
            file=path,
            key="--out",
        ) from None
    of = found.provenance.get("run file", "")
    folder = found.provenance.get(FOLDER, ".")
    if (of, folder, found.sensor.name) != (run_file.name, run_folder(path, run_file), sensor):
        raise InputError(
            f"{path} is the calibration of {found.sensor.name} from "
            f"{Path(folder, of) if of else 'an unknown run file'}: choose another --out, or "
            "replace it with --force",
            file=path,
            key="--out",
            names=(found.sensor.name,),
        )


def _check_folder(path: Path, folder: Path) -> None:
    """Raise an error if a path is not a folder, or cannot be created or written to."""
    try:
        base = next((one for one in (folder, *folder.parents) if one.exists()), folder)
        is_folder = base.is_dir()
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror}", file=path) from None
    if not is_folder:
        raise InputError(f"{path}: {base} is not a folder; name another", file=path)
    if base.stat().st_nlink == 0:
        raise InputError(f"{path}: the working directory was deleted", file=path)
    trial = base / f".{uuid4().hex}.part"  # permission bits do not tell: root, /proc, a full disk
    try:
        trial.mkdir()
        trial.rmdir()
    except OSError as error:
        raise InputError(f"{path}: cannot write to {base}: {error.strerror}", file=path) from None


def _check_existing(
    path: Path, target: Path, kind: OutputKind, read: set[tuple[int, int]], force: bool | None
) -> None:
    identity = _identity(target)
    if identity is None:
        return
    if identity in read:
        raise InputError(f"{path}: the file is an input of this run; name another file", file=path)
    if force or (force is None and kind.mark and kind.mark in _head(path)):
        return
    if force is None:
        raise InputError(
            f"{path} exists but is not an inercal {kind.name}: name another file, or move it",
            file=path,
        )
    raise InputError(f"{path} exists: name another file, or overwrite it with --force", file=path)


def _identity(path: Path) -> tuple[int, int] | None:
    """Return the device and inode number of a file, or None if it does not exist."""
    try:
        known = path.stat()
    except (OSError, ValueError):
        return None
    return known.st_dev, known.st_ino


def _head(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(_HEAD)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}", file=path) from None
