"""Make Numba find its compiled kernels in a read-only installation.

Numba stores a kernel in `__pycache__` next to its module if it can write there, and otherwise in
the user's cache, in a folder `<name>_<SHA-1 of path>` for each folder of modules. It never reads a
folder to which it cannot write. The kernels that `inercal compile` stored next to the modules of a
read-only installation are therefore linked into the user's cache. If this cache is also read-only,
they are linked into a temporary folder, which is deleted when the process ends. An index entry
contains the version, the processor and a hash of the source, so Numba recompiles kernels that do
not match.
"""

import os
import sys
from collections.abc import Iterator
from contextlib import suppress
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tempfile import TemporaryDirectory

_INDEX, _DATA = ".nbi", ".nbc"  # suffixes of Numba's cache files
_PACKAGE = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))


def prepare_kernel_cache(package: str = _PACKAGE) -> "TemporaryDirectory[str] | None":
    """Link the kernels of a read-only installation to a folder where Numba finds them.

    NUMBA_CACHE_DIR is set only if Numba would find no writable folder and therefore fail to start.

    Returns
    -------
    TemporaryDirectory or None
        The temporary folder, deleted when the process ends; None if no such folder was needed.
    """
    if "NUMBA_CACHE_DIR" in os.environ or _is_writable(package):
        return None
    if _is_writable(user_cache()):
        link_kernels(package, user_cache())
        return None
    from tempfile import TemporaryDirectory

    folder = TemporaryDirectory(prefix="inercal-")
    os.environ["NUMBA_CACHE_DIR"] = folder.name
    if (config := sys.modules.get("numba.core.config")) is not None:  # Numba is already loaded
        vars(config)["CACHE_DIR"] = folder.name
    link_kernels(package, folder.name)
    return folder


def count_kernels() -> tuple[str, int]:
    """Return the folder with this package's compiled kernels, and their number."""
    given = os.environ.get("NUMBA_CACHE_DIR")
    if given is None and _is_writable(_PACKAGE):
        return _PACKAGE, sum(_count(kept) for _, kept in _folders_of_kernels(_PACKAGE))
    cache = given or user_cache()
    own = (cache_folder(modules, cache) for modules, _, _ in os.walk(_PACKAGE))
    return cache, sum(_count(folder) for folder in own if os.path.isdir(folder))


def _count(folder: str) -> int:
    return sum(name.endswith(_DATA) for name in os.listdir(folder))


def user_cache() -> str:
    """Return the folder of the user's kernel cache, computed as in Numba."""
    if sys.platform == "win32":
        local = os.environ.get("LOCALAPPDATA") or os.path.join("~", "AppData", "Local")
        return os.path.join(os.path.expanduser(local), "numba", "Cache")
    if sys.platform == "darwin":
        return os.path.expanduser("~/Library/Caches/numba")
    base = os.environ.get("XDG_CACHE_HOME") or os.path.join("~", ".cache")
    return os.path.join(os.path.expanduser(base), "numba")


def cache_folder(modules: str, cache: str) -> str:
    """Return the cache folder for the kernels in a folder of modules, named as in Numba."""
    from hashlib import sha1

    path = os.path.abspath(modules)
    return os.path.join(cache, f"{os.path.basename(path)}_{sha1(path.encode()).hexdigest()}")


def link_kernels(package: str, cache: str) -> None:
    """Link the kernels stored next to a package's modules into a cache.

    Newer kernels in the cache are kept. Kernels that cannot be linked are compiled when they are
    used.
    """
    for modules, kept in _folders_of_kernels(package):
        own = cache_folder(modules, cache)
        names = os.listdir(kept)
        with suppress(OSError):
            os.makedirs(own, exist_ok=True)
            for name in names:
                if name.endswith(_INDEX) and _is_older(own, kept, name):
                    stem = name.removesuffix(_INDEX)
                    data = [n for n in names if n.startswith(f"{stem}.") and n.endswith(_DATA)]
                    for one in (*data, name):  # the index last, because it refers to the data
                        _link(os.path.join(kept, one), os.path.join(own, one))


def _folders_of_kernels(package: str) -> Iterator[tuple[str, str]]:
    for modules, folders, _ in os.walk(package):
        if "__pycache__" in folders:
            folders.remove("__pycache__")
            yield modules, os.path.join(modules, "__pycache__")


def _is_older(own: str, kept: str, name: str) -> bool:
    """Return whether a cache does not contain a file or contains an older version."""
    mine, installed = os.path.join(own, name), os.path.join(kept, name)
    if os.path.islink(mine):
        return os.readlink(mine) != installed
    return not os.path.exists(mine) or os.stat(mine).st_mtime < os.stat(installed).st_mtime


def _link(kept: str, own: str) -> None:
    """Link a file, or copy it if links are not allowed, replacing any existing file."""
    made = f"{own}.{os.getpid()}"
    try:
        os.symlink(kept, made)
    except OSError:
        import shutil

        shutil.copyfile(kept, made)
    os.replace(made, own)


def _is_writable(folder: str) -> bool:
    """Return whether a folder is writable; for a missing folder, whether it can be created."""
    while not os.path.exists(folder) and os.path.dirname(folder) != folder:
        folder = os.path.dirname(folder)
    return os.access(folder, os.W_OK | os.X_OK)
