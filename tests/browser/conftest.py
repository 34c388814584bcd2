"""A browser for the page: Chromium as the system has it, driven by playwright, no download."""

from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import Browser, ConsoleMessage, Page, ViewportSize, sync_playwright
from tests.browser.scripted_server import ScriptedServer

CHROMIUM = Path("/usr/bin/chromium")
PATIENCE = 20_000.0  # ms
SIZE: ViewportSize = {"width": 1400, "height": 1000}


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
    """What went wrong in the pages of a context.

    Attributes
    ----------
    errors : list of str
        Of the console, and those that nothing caught.
    elsewhere : list of str
        Requests to other hosts than 127.0.0.1.
    """

    def __init__(self):
        self.errors: list[str] = []
        self.elsewhere: list[str] = []
        self._heard: dict[str, Callable[[Any], None]] = {
            "console": self._said,
            "weberror": lambda error: self.errors.append(str(error.error)),
            "request": lambda request: self._asked(request.url),
        }

    @contextmanager
    def watch(self, page: Page) -> Generator[None]:
        """Watch the context of a page, and the page's websockets."""
        listeners: list[tuple[Any, str, Callable[[Any], None]]] = [
            (page.context, event, listener) for event, listener in self._heard.items()
        ]
        listeners.append((page, "websocket", lambda made: self._asked(made.url)))
        for source, event, listener in listeners:
            source.on(event, listener)
        yield
        for source, event, listener in listeners:
            source.remove_listener(event, listener)

    def _said(self, message: ConsoleMessage) -> None:
        if message.type in ("error", "warning"):
            self.errors.append(f"{message.type}: {message.text} ({message.location.get('url')})")

    def _asked(self, url: str) -> None:
        parts = urlsplit(url)
        if parts.scheme not in ("about", "blob", "data") and parts.hostname != "127.0.0.1":
            self.elsewhere.append(url)


class Pages:
    """The page that tests have one after the other: a new one takes four times as long to load."""

    def __init__(self, browser: Browser):
        self._browser = browser
        self._page: Page | None = None

    def open(self) -> Page:
        """Return an empty page of a context without cookies, storage or other pages."""
        if self._page is None:
            context = self._browser.new_context(viewport=SIZE)
            context.set_default_timeout(PATIENCE)
            self._page = context.new_page()
        self._page.set_viewport_size(SIZE)
        self._page.emulate_media(color_scheme="light")
        self._page.mouse.move(0, 0)
        return self._page

    def clear(self) -> None:
        """Leave nothing of a test in the page."""
        page = self._page
        assert page is not None
        for other in page.context.pages:
            if other is not page:
                other.close()
        if page.url.startswith("http"):
            page.evaluate("localStorage.clear(), sessionStorage.clear()")
        page.context.clear_cookies()
        page.goto("about:blank")

    def close(self) -> None:
        """Close the page with its context; the next test has another."""
        if self._page is not None:
            self._page.context.close()
        self._page = None


@pytest.fixture(scope="module")
def pages(browser: Browser) -> Iterator[Pages]:
    pages = Pages(browser)
    yield pages
    pages.close()


@pytest.fixture
def watched() -> Iterator[PageErrors]:
    """Give what goes wrong; at the end that is nothing."""
    watched = PageErrors()
    yield watched
    assert not watched.elsewhere, f"requests to other hosts: {watched.elsewhere}"
    assert not watched.errors, f"the console says {watched.errors}"


@pytest.fixture
def page(pages: Pages, watched: PageErrors, request: pytest.FixtureRequest) -> Iterator[Page]:
    """Give an empty page; its document, storage and size are those of this test alone."""
    failed = request.session.testsfailed
    page = pages.open()
    with watched.watch(page):
        yield page
        if request.session.testsfailed > failed:  # it may be in any state
            pages.close()
        else:
            pages.clear()


@pytest.fixture
def own_page(browser: Browser, watched: PageErrors) -> Iterator[Page]:
    """Give a page that no other test has, for scripts that are added to it."""
    context = browser.new_context(viewport=SIZE)
    context.set_default_timeout(PATIENCE)
    page = context.new_page()
    with watched.watch(page):
        yield page
        context.close()


@pytest.fixture(scope="module")
def scripted_server() -> Iterator[ScriptedServer]:
    with ScriptedServer() as server:
        yield server


@pytest.fixture
def scripted(scripted_server: ScriptedServer) -> ScriptedServer:
    """Give a server that nobody is connected to, as it was when it began."""
    scripted_server.forget()
    return scripted_server
