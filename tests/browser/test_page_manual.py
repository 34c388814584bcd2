"""The panel of a manual session, before a server that says what it is told to.

What the page sends is what counts: a jog as long as a hand holds it, a release whatever ends it.
"""

import re
from typing import Any

import pytest
from playwright.sync_api import Locator, Page, expect
from tests.base_seeds import evidence
from tests.browser import messages
from tests.browser.page_actions import choose_plan, open_page, tab_to, take_control
from tests.browser.scripted_server import ScriptedServer

pytestmark = pytest.mark.slow

AXES = ("outer", "middle", "inner")
LIMITS = {"rate": 30.0, "low": -100.0, "high": 100.0}
LAMPS = {"servo": True, "homed": True, "in_position": True, "moving": False, "low": False}
READY = {"activity": "idle", "set": 1.5, "set_rate": 0.0, "high": False, "fault": False, **LAMPS}
STATE = {"phase": "manual", "done": 0, "remaining": None, "live": "none", "attitude": None}


def manual_plan(**unsupported: str) -> messages.Message:
    """Return what a manual session says first, without an IMU."""
    empty: dict[str, Any] = {"channels": [], "steps": [], "coefficients": []}
    manual = {"limits": [LIMITS] * 3, "unsupported": unsupported}
    return messages.plan(seconds=0.0, axes=list(AXES), manual=manual, **empty)


def manual_state(time: float, **inner: Any) -> messages.Message:
    """Return the state at a time, s; of the inner axis with what is said of it."""
    axes = [READY, READY, READY | inner]
    return messages.state(time, **STATE, imu=None, manual=axes)


@pytest.fixture
def panel(page: Page, scripted: ScriptedServer) -> Page:
    """Open the page of a manual session, as its operator."""
    open_page(page, scripted, manual_plan(), manual_state(1.0))
    take_control(page, scripted)
    expect(jog(page)).to_have_attribute("aria-disabled", "false")
    return page


def jog(page: Page, sign: str = "+", axis: str = "inner") -> Locator:
    named = f"Jog {sign.replace('-', '−')} axis {axis}"
    return page.get_by_role("button", name=named)


def asked(server: ScriptedServer, what: str, count: int = 1) -> list[dict[str, Any]]:
    """Wait until something was asked for so many times; return what was said."""

    def all_of() -> list[dict[str, Any]]:
        commands = [one for one in server.heard if one.get("do") == "manual"]
        return [one["ask"] for one in commands if one["ask"]["what"] == what]

    server.wait_for(lambda _: len(all_of()) >= count)
    return all_of()


def releases(server: ScriptedServer) -> int:
    return sum(one == {"do": "release"} for one in server.heard)


def is_quiet_after_release(page: Page, server: ScriptedServer) -> None:
    """See that after a release nothing is held any more, by what is asked for next; forget all."""
    server.order("release")
    page.locator("#halt").click()
    server.wait_for(lambda one: one == {"do": "release", "all": True})
    kinds = [one.get("ask", {}).get("what", one["do"]) for one in server.heard]
    assert "hold" not in kinds[kinds.index("release") :]
    assert releases(server) == 1
    server.heard.clear()


def test_a_key_that_is_held_jogs_and_its_release_stops(panel: Page, scripted: ScriptedServer):
    for key, sign, rate in (
        ("ArrowRight", "-", 5),
        ("ArrowLeft", "+", -5),
        (" ", "-", -5),
        ("Enter", "+", 5),
    ):
        jog(panel, sign).focus()
        panel.keyboard.down(key)
        (begun,) = asked(scripted, "jog")
        held = asked(scripted, "hold", 3)
        assert {"axis": begun["axis"], "rate": begun["rate"]} == {"axis": "inner", "rate": rate}
        assert {one["press"] for one in held} == {begun["press"]}
        panel.keyboard.up(key)
        is_quiet_after_release(panel, scripted)


def test_a_mouse_that_is_held_jogs_and_one_that_slides_off_stops(
    panel: Page, scripted: ScriptedServer
):
    jog(panel).hover()
    panel.mouse.down()
    asked(scripted, "hold", 2)
    panel.mouse.move(5, 5)
    scripted.order("release")
    panel.mouse.up()
    is_quiet_after_release(panel, scripted)


