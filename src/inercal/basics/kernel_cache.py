"""Where Numba finds compiled kernels if the installation is read-only.

Numba keeps a kernel in `__pycache__` beside its module where it can write there, else in the user's
cache, in a folder `<name>_<SHA-1 of path>` for each folder of modules. It never reads a folder that
it cannot write to. So the kernels that `inercal compile` has left beside the modules of a read-only
installation are linked into the user's cache or, where that is read-only too, into a folder that
lasts as long as the process. An entry of the index holds version, processor and a hash of the
source, so that Numba compiles again what does not fit.
"""

import os
import sys
from collections.abc import Iterator
from contextlib import suppress
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tempfile import TemporaryDirectory

_INDEX, _DATA = ".nbi", ".nbc"  # suffixes of Numba's files
_PACKAGE = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))


def prepare_kernel_cache(package: str = _PACKAGE) -> "TemporaryDirectory[str] | None":
    """Link the kernels of a read-only installation to where Numba finds them.

    Sets the environment variable NUMBA_CACHE_DIR only if Numba finds no folder to write to: it
    would refuse to start.

    Returns
    -------
    TemporaryDirectory or None
        The folder that lasts as long as the process, if there is one.
    """
    if "NUMBA_CACHE_DIR" in os.environ or _is_writable(package):
        return None
    if _is_writable(user_cache()):
        link_kernels(package, user_cache())
        return None
    from tempfile import TemporaryDirectory

    folder = TemporaryDirectory(prefix="inercal-")
    os.environ["NUMBA_CACHE_DIR"] = folder.name
    if (config := sys.modules.get("numba.core.config")) is not None:  # it has read the variable
        vars(config)["CACHE_DIR"] = folder.name
    link_kernels(package, folder.name)
    return folder


def count_kernels() -> tuple[str, int]:
    """Return the folder that holds the compiled kernels of this package, and their number."""
    given = os.environ.get("NUMBA_CACHE_DIR")
    if given is None and _is_writable(_PACKAGE):
        return _PACKAGE, sum(_count(kept) for _, kept in _folders_of_kernels(_PACKAGE))
    cache = given or user_cache()
    own = (cache_folder(modules, cache) for modules, _, _ in os.walk(_PACKAGE))
    return cache, sum(_count(folder) for folder in own if os.path.isdir(folder))


def _count(folder: str) -> int:
    return sum(name.endswith(_DATA) for name in os.listdir(folder))


def user_cache() -> str:
    """Return the folder of the user's kernels, as Numba computes it."""
    if sys.platform == "win32":
        local = os.environ.get("LOCALAPPDATA") or os.path.join("~", "AppData", "Local")
        return os.path.join(os.path.expanduser(local), "numba", "Cache")
    if sys.platform == "darwin":
        return os.path.expanduser("~/Library/Caches/numba")
    base = os.environ.get("XDG_CACHE_HOME") or os.path.join("~", ".cache")
    return os.path.join(os.path.expanduser(base), "numba")


def cache_folder(modules: str, cache: str) -> str:
    """Return the folder in a cache for the kernels of a folder of modules, as Numba names it."""
    from hashlib import sha1

    path = os.path.abspath(modules)
    return os.path.join(cache, f"{os.path.basename(path)}_{sha1(path.encode()).hexdigest()}")


def link_kernels(package: str, cache: str) -> None:
    """Link the kernels beside the modules of a package into a cache.

    Newer kernels of the cache stay. What cannot be linked is compiled when it is used.
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
                    for one in (*data, name):  # the index last: it names the data
                        _link(os.path.join(kept, one), os.path.join(own, one))


def _folders_of_kernels(package: str) -> Iterator[tuple[str, str]]:
    for modules, folders, _ in os.walk(package):
        if "__pycache__" in folders:
            folders.remove("__pycache__")
            yield modules, os.path.join(modules, "__pycache__")


def _is_older(own: str, kept: str, name: str) -> bool:
    """Return whether a cache lacks a file, or has an older one."""
    mine, installed = os.path.join(own, name), os.path.join(kept, name)
    if os.path.islink(mine):
        return os.readlink(mine) != installed
    return not os.path.exists(mine) or os.stat(mine).st_mtime < os.stat(installed).st_mtime


def _link(kept: str, own: str) -> None:
    """Link a file, or copy it where links are not allowed; whatever was there is replaced."""
    made = f"{own}.{os.getpid()}"
    try:
        os.symlink(kept, made)
    except OSError:
        import shutil

        shutil.copyfile(kept, made)
    os.replace(made, own)


def _is_writable(folder: str) -> bool:
    """Return whether files can be made in a folder, or the folder itself if it does not exist."""
    while not os.path.exists(folder) and os.path.dirname(folder) != folder:
        folder = os.path.dirname(folder)
    return os.access(folder, os.W_OK | os.X_OK)
