"""Atomic writing of files: completely or not at all, and only over regular files.

An incomplete file is in a hidden folder next to its destination. A program that is killed leaves
this folder behind, but its lock on the folder ends. The next program that writes there sees that
the folder is not locked and removes it.
"""

import os
import re
import shutil
import stat
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from importlib import import_module
from pathlib import Path
from typing import IO, Any
from uuid import uuid4

from inercal.basics.errors import InputError
from inercal.basics.visible_text import visible_text

_PART = ".part"  # suffix of folders for files that are being written
_LOCK = ".being-written"
_LEFT_NAME = re.compile(rf"\.[0-9a-f]{{32}}{re.escape(_PART)}")
_looked_through: set[Path] = set()
_written: ContextVar[list[Path] | None] = ContextVar("written", default=None)


@contextmanager
def written_files() -> Generator[list[Path]]:
    """Yield a list that collects the names of all files written in the block."""
    files: list[Path] = []
    token = _written.set(files)
    try:
        yield files
    finally:
        _written.reset(token)


@contextmanager
def atomic_write(path: str | os.PathLike[str]) -> Generator[Path]:
    """Yield a temporary path near `path`, and rename it to `path` if the block succeeds.

    Readers see either the old file or the new file. If the block fails, the old file is unchanged.
    If `path` is a symbolic link, the link is kept and the file that it points to is replaced. A
    missing folder is created.

    Raises
    ------
    InputError
        The folder cannot be created or written, the disk is full, or `path` is a folder, a device,
        a FIFO, a socket or a loop of symbolic links.

    Examples
    --------
    >>> import tempfile
    >>> target = Path(tempfile.mkdtemp()) / "result.txt"
    >>> with atomic_write(target) as temporary:
    ...     _ = temporary.write_text("done")
    >>> target.read_text()
    'done'
    """
    target = writable_target(path)
    with _parent_folder(target), _part_folder(target) as folder:
        # The caller opens the file with the user's umask; tempfile would always set the mode 0600.
        temporary = folder / target.name
        try:
            yield temporary
            _replace(temporary, target, Path(path))
        except OSError as error:
            if error.filename in (None, str(temporary), str(target), temporary, target):
                raise _write_error(target, error) from error
            raise


def write_text(path: str | os.PathLike[str], text: str) -> Path:
    """Write a UTF-8 text file completely or not at all; return its path.

    Raises
    ------
    InputError
        See `atomic_write`.
    """
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return Path(path)


@contextmanager
def atomic_write_all(targets: Sequence[Path]) -> Generator[list[Path]]:
    """Yield temporary paths for several files in one folder; rename all if the block succeeds.

    If the block fails, all files are unchanged. A file that the block does not write keeps its old
    content. A missing folder is created.

    Raises
    ------
    InputError
        The folder cannot be written, or one of the paths is not a regular file.
    """
    named, targets = targets, [writable_target(target) for target in targets]
    with _parent_folder(targets[0]), _part_folder(targets[0]) as folder:
        parts = [folder / target.name for target in targets]
        yield parts
        for part, target, name in zip(parts, targets, named, strict=True):
            if part.exists():
                _replace(part, target, name)


def write_folder(folder: Path, texts: Mapping[str, str]) -> None:
    """Write UTF-8 text files below a folder: a new folder appears with all files or not at all.

    In an existing folder, the files are replaced one by one after all of them have been written.

    Parameters
    ----------
    folder : Path
    texts : mapping of str to str
        Contents of the files by their path within the folder.

    Raises
    ------
    InputError
        A file or folder cannot be written.
    """
    targets = [writable_target(folder / name) for name in texts]
    with _parent_folder(folder), _part_folder(folder) as part:
        tree = part / "tree"  # the name of the folder may be ".."
        try:
            for name, text in texts.items():
                (tree / name).parent.mkdir(parents=True, exist_ok=True)
                (tree / name).write_text(text, encoding="utf-8")
            if not folder.exists():
                os.replace(tree, folder)
                return
            for name, target in zip(texts, targets, strict=True):
                target.parent.mkdir(parents=True, exist_ok=True)
                _replace(tree / name, target, folder / name)
        except OSError as error:
            raise _write_error(folder, error) from error


