"""The layout of every page on a laptop and on a phone, measured: nothing is cut off or wraps."""

from collections.abc import Callable
from typing import Any, NamedTuple

import pytest
from playwright.sync_api import Page, expect
from tests.base_seeds import slow
from tests.browser import messages
from tests.browser.page_actions import open_page, open_running_page, take_control
from tests.browser.scripted_server import ScriptedServer
from tests.browser.test_page_manual import manual_plan, manual_state

LAPTOP, PHONE = {"width": 1366, "height": 768}, {"width": 400, "height": 800}
ALARM = "axis inner: following error 0.52° beyond 0.5°: the table was stopped"
# The text of an element that is wider or higher than its box is cut off; so is what its scrolling
# parent does not show. What is hidden on purpose has no box, or one of a pixel for screen readers.
CUT_OFF = """() => [...document.querySelectorAll("body *")].filter((one) => {
  const text = [...one.childNodes].some((n) => n.nodeType === 3 && n.data.trim());
  if (!text || !one.checkVisibility() || one.closest(".unseen, option, .u-over")) return false;
  const range = document.createRange(); range.selectNodeContents(one);
  const boxes = "td, th, button, dd, p, h1, h2, section, header, footer, label, li, dialog";
  const [own, box] = [range, one.closest(boxes)].map((of) => of.getBoundingClientRect());
  return own.right > Math.min(box.right, innerWidth) + 1 || own.left < Math.max(box.left, 0) - 1;
}).map((one) => `${one.tagName} ${one.id} ${one.className}: ${one.textContent.trim()}`)"""
LINES = """(one) => { const range = document.createRange(); range.selectNodeContents(one);
  return new Set([...range.getClientRects()].map(({ bottom }) => Math.round(bottom / 8))).size; }"""


class Scene(NamedTuple):
    """A state of the page: how it is reached, and what is then in sight."""

    reach: Callable[[Page, ScriptedServer], Any]
    visible: str


def _run(page: Page, server: ScriptedServer) -> None:
    open_running_page(page, server, 700.0)
    take_control(page, server)


def _alarm(page: Page, server: ScriptedServer) -> None:
    _run(page, server)
    server.tell(messages.event(699.0, ALARM, "alarm"))


def _finished(page: Page, server: ScriptedServer) -> None:
    _run(page, server)
    server.tell(messages.state(messages.SECONDS), messages.done())


def _large(page: Page, server: ScriptedServer) -> None:
    """Show the widest numbers: estimates of the first seconds, coefficients of a poor sensor."""
    _run(page, server)
    wide = messages.estimates(700.0)
    server.tell(wide | {"time": 701.0, "values": [-123456.7] * 24, "u2": [12345.6] * 24})
    expect(page.locator('[data-name="ax.k0"] .value')).to_contain_text("123")


def _manual(page: Page, server: ScriptedServer) -> None:
    open_page(page, server, manual_plan(), *(manual_state(0.1 * k) for k in range(1, 40)))
    take_control(page, server)


def _manual_alarm(page: Page, server: ScriptedServer) -> None:
    _manual(page, server)
    server.tell(messages.event(3.9, ALARM, "alarm"))


SCENES = {
    "setup": Scene(open_page, "#plans .plan"),
    "run": Scene(_run, "#coefficients"),
    "alarm": Scene(_alarm, ".ringing"),
    "finished": Scene(_finished, "#finished"),
    "large numbers": Scene(_large, "#coefficients"),
    "manual": Scene(_manual, "#manual-axes"),
    "manual with an alarm": Scene(_manual_alarm, ".ringing"),
}


def require_whole(page: Page, name: str, size: Any) -> None:
    """Require that in this size no text of a scene is cut off and Stop is in sight."""
    page.set_viewport_size(size)
    page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    expect(page.locator(SCENES[name].visible).first).to_be_visible()
    assert page.evaluate(CUT_OFF) == []
    assert page.evaluate("document.documentElement.scrollWidth") <= size["width"]
    expect(page.locator("#stop")).to_be_in_viewport(ratio=1)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [slow(one) if one in ("finished", "manual", "manual with an alarm") else one for one in SCENES],
)
def test_laptop_and_phone_cut_nothing_off_and_show_what_each_has_room_for(
    page: Page, scripted: ScriptedServer, name: str
):
    """A laptop shows all estimates, and no line of its header wraps; a phone's header is low."""
    page.set_viewport_size(LAPTOP)  # type: ignore[arg-type]
    SCENES[name].reach(page, scripted)
    require_whole(page, name, LAPTOP)
    if name in ("run", "alarm", "finished", "large numbers"):
        cells = page.locator("#coefficients .value")
        expect(cells).to_have_count(24)
        for k in range(24):
            expect(cells.nth(k)).to_be_in_viewport(ratio=1)
    texts = page.locator("header :is(p, h1, button):visible")
    for k in range(texts.count()):
        assert texts.nth(k).evaluate(LINES) == 1, texts.nth(k).inner_text()
    centres = page.locator("header > :is(.title, .now, .people, .buttons, .stop):visible")
    middles = centres.evaluate_all(
        """all => all.map((one) => one.getBoundingClientRect())
        .map(({ top, bottom }) => (top + bottom) / 2)"""
    )
    assert max(middles) - min(middles) < 20

    require_whole(page, name, PHONE)
    assert page.evaluate("document.querySelector('header').offsetHeight") <= PHONE["height"] / 4
    if "alarm" in name:  # its whole text is read without scrolling
        expect(page.locator(".ringing")).to_be_in_viewport(ratio=1)
        inside = "one => one.scrollHeight <= one.clientHeight"
        assert page.locator(".grave-news").evaluate(inside)
