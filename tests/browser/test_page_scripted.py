"""A run on the page, before a server that says what these tests tell it to."""

import re

import pytest
from playwright.sync_api import Page, expect
from tests.browser import messages
from tests.browser.conftest import PageErrors
from tests.browser.page_actions import (
    accessible_text_of_focus,
    choose_plan,
    confirm_start,
    open_page,
    open_running_page,
    tab_to,
    take_control,
)
from tests.browser.scripted_server import ScriptedServer

from inercal.report.templates import glossary_page


@pytest.mark.slow
def test_a_run_is_shown_with_its_numbers_and_units(page: Page, scripted: ScriptedServer):
    open_running_page(page, scripted)
    expect(page.get_by_role("heading", name="MIMU #17")).to_be_visible()
    expect(page.get_by_text("mimu.toml · SIMULATED bench")).to_be_visible()
    expect(page.locator("#phase")).to_contain_text("x down 1")
    for number in ("3", "31", "1:40", "22:01"):
        expect(page.locator("#clock")).to_contain_text(number)
    axes = page.get_by_role("table").filter(has_text="following error")
    expect(axes.get_by_role("row", name=re.compile("inner"))).to_contain_text("120.0000")
    expect(page.locator("#imu-facts")).to_contain_text("20000")
    expect(page.locator("#imu-facts")).to_contain_text("25.1 °C")
    expect(page.locator("#nis")).to_contain_text("gyros 1.02: consistent")
    expect(
        page.get_by_role("button", name=re.compile(r"^ax\.k0: [−\d.]+ ± [\d.]+ µg"))
    ).to_be_visible()
    expect(page.locator("#steps-done")).to_contain_text("2 of 31")
    expect(page.locator("[aria-current=step]")).to_contain_text("3. x down 1")
    expect(page.locator("#attitude-numbers")).to_contain_text("strapdown matrix")


@pytest.mark.slow
def test_before_anything_is_estimated_the_tables_attitude_is_shown(
    page: Page, scripted: ScriptedServer
):
    open_running_page(page, scripted, time=12.0)
    expect(page.locator("#estimates[data-live=waits] #waits")).to_be_visible()
    expect(page.locator("#attitude[data-live=waits] #attitude-waits")).to_be_visible()
    heading = page.locator("#attitude-numbers").get_by_role("row", name="heading")
    expect(heading).to_have_text(re.compile(r"^heading\d+\.\d{3}—$"))


@pytest.mark.slow
def test_what_was_found_last_is_greyed_where_live_estimation_broke_off(
    page: Page, scripted: ScriptedServer
):
    open_running_page(page, scripted)
    none = dict.fromkeys(messages.NAVIGATED)
    broken = {"live": "ended", "attitude": {"table": messages.matrix(101.0), **none}}
    scripted.tell(messages.state(101.0, **broken))
    expect(page.locator("#estimates[data-live=ended] #waits")).to_be_visible()
    expect(page.locator("#attitude[data-live=ended] #attitude-waits")).to_be_visible()
    cell = page.locator("#attitude-numbers").get_by_role("row", name="roll").locator(".navigated")
    expect(cell).to_have_text("1.234")
    found = page.get_by_role("button", name=re.compile(r"^ax\.k0: [−\d.]+ ± "))
    muted = page.evaluate(
        """() => { const probe = document.createElement("p"); probe.style.color = "var(--muted)";
        document.body.append(probe); return getComputedStyle(probe).color; }"""
    )
    for one in (cell, found):
        expect(one).to_have_css("color", muted)


def test_a_method_without_live_estimates_promises_none(page: Page, scripted: ScriptedServer):
    none = dict.fromkeys(messages.NAVIGATED)
    only = {"live": "none", "attitude": {"table": messages.matrix(30.0), **none}}
    open_page(page, scripted, messages.plan(), messages.state(30.0, **only))
    expect(page.locator("#estimates[data-live=none] #waits")).to_be_visible()
    expect(page.locator("#attitude[data-live=none] #attitude-waits")).to_be_visible()
    expect(page.get_by_role("img", name="Attitude by the table")).to_be_visible()
    expect(page.get_by_role("img", name="Attitude by the IMU's readings")).to_be_hidden()
    expect(page.get_by_text("strapdown matrix")).to_be_hidden()
    expect(page.locator("#course")).to_be_hidden()


