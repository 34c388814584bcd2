"""Where a verb may write: one decision for all verbs, made before any work."""

import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from inercal.errors import InputError
from inercal.io.atomic_files import writable_target

_HEAD = 4096  # bytes by which a file is recognised
# By what a file is: whether its first bytes are those that inercal writes.
_IS_OWN: Mapping[str, Callable[[bytes], bool]] = {
    "page": lambda head: b'<meta name="generator" content="inercal">' in head,
    "calibration file": lambda head: b'"schema": "inercal/calibration/' in head,
    "budget file": lambda head: b'"schema": "inercal budget ' in head,
    "table of states": lambda head: head.partition(b"\n")[0].endswith(b",turns,seconds"),
}


def check_outputs(
    files: Mapping[Path, str], inputs: Iterable[Path] = (), *, force: bool | None = None
) -> None:
    """Refuse files to write that would destroy something, or that cannot be written.

    A verb may write a new file, or over a regular file that it or its like wrote before. It never
    writes over an input of the run, whatever its name or the links to it, a device or a FIFO.

    Parameters
    ----------
    files : mapping of path to str
        The files to write, and what each is: "page", "calibration file", "budget file", "table of
        states", or another word for files that inercal does not know again, as recordings.
    inputs : iterable of path
        The files that the verb reads.
    force : bool or None
        Write over any regular file but an input; None where the verb has no `--force`.

    Raises
    ------
    InputError
        For the first file that must not or cannot be written: what stands in its place.
    """
    read = {identity for path in inputs if (identity := _identity(path)) is not None}
    targets: dict[Path, Path] = {}
    for path, kind in files.items():
        try:
            target = writable_target(path)
            _check_folder(path, target.parent)
            _check_existing(path, target, kind, read, force)
        except InputError as error:
            error.key = "--out"
            raise
        if (other := targets.setdefault(target, path)) != path:
            raise InputError(f"{path} and {other} are one file: name another", file=path)


def _check_folder(path: Path, folder: Path) -> None:
    try:
        is_folder = folder.is_dir()
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror}", file=path) from None
    if not is_folder:
        raise InputError(f"--out {path}: no such folder {folder}; create it", file=path)
    if not os.access(folder, os.W_OK | os.X_OK):
        raise InputError(f"--out {path}: no right to write in the folder {folder}", file=path)
    if folder.stat().st_nlink == 0:
        raise InputError(f"--out {path}: the working directory was deleted", file=path)


def _check_existing(
    path: Path, target: Path, kind: str, read: set[tuple[int, int]], force: bool | None
) -> None:
    identity = _identity(target)
    if identity is None:
        return
    if identity in read:
        raise InputError(
            f"--out {path}: the file is an input of this run; name another file", file=path
        )
    is_own = _IS_OWN.get(kind)
    if force or (force is None and is_own is not None and is_own(_head(path))):
        return
    if force is None:
        raise InputError(
            f"{path} exists and is no {kind} of inercal: name another with --out, or move it",
            file=path,
        )
    raise InputError(
        f"{path} exists: name another with --out, or write over it with --force", file=path
    )


def _identity(path: Path) -> tuple[int, int] | None:
    """Return device and number of a file, by which hard links are known; None for no file."""
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
