"""Source archive and wheel: what they hold, and that their metadata are what an index takes."""

import sys
import tarfile
from importlib.util import find_spec
from pathlib import Path
from zipfile import ZipFile

import pytest
from markdown_it import MarkdownIt
from markdown_it.token import Token
from packaging.metadata import Metadata
from tests.install.test_wheel import ROOT, run
from trove_classifiers import classifiers

HELD = {
    *("src", "tests", "tools", "benchmarks", "examples", "docs", "Makefile", "requirements.lock"),
    *("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "CITATION.cff", "LICENSE"),
    *("pyproject.toml", "PKG-INFO", ".gitignore"),
    *("Containerfile", ".containerignore", ".dockerignore"),
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


def description(folder: Path) -> str:
    """Return the long description in the metadata of the wheel."""
    (wheel,) = folder.glob("*.whl")
    with ZipFile(wheel) as archive:
        (name,) = (one for one in archive.namelist() if one.endswith("/METADATA"))
        return archive.read(name).decode("utf-8").split("\n\n", 1)[1]


def blocks(text: str, *kinds: str) -> list[Token]:
    """Return the tokens of some kinds of a Markdown text, also those inside paragraphs."""
    tokens = MarkdownIt("gfm-like", {"linkify": False}).parse(text)
    every = [one for token in tokens for one in (token, *(token.children or ()))]
    return [one for one in every if one.type in kinds]


def link_targets(text: str) -> list[str]:
    """Return the addresses of the links and pictures of a Markdown text."""
    found = blocks(text, "link_open", "image")
    return [str(one.attrs.get("href", one.attrs.get("src"))) for one in found]


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
    headings = [line for line in readme.splitlines() if line.startswith("#")]
    assert headings == [line for line in description(built).splitlines() if line.startswith("#")]


def test_the_long_description_has_no_relative_picture_or_link(built: Path):
    targets = link_targets(description(built))
    assert [one for one in targets if not one.startswith("https://")] == []


def test_the_long_description_holds_the_code_of_the_readme(built: Path):
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    code = [block.content for block in blocks(readme, "fence")]
    assert code
    assert [block.content for block in blocks(description(built), "fence")] == code


def test_the_readme_has_relative_pictures_and_links():
    targets = link_targets((ROOT / "README.md").read_text(encoding="utf-8"))
    assert {"docs/images/report.png", "docs/index.md"} <= set(targets)


@pytest.mark.skipif(find_spec("twine") is None, reason="twine is not installed")
def test_twine_accepts_both(built: Path):
    done = run(sys.executable, "-m", "twine", "check", "--strict", *built.iterdir(), folder=ROOT)
    assert done.returncode == 0, done.stdout + done.stderr