def test_of_a_method_that_estimates_too_little_to_navigate_by_no_navigation_is_shown(
    page: Page, scripted: ScriptedServer
):
    none = dict.fromkeys(messages.NAVIGATED)
    only = {"live": "on", "attitude": {"table": messages.matrix(30.0), **none}}
    judged = {"ratio": 1.03, "level": "good", "words": "consistent"}
    found = messages.estimates(30.0) | {"nis": {"all": judged}}
    open_page(page, scripted, messages.plan(), found, messages.state(30.0, **only))
    expect(page.locator("#nis")).to_contain_text("all axes 1.03: consistent")
    for word in ("NIS", "k0"):
        linked = page.get_by_role("link", name=word, exact=True).first
        anchor = (linked.get_attribute("href") or "").partition("#")[2]
        assert f'id="{anchor}"' in glossary_page()
    expect(page.get_by_role("button", name=re.compile(r"^ax\.k0: [−\d.]+ ± "))).to_be_visible()
    expect(page.locator("#attitude[data-live=none] #attitude-waits")).to_be_visible()
    expect(page.get_by_role("img", name="Attitude by the IMU's readings")).to_be_hidden()
    expect(page.locator("#course")).to_be_visible()


@pytest.mark.slow
def test_the_arrows_choose_the_coefficient_whose_course_is_shown(
    page: Page, scripted: ScriptedServer
):
    open_running_page(page, scripted)
    tab_to(page, "ax.k0:")
    page.keyboard.press("ArrowRight")
    page.keyboard.press("ArrowDown")
    assert accessible_text_of_focus(page).startswith("ay.k1: ")
    expect(page.locator("#course-title", has_text="ay.k1")).to_be_visible()
    for _ in range(4):
        page.keyboard.press("ArrowDown")
    expect(page.locator("#course-title", has_text="gy.scale")).to_be_visible()


@pytest.mark.slow
def test_charts_glide_while_samples_come_and_rest_when_none_do(
    page: Page, scripted: ScriptedServer
):
    open_running_page(page, scripted)
    count = "() => window.inercal.frames"
    page.wait_for_function(f"before => ({count})() > before + 5", arg=page.evaluate(count))
    still = """() => new Promise((done) => { let last = -1; const look = () => {
        if (window.inercal.frames === last) done(true);
        last = window.inercal.frames; setTimeout(look, 400); }; look(); })"""
    assert page.evaluate(still)
    before = page.evaluate(count)
    scripted.tell(messages.samples(100.0, 100.5))
    page.wait_for_function(f"before => ({count})() > before + 5", arg=before)


@pytest.mark.slow
def test_pause_go_on_and_abort_by_keys_are_the_operators(page: Page, scripted: ScriptedServer):
    open_running_page(page, scripted)
    page.keyboard.press("p")
    expect(page.locator("#notice")).not_to_be_empty()
    assert not scripted.heard
    take_control(page, scripted)
    page.keyboard.press("p")
    scripted.order("pause")
    paused = messages.state(100.1, phase="paused", paused="the operator asked")
    scripted.tell(paused)
    expect(page.get_by_text("paused: the operator asked")).to_be_visible()
    expect(page.locator("#pause")).to_be_disabled()
    page.keyboard.press("g")
    scripted.order("go on")
    page.keyboard.press("a")
    expect(page.locator("#ask-abort")).to_be_visible()
    page.keyboard.press("Escape")
    expect(page.get_by_role("dialog")).to_have_count(0)
    page.keyboard.press("a")
    page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    scripted.order("abort")
    assert [one["do"] for one in scripted.heard] == ["operate", "pause", "go on", "abort"]