@contextmanager
def _part_folder(target: Path) -> Generator[Path]:
    """Create a folder for an incomplete file, and remove such folders of killed programs."""
    _remove_left_folders(target.parent)
    try:
        folder, lock = _make_part_folder(target.parent)
    except OSError as error:
        raise _write_error(target, error) from error
    try:
        with lock:
            yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _make_part_folder(parent: Path) -> tuple[Path, IO[bytes]]:
    """Return a new folder and its lock file; the system unlocks it when this program ends."""
    while True:
        folder = parent / f".{uuid4().hex}{_PART}"
        folder.mkdir()
        # Before the folder is locked, another program may take it for a leftover and remove it.
        with suppress(FileNotFoundError):
            lock = (folder / _LOCK).open("wb")
            if _lock(lock) is not False and (folder / _LOCK).exists():
                return folder, lock
            lock.close()


def _remove_left_folders(parent: Path) -> None:
    """Remove the folders left by killed programs, once per process."""
    if parent in _looked_through:
        return
    _looked_through.add(parent)
    for folder in parent.glob(f".*{_PART}"):
        if _LEFT_NAME.fullmatch(folder.name):
            with suppress(OSError):  # the folder is not empty
                folder.rmdir()
            with suppress(OSError), (folder / _LOCK).open("r+b") as lock:
                if _lock(lock):
                    shutil.rmtree(folder, ignore_errors=True)


def _lock(file: IO[bytes]) -> bool | None:
    """Lock a file; return False if another program holds it, None if locks are not supported."""
    try:
        fcntl: Any = import_module("fcntl")
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except (ImportError, OSError):  # the system or the file system does not support such locks
        return None
    return True


@contextmanager
def _parent_folder(target: Path) -> Generator[None]:
    """Create the folder of a file, and remove it again if the block fails."""
    missing = [folder for folder in target.parents if not folder.exists()]
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _write_error(target, error) from None
    try:
        yield
    except BaseException:
        with suppress(OSError):
            for folder in missing:  # innermost folder first
                folder.rmdir()
        raise


def keep_previous(path: Path) -> None:
    """Copy a file to `NAME.previous` before the file is replaced, if it exists.

    Raises
    ------
    InputError
        The copy cannot be written.
    """
    if not path.exists():
        return
    with atomic_write(path.with_name(f"{path.name}.previous")) as part:
        shutil.copy2(path, part)


def _replace(part: Path, target: Path, name: Path) -> None:
    os.replace(part, target)
    files = _written.get()
    if files is not None and name not in files and target.parent.suffix != _PART:
        files.append(name)


def make_folder(folder: Path) -> None:
    """Create a folder for output if it does not exist.

    Raises
    ------
    InputError
        The folder cannot be created.
    """
    require_plain_name(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"the folder cannot be created: {error.strerror}; give another folder", key="--out"
        ).located(folder) from None


def writable_target(path: str | os.PathLike[str]) -> Path:
    """Return the file that writing to `path` would replace or create, following links.

    Raises
    ------
    InputError
        The path is a folder, a device, a FIFO, a socket or a loop of symbolic links, or its name is
        too long or contains a control character or bytes that are not UTF-8.
    """
    target = path = Path(path)
    require_plain_name(path)
    try:
        if path.is_symlink():
            target = Path(os.path.realpath(path))
        mode = target.stat().st_mode
    except FileNotFoundError:
        return target
    except OSError as error:
        raise _write_error(path, error) from None
    if not stat.S_ISREG(mode):
        kind = "a folder" if stat.S_ISDIR(mode) else "not a regular file"
        raise InputError(f"{path} is {kind}; name a file to write", file=path)
    return target


def require_plain_name(path: Path) -> None:
    """Raise an error if the name of an output file or folder has unprintable characters.

    Raises
    ------
    InputError
        The name has control characters, or bytes that are not UTF-8.
    """
    try:
        str(path).encode("utf-8")
    except UnicodeEncodeError:
        raise InputError(f"{path}: a name to write to must be UTF-8", file=path) from None
    if visible_text(str(path)) != str(path):
        raise InputError(f"{path}: a name to write to must not have control characters", file=path)


def _write_error(target: Path, error: OSError) -> InputError:
    return InputError(f"{target} cannot be written: {error.strerror or error}", file=target)
