"""A server of the page with a scripted run, and the page of who operates it."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.host.web.pages import Page, Served, unharmed


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Served]:
    with Served(tmp_path) as server:
        yield server


@pytest.fixture
def watched(served: Served) -> Iterator[Page]:
    """Return the page of the operator of a run that goes on."""
    with served.page() as page:
        page.operate()
        page.start()
        yield page
        unharmed(page)
        page.say("abort")
        page.until("done", words="aborted")
