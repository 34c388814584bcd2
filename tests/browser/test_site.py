"""The documentation site: built without a warning, read offline, narrow too, and searched."""

import html
import subprocess
import sys
from pathlib import Path
from zipfile import ZipFile

import pytest
from playwright.sync_api import Browser

DOCS = Path(__file__).parents[2] / "docs"
PAGES = (
    "index",
    "tutorials/first-calibration",
    "notebooks/compare_methods",
    "notebooks/noise_to_filter",
    "notebooks/quickstart",
    "reference/run-file",
    "reference/python",
    "reference/dependencies",
    "reference/speed",
)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    sphinx = [sys.executable, "-m", "sphinx", "--quiet", "--fail-on-warning", "--keep-going"]
    made = subprocess.run(
        [*sphinx, str(DOCS), str(folder)], capture_output=True, text=True, check=False
    )
    assert made.returncode == 0, made.stderr
    return folder


@pytest.mark.slow
def test_every_page_of_the_index_is_in_the_site(site: Path):
    pages = {path.relative_to(DOCS).with_suffix("") for path in DOCS.rglob("*.md")}
    missing = {page for page in pages if not (site / page).with_suffix(".html").is_file()}
    assert not missing


@pytest.mark.slow
def test_options_can_be_copied_from_the_page_of_verbs(site: Path):
    text = html.unescape((site / "reference/verbs.html").read_text(encoding="utf-8"))
    assert '--set "data.rate=100 Hz"' in text
    assert not set(text) & set("–“”")


@pytest.mark.slow
def test_the_examples_are_a_download_of_each_tutorial(site: Path):
    examples = DOCS.parent / "examples"
    with ZipFile(site / "examples.zip") as archive:
        packed = {name: archive.read(name) for name in archive.namelist()}
    files = [path for path in examples.rglob("*") if path.is_file()]
    assert packed == {
        path.relative_to(DOCS.parent).as_posix(): path.read_bytes()
        for path in files
        if "__pycache__" not in path.parts
    }
    for page in (site / "tutorials").glob("*.html"):
        assert 'href="../examples.zip"' in page.read_text(encoding="utf-8"), page.name


@pytest.mark.slow
@pytest.mark.parametrize("width", [400, 1300])
def test_pages_are_read_offline_and_fit_the_screen(browser: Browser, site: Path, width: int):
    context = browser.new_context(viewport={"width": width, "height": 900}, offline=True)
    page = context.new_page()
    asked: list[str] = []
    errors: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.on("pageerror", lambda error: errors.append(str(error)))
    for name in PAGES:
        page.goto((site / name).with_suffix(".html").as_uri())
        assert page.evaluate("document.documentElement.scrollWidth") <= width, name
    context.close()
    assert {url.split(":")[0] for url in asked} <= {"file", "data"}
    assert not errors


@pytest.mark.slow
def test_a_search_finds_the_page_of_its_words(browser: Browser, site: Path):
    page = browser.new_page()
    page.goto((site / "search.html").as_uri() + "?q=dividing+head")
    found = page.locator("ul.search a")
    found.first.wait_for()
    assert any("dividing-head" in (one.get_attribute("href") or "") for one in found.all())
    page.close()