@pytest.mark.slow
def test_the_operator_writes_notes_and_their_letters_are_no_commands(
    page: Page, scripted: ScriptedServer
):
    open_running_page(page, scripted)
    note = page.get_by_label("Note for the journal and the report")
    expect(note).to_be_hidden()
    take_control(page, scripted)
    note.fill("")
    note.press_sequentially("gas spill passed")
    note.press("Enter")
    assert scripted.order("note") == {"do": "note", "text": "gas spill passed"}
    expect(note).to_have_value("")
    scripted.tell(messages.event(101.0, "Ada: gas spill passed", "note"))
    expect(page.locator("#event-list li").first).to_contain_text("✎ note Ada: gas spill passed")
    assert [one["do"] for one in scripted.heard] == ["operate", "note"]


@pytest.mark.slow
def test_stop_is_anybodys_by_button_and_by_s_pressed_twice(page: Page, scripted: ScriptedServer):
    open_running_page(page, scripted)
    page.keyboard.press("s")
    expect(page.get_by_text("s once more: STOP")).to_be_visible()
    assert not scripted.heard
    page.keyboard.press("s")
    scripted.order("stop")
    scripted.heard.clear()
    page.get_by_role("button", name="STOP", exact=True).click()
    scripted.order("stop")


@pytest.mark.slow
def test_stop_is_sent_once_by_a_key_that_is_held(page: Page, scripted: ScriptedServer):
    open_running_page(page, scripted)
    for _ in range(10):
        page.keyboard.down("s")  # each after the first is a repetition, as of a key that is held
    page.keyboard.up("s")
    scripted.order("stop")
    page.locator("#control").click()
    page.keyboard.type("Ada")
    page.keyboard.press("Enter")
    scripted.order("operate")
    assert [one["do"] for one in scripted.heard] == ["stop", "operate"]


@pytest.mark.slow
def test_stop_can_be_pressed_while_a_question_is_open(page: Page, scripted: ScriptedServer):
    open_running_page(page, scripted)
    take_control(page, scripted)
    page.locator("#abort").click()
    expect(page.locator("#ask-abort")).to_be_visible()
    page.get_by_role("button", name="STOP", exact=True).click()
    scripted.order("stop")


@pytest.mark.slow
def test_letters_of_a_name_are_no_commands(page: Page, scripted: ScriptedServer):
    open_running_page(page, scripted)
    page.locator("#control").click()
    page.keyboard.type("gasps")
    page.keyboard.press("Enter")
    assert scripted.order("operate")["name"] == "gasps"
    assert len(scripted.heard) == 1


@pytest.mark.slow
def test_another_operator_is_named_and_a_refusal_is_said(page: Page, scripted: ScriptedServer):
    scripted.operator = "Grace"
    open_running_page(page, scripted)
    expect(page.locator("#people[data-operator=other]")).to_contain_text("Grace")
    page.locator("#control").click()
    page.get_by_role("dialog").get_by_label("Name").fill("Ada")
    page.keyboard.press("Enter")
    expect(page.get_by_text("Refused: Grace operates")).to_be_visible()


@pytest.mark.slow
def test_a_lost_connection_is_said_and_comes_back_by_itself(
    page: Page, scripted: ScriptedServer, watched: PageErrors
):
    open_running_page(page, scripted)
    scripted.away = True
    scripted.drop()
    lost = page.locator("#lost[role=alert]:not(:empty)")
    expect(lost).to_contain_text("emergency stop")
    expect(page.locator("body")).to_have_class(re.compile(r"\bold\b"))
    page.get_by_role("button", name="STOP", exact=True).click()
    expect(page.get_by_text("STOP was NOT sent")).to_be_visible()
    scripted.says.append(messages.state(200.0))
    scripted.away = False
    expect(page.locator("#clock")).to_contain_text("3:20")
    expect(lost).to_have_count(0)
    expect(page.locator("body")).not_to_have_class(re.compile(r"\bold\b"))
    assert not scripted.heard, "a command was kept for later"
    # A browser says each attempt that failed.
    tried = "/live", "/api/stop"
    watched.errors[:] = [e for e in watched.errors if not any(path in e for path in tried)]


