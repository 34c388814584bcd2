"""Find the recordings of a fleet, which are files in a folder or objects in a store."""

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from inercal.basics.errors import InputError, require_extra


@dataclass(frozen=True)
class Version:
    """Version of a recording, which shows that it changed without the need to read it.

    Parameters
    ----------
    size : int
        Size in bytes.
    mark : str
        Times of the last change to the content and to the attributes, or the store's content tag.
        Marks are only compared for equality. The attribute time is needed because loggers without a
        clock always write the same content time. A copy that keeps the content time has a new
        attribute time.
    """

    size: int
    mark: str


ABSENT = Version(0, "")  # version of a missing recording


def is_address(recording: str) -> bool:
    """Return whether a recording is an object in a store, such as "s3://bucket/name"."""
    return "://" in recording


def version_of(folder: Path, recording: str) -> Version:
    """Return the version of a recording from its size and time.

    Raises
    ------
    InputError
        There is no such recording.
    """
    if is_address(recording):
        store, path = _store(recording)
        try:
            info: dict[str, Any] = store.info(path)
        except (OSError, ValueError) as error:
            raise InputError(f"{recording}: {error}", file=recording) from None
        mark = info.get("ETag") or info.get("LastModified") or info.get("mtime") or ""
        return Version(int(info["size"] or 0), str(mark))
    path = folder / recording
    try:
        found = path.stat()
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}", file=path) from None
    return Version(found.st_size, f"{found.st_mtime_ns} {found.st_ctime_ns}")


@contextmanager
def local_copy(recording: str) -> Generator[Path]:
    """Yield the path of a local copy of an object; the copy is removed afterwards.

    Raises
    ------
    InputError
        The object cannot be read.
    """
    store, path = _store(recording)
    with TemporaryDirectory(prefix="inercal-") as folder:
        copy = Path(folder) / path.rsplit("/", 1)[-1]
        try:
            store.get_file(path, str(copy))
        except OSError as error:
            raise InputError(f"{recording}: {error}", file=recording) from None
        yield copy


def _store(address: str) -> tuple[Any, str]:
    with require_extra("fleet", f"{address} needs fsspec", ("fsspec",)):
        core: Any = import_module("fsspec.core")
    try:
        store, path = core.url_to_fs(address)
    except ImportError:
        scheme = address.split("://")[0]
        extra = {"s3": "s3"}.get(scheme)
        how = (
            f"pip install 'inercal[{extra}]'" if extra else f"install fsspec's driver for {scheme}"
        )
        raise InputError(f"{address}: {how}", file=address) from None
    except ValueError as error:
        raise InputError(f"{address}: {error}", file=address) from None
    return store, path