def test_whatever_takes_hand_or_eye_away_stops(panel: Page, scripted: ScriptedServer):
    for what in (
        "document.activeElement.blur()",
        "dispatchEvent(new Event('blur'))",
        "document.dispatchEvent(new Event('visibilitychange'))",
        "dispatchEvent(new PointerEvent('pointercancel'))",
    ):
        jog(panel).focus()
        panel.keyboard.down("ArrowRight")
        asked(scripted, "hold", 2)
        panel.evaluate(what)
        is_quiet_after_release(panel, scripted)
        panel.keyboard.up("ArrowRight")
        scripted.heard.clear()


def test_a_new_press_has_a_new_number(panel: Page, scripted: ScriptedServer):
    jog(panel).focus()
    for _ in range(2):
        panel.keyboard.down(" ")
        panel.keyboard.up(" ")
    first, second = asked(scripted, "jog", 2)
    assert second["press"] > first["press"]


def test_who_loses_the_seat_jogs_no_longer(panel: Page, scripted: ScriptedServer):
    jog(panel).focus()
    panel.keyboard.down("ArrowRight")
    asked(scripted, "hold", 2)
    scripted.hand_over("Bob")
    scripted.people()
    scripted.order("release")
    expect(jog(panel)).to_have_attribute("aria-disabled", "true")
    panel.keyboard.up("ArrowRight")


def test_lamps_and_values_have_words_and_units(panel: Page, scripted: ScriptedServer):
    axis = panel.get_by_role("region", name="Axis inner")
    expect(axis.get_by_label("servo on")).to_be_visible()
    expect(axis.get_by_label("limit + free")).to_be_visible()
    scripted.tell(manual_state(2.0, high=True, moving=True, in_position=False, set=99.9,
                               activity="jog", set_rate=5.0))  # fmt: skip
    for lit in ("at limit +", "moving", "not in position", "limit − free", "no fault"):
        expect(axis.get_by_label(lit, exact=True)).to_be_visible()
    expect(axis).to_contain_text("set angle, °99.9000")
    expect(axis).to_contain_text("set rate, °/s+5.000")
    expect(axis).to_contain_text("following error, ″")
    expect(axis).to_contain_text("−100.0 to 100.0 °; up to 30 °/s")
    expect(jog(panel)).to_have_attribute("aria-disabled", "true")
    expect(jog(panel, "-")).to_have_attribute("aria-disabled", "false")
    scripted.tell(manual_state(3.0, fault=True, servo=False))
    for lit in ("fault", "servo off"):
        expect(axis.get_by_label(lit, exact=True)).to_be_visible()
    assert "servo is off" in (jog(panel, "-").get_attribute("title") or "")


def test_go_home_servo_and_halt_ask_for_what_is_typed(panel: Page, scripted: ScriptedServer):
    axis = panel.get_by_role("region", name="Axis middle")
    axis.get_by_label("angle, °").fill("−12,5")
    axis.get_by_label("rate, °/s").fill("10")
    axis.get_by_role("button", name="Go:").click()
    assert asked(scripted, "go") == [{"what": "go", "axis": "middle", "angle": -12.5, "rate": 10}]
    axis.get_by_label("angle, °").fill("1e")
    axis.get_by_role("button", name="Go:").click()
    expect(panel.locator("#manual-said")).to_contain_text("Axis middle")
    axis.get_by_role("button", name="Home").click()
    assert asked(scripted, "home") == [{"what": "home", "axis": "middle"}]
    axis.get_by_role("button", name="Servo").click()
    assert asked(scripted, "servo") == [{"what": "servo", "axis": "middle", "on": False}]
    assert len(asked(scripted, "go")) == 1
    scripted.tell(messages.event(2.0, "refused: Ada: axis middle: beyond", "warning"))
    expect(panel.locator("#manual-said")).to_contain_text("refused: Ada")
    panel.locator("#end-manual").click()
    scripted.order("abort")


