"""A run on a table of rates on the page: the mounting is confirmed, and no pane stands empty."""

from typing import Any

import pytest
from playwright.sync_api import Page, expect
from tests.base_seeds import evidence
from tests.browser import messages
from tests.browser.page_actions import open_page, take_control
from tests.browser.scripted_server import ScriptedServer

pytestmark = pytest.mark.slow

REQUEST = {
    "number": 3,
    "mounting": "YX30",
    "instruction": "mount the sensor as YX30: +z up, tilted 30° (+y rises)",
}
CHANNELS = messages.plan()["channels"][:3]


def ship_plan() -> dict[str, Any]:
    steps = [{"label": f"XY_{k}", "what": "at rest", "seconds": 150.0} for k in range(9)]
    return messages.plan(
        axes=["table"], spins=True, live=False, channels=CHANNELS, steps=steps
    )  # fmt: skip


def ship_state(time: float, **changed: Any) -> dict[str, Any]:
    axis = {"angle": 77400.0, "rate": 276.12, "error": None, "state": "turns", "fault": False}
    return messages.state(
        time, table={"axes": [axis]}, set_rate=276.0, attitude=None, live="none", done=3,
        **{"mounting": None, **changed},
    )  # fmt: skip


def test_only_who_operates_confirms_a_mounting(page: Page, scripted: ScriptedServer):
    open_page(page, scripted, ship_plan(), ship_state(10.0, phase="mount", mounting=REQUEST))
    confirm = page.locator("#mounted")
    expect(page.get_by_text("Mount the sensor as YX30")).to_be_visible()
    expect(confirm).to_have_attribute("aria-disabled", "true")
    confirm.click(force=True)
    take_control(page, scripted)
    expect(confirm).to_have_attribute("aria-disabled", "false")
    confirm.press("Enter")
    assert scripted.order("mounted") == {"do": "mounted", "number": 3, "mounting": "YX30"}
    assert sum(one.get("do") == "mounted" for one in scripted.heard) == 1
    scripted.tell(ship_state(11.0, phase="approach"))
    expect(confirm).to_be_hidden()


@pytest.mark.parametrize("width", [1366, evidence(768), 400])
def test_set_and_actual_rate_are_shown_and_no_empty_panes(
    page: Page, scripted: ScriptedServer, width: int
):
    page.set_viewport_size({"width": width, "height": 768})
    open_page(page, scripted, ship_plan(), ship_state(10.0, phase="work"))
    row = page.locator("#axes tbody tr")
    expect(row).to_contain_text("46.00")
    expect(row.locator("td").nth(1)).to_have_text("46.02")
    for hidden in ("#attitude", "#course", "#estimates", "#mounting"):
        expect(page.locator(hidden)).to_be_hidden()
    expect(page.locator("#steps")).to_be_visible()
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
