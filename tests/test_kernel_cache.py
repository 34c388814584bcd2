"""Kernels of a read-only installation: where they are found, and what is compiled."""

import inspect
import os
import subprocess
import sys
from pathlib import Path
from shutil import copyfile, copytree

import pytest
from numba.core.caching import UserWideCacheLocator
from numba.misc.appdirs import AppDirs

from inercal.basics.kernel_cache import cache_folder, link_kernels, user_cache

MODULE = """
from numba import njit

@njit(cache=True)
def doubled(x):
    return 2 * x
"""
# A folder that cannot be written to: root could write, whatever the permissions.
READ_ONLY = """
import os, tempfile
granted, temporary = os.access, tempfile.TemporaryFile
def is_locked(path): return str(path).startswith(LOCKED)
os.access = lambda path, mode, **_: granted(path, mode) and not (mode & os.W_OK and is_locked(path))
def refused(*args, dir=None, **keys):
    if is_locked(dir):
        raise PermissionError(dir)
    return temporary(*args, dir=dir, **keys)
tempfile.TemporaryFile = refused
"""
CALL = """
import sys
sys.path.insert(0, PACKAGE_PARENT)
import inercal  # of a writable tree: links nothing here
from inercal.basics.kernel_cache import prepare_kernel_cache
folder = prepare_kernel_cache(PACKAGE)
from kernels.one import doubled
assert doubled(ARGUMENT) == 2 * ARGUMENT
print(sum(doubled.stats.cache_hits.values()), sum(doubled.stats.cache_misses.values()))
"""


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a package with one kernel, compiled for integers."""
    tmp_path = tmp_path_factory.mktemp("built")
    result = tmp_path / "kernels"
    result.mkdir()
    (result / "__init__.py").touch()
    (result / "one.py").write_text(MODULE, encoding="utf-8")
    assert call(result, tmp_path / "home") == "0 1"
    return result


@pytest.fixture
def package(installed: Path, tmp_path: Path) -> Path:
    """Return a copy of the package: its path and the times of its files are others."""
    return copytree(installed, tmp_path / "copied" / "kernels", copy_function=copyfile)


def call(
    package: Path, home: Path, argument: str = "21", locked: tuple[Path, ...] | None = None
) -> str:
    """Return how often a process that calls the kernel loads it and compiles it."""
    home.mkdir(exist_ok=True)
    names = {"PACKAGE": str(package), "PACKAGE_PARENT": str(package.parent)}
    values = [*(f"{name} = {value!r}\n" for name, value in names.items()), f"ARGUMENT = {argument}"]
    lock = "" if locked is None else f"LOCKED = {tuple(map(str, locked))!r}" + READ_ONLY
    environment = {**os.environ, "HOME": str(home), "USERPROFILE": str(home)}
    environment |= {"LOCALAPPDATA": str(home)}
    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"):
        environment.pop(name, None)
    command = [sys.executable, "-c", "".join(values) + "\n" + lock + CALL]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.mark.slow
def test_a_read_only_installation_and_home_compile_nothing(package: Path, tmp_path: Path):
    home = tmp_path / "home"
    assert call(package, home, locked=(package, home)) == "1 0"
    # Arguments of another type are compiled, into a folder that goes with the process.
    assert call(package, home, "0.5", locked=(package, home)) == "0 1"


@pytest.mark.slow
def test_a_read_only_installation_adds_to_its_kernels_in_the_users_cache(
    package: Path, tmp_path: Path
):
    home = tmp_path / "home"
    assert call(package, home, locked=(package,)) == "1 0"
    assert call(package, home, "0.5", locked=(package,)) == "0 1"
    assert call(package, home, "0.5", locked=(package,)) == "1 0"


@pytest.mark.slow
def test_a_changed_source_is_compiled_again(package: Path, tmp_path: Path):
    home = tmp_path / "home"
    assert call(package, home, locked=(package,)) == "1 0"
    with (package / "one.py").open("a", encoding="utf-8") as file:
        file.write("# changed\n")
    assert call(package, home, locked=(package,)) == "0 1"


@pytest.mark.slow
def test_a_kernel_of_a_type_that_moved_is_compiled_again(tmp_path: Path):
    package, home = tmp_path / "kernels", tmp_path / "home"
    package.mkdir()
    (package / "__init__.py").touch()
    source = """
from inercal.estimation.kernel_options import njit
from kernels.{} import Pair

@njit(cache=True)
def summed(pair):
    return pair.first + pair.second

def doubled(x):
    return summed(Pair(x, x))

doubled.stats = summed.stats
"""
    pair = """
from typing import NamedTuple

class Pair(NamedTuple):
    first: int
    second: int
"""
    for place, before in (("forms", None), ("shapes", "forms")):
        (package / "one.py").write_text(source.format(place), encoding="utf-8")
        (package / f"{place}.py").write_text(pair, encoding="utf-8")
        if before is not None:
            (package / f"{before}.py").unlink()
        assert call(package, home) == "0 1"
        assert call(package, home) == "1 0"


def test_folders_have_the_names_that_numba_gives_them(tmp_path: Path):
    module = tmp_path / "one.py"
    assert inspect.isclass(UserWideCacheLocator)
    name = UserWideCacheLocator.get_suitable_cache_subpath(str(module))
    assert cache_folder(str(tmp_path), "cache") == os.path.join("cache", name)
    assert user_cache() == AppDirs(appname="numba", appauthor=False).user_cache_dir


def test_newer_kernels_of_the_user_stay_and_older_ones_are_replaced(tmp_path: Path):
    kept = tmp_path / "modules" / "__pycache__"
    kept.mkdir(parents=True)
    for name in ("old.py311.nbi", "old.py311.1.nbc", "new.py311.nbi", "new.py311.1.nbc"):
        (kept / name).write_text("installed")
        os.utime(kept / name, (100, 100))
    own = Path(cache_folder(str(kept.parent), str(tmp_path / "cache")))
    own.mkdir(parents=True)
    for name, time in (("old.py311.nbi", 50), ("new.py311.nbi", 150)):
        (own / name).write_text("mine")
        os.utime(own / name, (time, time))
    for _ in range(2):
        link_kernels(str(kept.parent), str(tmp_path / "cache"))
        found = {path.name: path.read_text() for path in own.iterdir()}
        assert found == {
            "old.py311.nbi": "installed",
            "old.py311.1.nbc": "installed",
            "new.py311.nbi": "mine",
        }
