"""Source archive and wheel: what they hold, and that their metadata are what an index takes."""

import sys
import tarfile
from importlib.util import find_spec
from pathlib import Path
from zipfile import ZipFile

import pytest
from packaging.metadata import Metadata
from tests.install.test_wheel import ROOT, run
from trove_classifiers import classifiers

HELD = {
    *("src", "tests", "tools", "benchmarks", "examples", "docs", "Makefile", "requirements.lock"),
    *("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "CITATION.cff", "LICENSE"),
    *("pyproject.toml", "PKG-INFO", ".gitignore"),
}
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the source archive and the wheel."""
    folder = tmp_path_factory.mktemp("built")
    for target in ("sdist", "wheel"):
        command = (sys.executable, "-m", "hatchling", "build", "-t", target, "-d", folder)
        made = run(*command, folder=ROOT)
        assert made.returncode == 0, made.stderr
    return folder


def contents(wheel: Path) -> dict[str, int]:
    """Return the check sums of the files of a wheel."""
    with ZipFile(wheel) as archive:
        return {one.filename: one.CRC for one in archive.infolist()}


def test_the_source_archive_holds_what_builds_tests_and_explains(built: Path):
    (path,) = built.glob("*.tar.gz")
    with tarfile.open(path) as archive:
        names = [name.split("/", 1)[1] for name in archive.getnames()]
    assert {name.split("/")[0] for name in names} == HELD
    assert not [name for name in names if "__pycache__" in name or name.endswith((".nbi", ".nbc"))]


def test_the_wheel_of_the_source_archive_is_that_of_the_repository(built: Path, tmp_path: Path):
    (path,) = built.glob("*.tar.gz")
    with tarfile.open(path) as archive:
        archive.extractall(tmp_path, filter="data")
    (folder,) = tmp_path.iterdir()
    done = run(sys.executable, "-m", "hatchling", "build", "-t", "wheel", folder=folder)
    assert done.returncode == 0, done.stderr
    (again,) = (folder / "dist").glob("*.whl")
    (wheel,) = built.glob("*.whl")
    assert contents(again) == contents(wheel)


def test_the_metadata_are_valid_and_hold_the_readme(built: Path):
    (wheel,) = built.glob("*.whl")
    with ZipFile(wheel) as archive:
        (name,) = (one for one in archive.namelist() if one.endswith("/METADATA"))
        text = archive.read(name)
    found = Metadata.from_email(text, validate=True)
    assert found.description_content_type == "text/markdown"
    assert found.license_expression == "Apache-2.0"
    assert set(found.classifiers or ()) <= classifiers
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert text.decode("utf-8").split("\n\n", 1)[1].strip() == readme.strip()


@pytest.mark.skipif(find_spec("twine") is None, reason="twine is not installed")
def test_twine_accepts_both(built: Path):
    done = run(sys.executable, "-m", "twine", "check", "--strict", *built.iterdir(), folder=ROOT)
    assert done.returncode == 0, done.stdout + done.stderr
