"""Files that are written completely or not at all."""

import os
import shutil
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from uuid import uuid4

from inercal.errors import InputError


@contextmanager
def atomic_write(path: str | os.PathLike[str]) -> Generator[Path]:
    """Yield a temporary path in the folder of `path`; rename it to `path` when the block succeeds.

    A reader sees the old file or the new file. A block that fails leaves the old file unchanged.

    Raises
    ------
    InputError
        The folder is missing or cannot be written, the disk is full, or `path` is a folder.

    Examples
    --------
    >>> import tempfile
    >>> target = Path(tempfile.mkdtemp()) / "result.txt"
    >>> with atomic_write(target) as temporary:
    ...     _ = temporary.write_text("done")
    >>> target.read_text()
    'done'
    """
    target = Path(path)
    # Opened by the caller under the user's umask, which tempfile would override with 0600.
    temporary = target.with_name(f".{uuid4().hex}.part")
    try:
        _refuse_folder(target)
        yield temporary
        os.replace(temporary, target)
    except OSError as error:
        if error.filename in (None, str(temporary), str(target), temporary, target):
            raise _write_error(target, error) from error
        raise
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: str | os.PathLike[str], text: str) -> Path:
    """Write a UTF-8 text file completely or not at all; return its path.

    Raises
    ------
    InputError
        As `atomic_write` raises it.
    """
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return Path(path)


@contextmanager
def atomic_write_all(targets: Sequence[Path]) -> Generator[list[Path]]:
    """Yield temporary paths for files of one folder; rename all when the block succeeds.

    A block that fails leaves all files unchanged. A file that the block does not write keeps its
    old content.

    Raises
    ------
    InputError
        The folder cannot be written, or one of the paths is a folder.
    """
    for target in targets:
        _refuse_folder(target)
    folder = targets[0].parent / f".{uuid4().hex}.part"
    try:
        folder.mkdir()
    except OSError as error:
        raise _write_error(targets[0], error) from error
    try:
        parts = [folder / target.name for target in targets]
        yield parts
        for part, target in zip(parts, targets, strict=True):
            if part.exists():
                os.replace(part, target)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _refuse_folder(target: Path) -> None:
    if target.is_dir():
        raise InputError(f"{target} is a folder; name a file to write", file=target)


def _write_error(target: Path, error: OSError) -> InputError:
    return InputError(f"{target} cannot be written: {error.strerror or error}", file=target)
