"""What tests of the page do with it."""

import re

import pytest
from playwright.sync_api import Page, expect
from tests.browser import messages
from tests.browser.conftest import PATIENCE
from tests.browser.scripted_server import ScriptedServer

expect.set_options(timeout=PATIENCE)


def open_page(page: Page, server: ScriptedServer, *said: messages.Message) -> Page:
    """Open the page of a bench that says something at once."""
    if said:
        server.says = list(said)
    page.goto(server.address)
    expect(page.locator("#link[data-link=live]")).to_be_visible()
    return page


def open_running_page(page: Page, server: ScriptedServer, time: float = 100.0) -> Page:
    """Open the page while a run goes on."""
    said = [messages.estimates(time * k / 20) for k in range(1, 21)]
    begins = messages.event(0.0, "the run begins")
    open_page(
        page, server, messages.plan(), *said, messages.samples(time - 10, time), begins,
        messages.state(time),
    )  # fmt: skip
    expect(page.locator("#clock[data-time]")).to_be_visible()  # the last message has come
    return page


def take_control(page: Page, server: ScriptedServer, name: str = "Ada") -> Page:
    """Take control of a run, by its dialog."""
    page.locator("#control").click()
    page.get_by_role("dialog").get_by_label("Name").fill(name)
    page.keyboard.press("Enter")
    assert server.order("operate")["name"] == name
    expect(page.locator("#people[data-operator=me]")).to_be_visible()
    return page


def choose_plan(page: Page, file: str = "mimu.toml") -> None:
    """Choose a plan of the set-up."""
    page.get_by_role("radio", name=re.compile(re.escape(file))).check()


def confirm_start(page: Page) -> None:
    """Press the button that starts, and the one of the question that follows."""
    page.locator("#start").click()
    page.locator("#start-yes").click()


def tab_to(page: Page, what: str) -> None:
    """Press Tab until what has the focus has a name, or an id where that is "#id"."""
    for _ in range(80):
        page.keyboard.press("Tab")
        if what.startswith("#"):
            found = page.evaluate("id => `#${document.activeElement.id}` === id", what)
        else:
            found = what in accessible_text_of_focus(page)
        if found:
            return
    pytest.fail(f"Tab does not lead to {what}")


def accessible_text_of_focus(page: Page) -> str:
    """Return what a reader says of what has the focus, near enough; "" where nothing has it."""
    return page.evaluate(
        """() => { const e = document.activeElement;
        if (e === document.body) return "";  // its text has every name
        const label = e.labels?.[0]?.textContent;
        const words = e.getAttribute("aria-label") ?? label ?? e.textContent;
        return words.replaceAll(/\\s+/g, " ").trim(); }"""
    )
