"""A browser for the page: Chromium as the system has it, driven by playwright, no download."""

from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import Browser, BrowserContext, ConsoleMessage, Page, sync_playwright
from tests.browser.scripted_server import ScriptedServer

CHROMIUM = Path("/usr/bin/chromium")
PATIENCE = 20_000.0  # ms


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    # Not for the session: while playwright is open its event loop counts as running in this
    # thread, and no test of another module could run its own.
    if not CHROMIUM.exists():
        pytest.skip(f"no browser: {CHROMIUM} is missing (on Debian the package chromium)")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


class PageErrors:
    """What went wrong in a page.

    Attributes
    ----------
    errors : list of str
        Of the console, and those that nothing caught.
    elsewhere : list of str
        Requests to other hosts than 127.0.0.1.
    """

    def __init__(self, context: BrowserContext):
        self.errors: list[str] = []
        self.elsewhere: list[str] = []
        context.on("console", self._said)
        context.on("weberror", lambda error: self.errors.append(str(error.error)))
        context.on("request", lambda request: self._asked(request.url))

    def watch(self, page: Page) -> None:
        """Watch the websockets of a page too."""
        page.on("websocket", lambda made: self._asked(made.url))

    def _said(self, message: ConsoleMessage) -> None:
        if message.type in ("error", "warning"):
            self.errors.append(f"{message.type}: {message.text} ({message.location.get('url')})")

    def _asked(self, url: str) -> None:
        parts = urlsplit(url)
        if parts.scheme not in ("about", "blob", "data") and parts.hostname != "127.0.0.1":
            self.elsewhere.append(url)


@pytest.fixture
def context(browser: Browser) -> Iterator[BrowserContext]:
    context = browser.new_context(viewport={"width": 1400, "height": 1000})
    context.set_default_timeout(PATIENCE)
    yield context
    context.close()


@pytest.fixture
def watched(context: BrowserContext) -> Iterator[PageErrors]:
    """Give what goes wrong; at the end that is nothing."""
    watched = PageErrors(context)
    yield watched
    assert not watched.elsewhere, f"requests to other hosts: {watched.elsewhere}"
    assert not watched.errors, f"the console says {watched.errors}"


@pytest.fixture
def page(context: BrowserContext, watched: PageErrors) -> Page:
    page = context.new_page()
    watched.watch(page)
    return page


@pytest.fixture
def scripted() -> Iterator[ScriptedServer]:
    with ScriptedServer() as server:
        yield server