def test_what_a_controller_cannot_do_is_disabled_with_its_reason(
    page: Page, scripted: ScriptedServer
):
    open_page(page, scripted, manual_plan(home="the encoders are absolute"), manual_state(1.0))
    take_control(page, scripted)
    home = page.get_by_role("button", name="Home axis inner")
    expect(home).to_have_attribute("title", "Axis inner: the encoders are absolute.")
    home.click(force=True)  # it says why not
    expect(page.locator("#manual-said")).to_contain_text("absolute")
    assert not any(one.get("do") == "manual" for one in scripted.heard)


def test_a_viewer_can_ask_for_nothing_but_stop(page: Page, scripted: ScriptedServer):
    open_page(page, scripted, manual_plan(), manual_state(1.0))
    expect(jog(page)).to_have_attribute("aria-disabled", "true")
    jog(page).focus()
    page.keyboard.press("ArrowRight")
    page.locator("#halt").click(force=True)
    page.get_by_role("button", name="STOP").click()
    scripted.order("stop")
    assert {one["do"] for one in scripted.heard} == {"stop"}


def test_a_session_begins_after_a_question_that_names_the_table(
    page: Page, scripted: ScriptedServer
):
    open_page(page, scripted)
    start = page.locator("#start-manual")
    expect(start).to_have_attribute("aria-disabled", "true")
    page.get_by_label("Name", exact=True).first.fill("Ada")
    choose_plan(page)
    start.click()
    dialog = page.locator("#ask-manual")
    expect(dialog).to_contain_text("simulated bench")
    assert not any(one.get("do") == "begin manual" for one in scripted.heard)
    dialog.locator("#manual-yes").click()
    begun = scripted.order("begin manual")
    assert begun["plan"] == "mimu"
    assert begun["table"] == {"id": "simulated"}
    assert begun["with_imu"] is False


@pytest.mark.parametrize("width", [1366, evidence(768), 400])
def test_the_panel_fits_and_is_reached_by_keyboard(
    page: Page, scripted: ScriptedServer, width: int
):
    page.set_viewport_size({"width": width, "height": 768})
    open_page(page, scripted, manual_plan(), *(manual_state(0.1 * k) for k in range(1, 40)))
    take_control(page, scripted)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    expect(page.locator("#manual canvas")).to_have_count(3)
    tab_to(page, "Jog + axis inner")
    plot = page.get_by_role("group", name=re.compile("Set and actual angle of axis inner"))
    plot.focus()
    page.keyboard.press("ArrowLeft")
    expect(
        plot.locator("xpath=..").get_by_text(re.compile(r"actual [−\d.]+, set 1\.5000"))
    ).to_be_visible()
    expect(page.locator("#steps")).to_be_hidden()
    expect(page.locator("#estimates")).to_be_hidden()


def test_the_trend_from_before_the_page_was_opened_is_shown(page: Page, scripted: ScriptedServer):
    past = [[0.1 * k, [float(k)] * 3, [k + 0.5] * 3] for k in range(200)]
    pieces = [{"kind": "trend", "points": past[k : k + 50]} for k in (150, 100, 50, 0)]
    open_page(page, scripted, manual_plan(), manual_state(20.0), *pieces)
    expect(page.locator("#manual canvas")).to_have_count(3)
    place = page.locator(".manual-axis").nth(1)
    over = place.locator(".u-over")
    over.scroll_into_view_if_needed()
    box = over.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] * 10.0 / 30, box["y"] + box["height"] / 2)
    expect(place.locator(".at")).to_contain_text("0:10")
    told = [float(one) for one in re.findall(r"[\d.]+", place.locator(".value-at").inner_text())]
    assert told == pytest.approx([100.0, 100.5], abs=2)
    assert told[1] == told[0] + 0.5


def test_the_end_says_why(panel: Page, scripted: ScriptedServer):
    scripted.tell(messages.done(state="manual", words="axis inner: the following error is 1.2°",
                                verdict=None, report=None, calibration=None))  # fmt: skip
    expect(panel.locator("#finished[data-state=manual] #verdict")).to_be_visible()
    expect(panel.locator("#verdict-words")).to_contain_text("following error")
    expect(jog(panel)).to_have_attribute("aria-disabled", "true")
