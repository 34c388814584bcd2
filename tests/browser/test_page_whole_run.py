"""The page before a real simulated bench: a whole run, by keyboard alone."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect
from tests.browser.conftest import PageErrors
from tests.browser.page_actions import tab_to
from tests.host.simulated_runs import plan, quick
from tests.host.web.test_web_process_survival import Serving

from inercal.calibration.files import load

STARTING, RUNNING = 300_000.0, 180_000.0  # ms; what a run needs is compiled once on a machine
NAME = "ax.k0"
VALUE = re.compile(r"([-−+]?[\d.]+) ±\s([\d.]+)")


def shown(page: Page, name: str) -> tuple[float, float]:
    """Return value and ±2σ of a coefficient, as they stand there."""
    text = page.locator(f'[data-name="{name}"] .value').inner_text()
    found = VALUE.search(text)
    assert found, text
    return float(found[1].replace("−", "-")), float(found[2])


def pressed(page: Page, key: str) -> None:
    """Press a key that is for the page, not for what has the focus."""
    page.locator("body").press(key)


@pytest.fixture
def serving(tmp_path: Path) -> Iterator[Serving]:
    plan(tmp_path / "plans", quick())
    with Serving(tmp_path, "--speed", "15") as serving:
        yield serving


@pytest.mark.slow
def test_a_run_is_set_up_watched_paused_finished_and_read_by_keyboard_alone(
    page: Page, watched: PageErrors, serving: Serving, tmp_path: Path
):
    page.goto(f"http://127.0.0.1:{serving.port}/")
    expect(page.get_by_role("heading", name="Set up a run")).to_be_visible()
    tab_to(page, "Name")
    page.keyboard.type("Ada")
    # A server that has just started imports what reads a plan first.
    expect(page.get_by_role("radio", name="plan.toml")).to_be_visible(timeout=STARTING)
    tab_to(page, "plan.toml")
    page.keyboard.press("Space")
    tab_to(page, "#start")
    page.keyboard.press("Enter")
    tab_to(page, "#start-yes")
    page.keyboard.press("Enter")
    live = page.locator("#live")
    expect(live).to_be_visible(timeout=STARTING)
    value = page.locator(f'[data-name="{NAME}"] .value')
    expect(value).to_have_text(VALUE, timeout=RUNNING)
    _, first = shown(page, NAME)

    pressed(page, "p")
    # The event comes before the state that keys go by.
    expect(page.locator("#go-on")).to_be_enabled()
    expect(page.get_by_text("paused by the operator").first).to_be_visible()
    pressed(page, "g")
    expect(page.get_by_role("heading", name="simulated MIMU")).to_be_visible()

    report = page.locator("#results a[href$=report]")
    expect(report).to_be_visible(timeout=RUNNING)
    last, u2 = shown(page, NAME)
    assert u2 < first / 3
    (folder,) = (tmp_path / "runs").iterdir()
    made = load(folder / "plan.calibration.json")
    size = made.sensor.coefficient(NAME).si
    assert last == pytest.approx(made.value(NAME) / size, abs=u2 / 10)

    tab_to(page, report.inner_text())
    with page.context.expect_page() as opened:
        page.keyboard.press("Enter")
    read = opened.value
    expect(read.get_by_role("heading", name="simulated MIMU").first).to_be_visible()