@pytest.mark.slow
def test_a_connection_that_broke_without_a_word_is_noticed_though_no_run_goes_on(
    page: Page, scripted: ScriptedServer
):
    open_page(page, scripted)
    page.get_by_label("Name").first.fill("Ada")
    page.locator("#control").click()
    expect(page.locator("#people[data-operator=me]")).to_be_visible()
    page.wait_for_timeout(6000)  # longer than a connection without a beat may be
    expect(page.locator("#link[data-link=live]")).to_be_visible()
    scripted.mute = True
    quiet = page.locator("#lost[role=alert]:not(:empty)")
    expect(quiet).to_contain_text("emergency stop")
    expect(page.locator("#link[data-link=quiet]")).to_be_visible()
    choose_plan(page)
    confirm_start(page)
    expect(page.locator("#notice")).not_to_be_empty()
    page.get_by_role("button", name="STOP", exact=True).click()
    expect(page.get_by_text("it may NOT have arrived")).to_be_visible()
    scripted.mute = False
    expect(quiet).to_have_count(0)
    assert [one["do"] for one in scripted.heard] == ["operate", "stop"]


@pytest.mark.slow
def test_a_connection_without_a_word_is_given_up_and_made_anew(
    page: Page, scripted: ScriptedServer
):
    open_page(page, scripted)
    scripted.mute = True
    expect(page.locator("#link[data-link=quiet]")).to_be_visible()
    scripted.says = [messages.plan(), messages.state(100.0)]
    # A new connection tells what there is: that is a word.
    expect(page.get_by_role("heading", name="MIMU #17")).to_be_visible()


@pytest.mark.slow
def test_an_attempt_that_hangs_is_given_up(
    page: Page, scripted: ScriptedServer, watched: PageErrors
):
    open_page(page, scripted)
    scripted.hangs = True
    scripted.drop()
    expect(page.locator("#link[data-link=lost]")).to_be_visible()
    for _ in range(2):  # the second comes after one that was neither taken nor refused
        with page.expect_websocket():
            pass
    scripted.hangs = False
    expect(page.locator("#link[data-link=live]")).to_be_visible()
    # A browser says each attempt that was given up.
    watched.errors[:] = [one for one in watched.errors if "/live" not in one]


@pytest.mark.slow
def test_control_that_somebody_else_has_taken_is_not_taken_back(
    page: Page, scripted: ScriptedServer, watched: PageErrors
):
    open_running_page(page, scripted)
    take_control(page, scripted)
    scripted.away = True
    scripted.drop()
    expect(page.locator("#link[data-link=lost]")).to_be_visible()
    scripted.hand_over("Grace")
    scripted.away = False
    expect(page.locator("#people[data-operator=other]")).to_contain_text("Grace")
    scripted.operator = None
    scripted.heard.clear()
    scripted.people()
    expect(page.locator("#people[data-operator=none]")).to_be_visible()
    scripted.drop()
    expect(page.locator("#link[data-link=lost]")).to_be_visible()
    expect(page.locator("#link[data-link=live]")).to_be_visible()
    page.wait_for_timeout(1000)  # it would ask at once
    assert not scripted.heard
    watched.errors[:] = [one for one in watched.errors if "/live" not in one]


@pytest.mark.slow
def test_a_browser_that_keeps_nothing_keeps_no_hand_from_stop(
    own_page: Page, scripted: ScriptedServer
):
    for name in ("localStorage", "sessionStorage"):
        blocked = f"""Object.defineProperty(window, "{name}",
            {{ get() {{ throw new DOMException("blocked", "SecurityError"); }} }})"""
        own_page.add_init_script(blocked)
    open_running_page(own_page, scripted)
    take_control(own_page, scripted)
    own_page.get_by_role("button", name="STOP", exact=True).click()
    scripted.order("stop")


@pytest.mark.slow
def test_a_part_that_fails_is_said_and_silences_no_other(
    own_page: Page, scripted: ScriptedServer, watched: PageErrors
):
    gone = "Object.defineProperty(window, 'uPlot', {get() { throw new Error('gone'); }, set() {}})"
    own_page.add_init_script(gone)
    open_running_page(own_page, scripted)
    expect(
        own_page.get_by_text(re.compile(r"(charts, course|course, charts) \(gone\)"))
    ).to_be_visible()
    expect(own_page.locator("#steps-done")).to_contain_text("2 of 31")
    expect(own_page.locator("#imu-facts")).to_contain_text("20000")
    own_page.get_by_role("button", name="STOP", exact=True).click()
    scripted.order("stop")
    assert all("gone" in one for one in watched.errors)
    watched.errors.clear()


