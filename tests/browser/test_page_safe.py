"""The page with hostile words, on small screens, in the dark, for all hands."""

from typing import Literal

import pytest
from playwright.sync_api import Page, expect
from tests.browser import messages
from tests.browser.page_actions import open_page, open_running_page
from tests.browser.scripted_server import ScriptedServer

HOSTILE = '<img src=x onerror="window.hacked = 1">\'"&amp;'
SIZES = [(1400, 1000), (1024, 768), (768, 1024), (700, 900)]


@pytest.fixture
def hostile() -> list[messages.Message]:
    """Return a run all of whose words are markup."""
    plan = messages.plan(sensor=HOSTILE, plan=HOSTILE, axes=[HOSTILE] * 3)
    for step in plan["steps"]:
        step["label"] = step["what"] = HOSTILE
    for one in plan["coefficients"]:
        one["unit"] = HOSTILE
    for one in plan["channels"]:
        one["name"] = one["unit"] = HOSTILE
    state = messages.state(100.0, phase=HOSTILE, trouble=HOSTILE, paused=HOSTILE)
    for axis in state["table"]["axes"]:
        axis["state"] = HOSTILE
    said = [messages.event(1.0, HOSTILE, level) for level in ("info", "warning", "alarm", HOSTILE)]
    verdict = {"level": "care", "words": HOSTILE}
    end = messages.done(words=HOSTILE, verdict=verdict, report="javascript:alert(1)")
    return [plan, messages.estimates(100.0), messages.samples(90, 100), *said, state, end]


@pytest.mark.slow
def test_words_from_outside_are_text_and_nothing_else(
    page: Page, scripted: ScriptedServer, hostile: list[messages.Message]
):
    scripted.operator = HOSTILE
    open_page(page, scripted, *hostile)
    expect(page.get_by_role("heading", name=HOSTILE, exact=True)).to_be_visible()
    expect(page.locator("#results a[href$=report]")).to_have_count(0)
    assert page.locator("img").count() == 0
    assert page.evaluate("window.hacked") is None


def test_words_of_the_set_up_are_text_and_nothing_else(page: Page, scripted: ScriptedServer):
    made = messages.setup()
    for kind in ("plans", "sensors", "tables", "imus", "presets", "runs"):
        for one in made[kind]:
            one |= {key: HOSTILE for key, value in one.items() if isinstance(value, str)}
    scripted.setup = made
    scripted.probed = {what: {"ok": True, "lines": [HOSTILE]} for what in ("table", "imu")}
    open_page(page, scripted)
    expect(page.locator("#runs")).to_contain_text(HOSTILE)
    assert page.locator("img").count() == 0
    assert page.evaluate("window.hacked") is None


@pytest.mark.slow
def test_stop_stays_in_sight_and_nothing_is_cut_off(page: Page, scripted: ScriptedServer):
    open_running_page(page, scripted)
    for width, height in SIZES:
        page.set_viewport_size({"width": width, "height": height})
        for to in ("0", "document.body.scrollHeight"):
            page.evaluate(f"scrollTo(0, {to})")
            expect(page.get_by_role("button", name="STOP", exact=True)).to_be_in_viewport(ratio=1)
            assert page.evaluate("document.documentElement.scrollWidth") <= width


@pytest.mark.slow
@pytest.mark.parametrize("view", ["setup", "run"])
def test_buttons_and_fields_are_large_enough_for_a_finger(
    page: Page, scripted: ScriptedServer, view: str
):
    if view == "setup":
        open_page(page, scripted)
    else:
        open_running_page(page, scripted)
    small = page.evaluate(
        """() => [...document.querySelectorAll("button, select, input[type=text], a.button")]
        .filter((one) => one.checkVisibility() && one.getBoundingClientRect().height < 44)
        .map((one) => one.outerHTML)"""
    )
    assert small == []


@pytest.mark.slow
def test_all_that_can_be_pressed_has_a_name(page: Page, scripted: ScriptedServer):
    open_running_page(page, scripted)
    nameless = page.evaluate(
        """() => [...document.querySelectorAll("button, a, input, select, [role=img], section")]
        .filter((one) => one.checkVisibility() && !one.textContent.trim()
            && !one.getAttribute("aria-label") && !one.labels?.length)
        .map((one) => one.outerHTML)"""
    )
    assert nameless == []


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_edges_of_what_can_be_used_are_three_to_one_against_what_is_beside_them(
    page: Page, scripted: ScriptedServer, scheme: Literal["light", "dark"]
):
    page.emulate_media(color_scheme=scheme)
    open_page(page, scripted)
    worst = page.evaluate(
        r"""() => {
        const channel = (x) => (x /= 255) <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4;
        const light = (colour) => { const [r, g, b] = colour.match(/[\d.]+/g).map(Number);
            return 0.2126 * channel(r) + 0.7152 * channel(g) + 0.0722 * channel(b); };
        const of = (one) => { const edge = light(getComputedStyle(one).borderTopColor);
            const paper = light(getComputedStyle(one.closest("section, header")).backgroundColor);
            return (Math.max(edge, paper) + 0.05) / (Math.min(edge, paper) + 0.05); };
        const used = "#setup select, #setup input[type=text], .plan:not(.broken), "
            + "header .buttons button, #setup button:not([aria-disabled=true])";
        return Math.min(...[...document.querySelectorAll(used)]
            .filter((one) => one.checkVisibility()).map(of)); }"""
    )
    assert worst >= 3


@pytest.mark.slow
def test_light_and_dark_are_as_the_device_asks(page: Page, scripted: ScriptedServer):
    open_running_page(page, scripted)
    paper = "() => getComputedStyle(document.querySelector('main section')).backgroundColor"
    made: list[str] = []
    for scheme in ("light", "dark"):
        page.emulate_media(color_scheme=scheme)
        made.append(page.evaluate(paper))
    assert made == ["rgb(255, 255, 255)", "rgb(26, 32, 40)"]


@pytest.mark.slow
def test_the_help_says_that_the_software_stop_is_no_safety_function(
    page: Page, scripted: ScriptedServer
):
    open_running_page(page, scripted)
    expect(page.locator("#no-safety")).to_be_visible()
    page.keyboard.press("?")
    expect(page.locator("#show-help")).to_be_visible()
    page.locator("#keys-on").uncheck()
    page.keyboard.press("Escape")
    page.keyboard.press("s")
    page.keyboard.press("s")
    page.get_by_role("button", name="STOP", exact=True).click()
    scripted.order("stop")
    assert len(scripted.heard) == 1