@pytest.mark.slow
def test_a_run_cannot_be_aborted_any_more_while_results_are_made(
    page: Page, scripted: ScriptedServer
):
    open_running_page(page, scripted)
    take_control(page, scripted)
    scripted.tell(messages.state(messages.SECONDS))
    abort = page.locator("#abort")
    expect(abort).to_be_disabled()
    scripted.tell({"kind": "phase", "run": "r", "words": "finishing: recording, report"})
    expect(page.get_by_text("finishing: recording, report")).to_be_visible()
    expect(abort).to_be_disabled()
    abort.click(force=True)
    expect(page.locator("#notice")).not_to_be_empty()


@pytest.mark.slow
def test_silence_of_the_bench_is_said(page: Page, scripted: ScriptedServer):
    open_running_page(page, scripted)
    expect(page.locator("#lost")).not_to_be_empty()
    expect(page.locator("body")).to_have_class(re.compile(r"\bold\b"))
    scripted.tell(messages.state(103.0))
    expect(page.locator("#lost")).to_be_empty()


@pytest.mark.slow
def test_an_alarm_stays_until_this_viewer_has_acknowledged_it(page: Page, scripted: ScriptedServer):
    open_running_page(page, scripted)
    scripted.tell(messages.event(100.5, "axis inner: amplifier fault", "alarm"))
    alarm = page.get_by_role("alert").filter(has_text="axis inner: amplifier fault")
    expect(alarm).to_be_visible()
    page.reload()
    expect(alarm).to_be_visible()
    tab_to(page, "Acknowledge: axis inner")
    page.keyboard.press("Enter")
    expect(alarm).to_have_count(0)
    page.reload()
    expect(page.get_by_text("axis inner: amplifier fault")).to_have_count(1)
    expect(alarm).to_have_count(0)


@pytest.mark.slow
def test_what_is_grave_stays_in_sight_where_the_page_is_scrolled(
    page: Page, scripted: ScriptedServer
):
    page.set_viewport_size({"width": 768, "height": 1024})
    open_running_page(page, scripted)
    # The page becomes long when the run's panels are drawn, a frame after its plan is there.
    page.wait_for_function("scrollTo(0, document.body.scrollHeight), scrollY > 200")
    scripted.tell(messages.event(100.5, "axis inner: amplifier fault", "alarm"))
    alarm = page.get_by_role("alert").filter(has_text="axis inner: amplifier fault")
    expect(alarm).to_be_in_viewport(ratio=1)
    scripted.tell(messages.state(101.0, trouble="the watchdog is not heard"))
    expect(page.get_by_text("the watchdog is not heard")).to_be_in_viewport(ratio=1)
    scripted.tell(*(messages.event(101.0 + k, f"fault {k}", "alarm") for k in range(9)))
    expect(alarm).to_contain_text("fault 8")
    assert page.evaluate("document.querySelector('header').offsetHeight < 0.6 * innerHeight")
    expect(page.get_by_role("button", name="STOP", exact=True)).to_be_in_viewport(ratio=1)


@pytest.mark.slow
def test_an_alarm_that_is_said_again_is_one_line(page: Page, scripted: ScriptedServer):
    open_running_page(page, scripted)
    scripted.tell(*(messages.event(100.0 + k, "the table is gone", "alarm") for k in range(12)))
    alarm = page.get_by_role("alert").filter(has_text="the table is gone (12 times)")
    expect(alarm).to_be_visible()
    page.get_by_role("button", name="Acknowledge: the table is gone").click()
    expect(alarm).to_have_count(0)


@pytest.mark.slow
def test_the_end_says_the_verdict_and_leads_on(page: Page, scripted: ScriptedServer):
    open_running_page(page, scripted)
    take_control(page, scripted)
    scripted.tell(messages.state(messages.SECONDS), messages.done())
    expect(page.locator("#finished[data-state=done] #verdict")).to_be_visible()
    expect(page.locator("#verdict-words")).to_have_text("✓ consistent")
    with page.context.expect_page() as opening:
        page.locator("#results a[href$=report]").click()
    expect(opening.value.get_by_role("heading")).to_have_text(re.compile(r"^/runs/.*/report$"))
    history = page.locator("#history, #results a[href^='/history']").locator("visible=true")
    expect(history).to_have_attribute("href", "/history/1")
    with page.expect_download() as saving:
        page.locator("#results a[href$=calibration]").click()
    assert saving.value.url.endswith("/calibration")
    page.locator("#put-away").click()
    scripted.order("put away")
    scripted.tell({"kind": "idle"})
    expect(page.get_by_role("heading", name="Set up a run")).to_be_visible()


@pytest.mark.slow
def test_an_interrupted_run_can_be_resumed_where_it_ended(page: Page, scripted: ScriptedServer):
    open_running_page(page, scripted)
    take_control(page, scripted)
    ended = {"state": "interrupted", "words": "stopped by the operator", "verdict": None}
    scripted.tell(messages.done(**ended, report=None, calibration=None))
    expect(page.locator("#finished[data-state=interrupted] #verdict")).to_be_visible()
    expect(page.locator("#results a[href$=report]")).to_have_count(0)
    page.locator("#resume").click()
    assert scripted.order("resume")["run"] == "mimu-20261122-140000"
    scripted.tell({"kind": "phase", "run": "r", "words": "asking the devices"}, kept=False)
    expect(page.get_by_text("asking the devices …")).to_be_visible()
    expect(page.locator("#finished[data-state=interrupted] #verdict")).to_be_hidden()


@pytest.mark.slow
def test_a_run_that_did_not_begin_says_so_and_offers_nothing_to_resume(
    page: Page, scripted: ScriptedServer
):
    open_page(page, scripted, {"kind": "phase", "run": "r", "words": "asking the devices"})
    expect(page.get_by_text("asking the devices …")).to_be_visible()
    none = dict.fromkeys(("report", "calibration", "history", "verdict"))
    words = "the table does not answer at pmac://10.0.0.5:1025"
    scripted.tell({"kind": "done", "run": "r", "state": "not begun", "words": words, **none})
    expect(page.locator("#finished[data-state='not begun'] #verdict")).to_be_in_viewport()
    expect(page.locator("#done-words")).to_have_text(words)
    expect(page.locator("#resume")).to_be_hidden()
    expect(page.locator("#put-away")).to_be_visible()


@pytest.mark.slow
def test_the_focus_goes_to_the_title_of_what_is_shown_anew(page: Page, scripted: ScriptedServer):
    open_page(page, scripted)
    page.get_by_label("Name").first.fill("Ada")
    choose_plan(page)
    confirm_start(page)
    scripted.order("start")
    scripted.tell(messages.plan(), messages.state(1.0))
    expect(page.get_by_role("heading", name="MIMU #17")).to_be_focused()
    page.evaluate("scrollTo(0, document.body.scrollHeight)")
    scripted.tell(messages.done())
    expect(page.locator("#finished[data-state=done] #verdict")).to_be_in_viewport(ratio=1)
    end = page.locator("#verdict").bounding_box()
    header = page.locator("header").bounding_box()
    assert end is not None
    assert header is not None
    assert end["y"] >= header["y"] + header["height"]
    expect(page.locator("#said")).to_contain_text("consistent")


@pytest.mark.slow
def test_a_run_that_ends_before_it_has_a_plan_says_why(page: Page, scripted: ScriptedServer):
    open_page(page, scripted, {"kind": "phase", "run": "r", "words": "asking the devices"})
    expect(page.get_by_text("asking the devices …")).to_be_visible()
    none = dict.fromkeys(("report", "calibration", "history", "verdict"))
    scripted.tell(
        {"kind": "done", "run": "r", "state": "interrupted", "words": "nobody is there", **none}
    )
    expect(page.get_by_text("nobody is there", exact=True)).to_be_visible()
