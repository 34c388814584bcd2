"""The page before a server that says what these tests tell it to."""

import re

import pytest
from playwright.sync_api import Page, expect
from tests.browser import messages
from tests.browser.conftest import PATIENCE, Watched
from tests.browser.scripted import Scripted

expect.set_options(timeout=PATIENCE)
HOSTILE = '<img src=x onerror="window.hacked = 1">\'"&amp;'
SIZES = [(1400, 1000), (1024, 768), (768, 1024), (700, 900)]


def opened(page: Page, server: Scripted, *said: messages.Message) -> Page:
    """Open the page of a bench that says something at once."""
    if said:
        server.says = list(said)
    page.goto(server.address)
    expect(page.get_by_text("connected", exact=True)).to_be_visible()
    return page


def running(page: Page, server: Scripted, time: float = 100.0) -> Page:
    """Open the page while a run goes on."""
    said = [messages.estimates(time * k / 20) for k in range(1, 21)]
    begins = messages.event(0.0, "the run begins")
    return opened(
        page, server, messages.plan(), *said, messages.samples(time - 10, time), begins,
        messages.state(time),
    )  # fmt: skip


def operating(page: Page, server: Scripted, name: str = "Ada") -> Page:
    """Take control of a run, by its dialog."""
    page.get_by_role("button", name="Take control").click()
    page.get_by_role("dialog").get_by_label("Name").fill(name)
    page.keyboard.press("Enter")
    assert server.order("operate")["name"] == name
    expect(page.get_by_text(f"you operate ({name})")).to_be_visible()
    return page


def tabbed_to(page: Page, name: str) -> None:
    """Press Tab until what has the focus has a name."""
    for _ in range(80):
        page.keyboard.press("Tab")
        if name in said_of_focus(page):
            return
    pytest.fail(f"Tab does not lead to {name}")


def said_of_focus(page: Page) -> str:
    """Return what a reader says of what has the focus, near enough."""
    return page.evaluate(
        """() => { const e = document.activeElement, label = e.labels?.[0]?.textContent;
        return e.getAttribute("aria-label") ?? label?.trim() ?? e.textContent; }"""
    )


# The set-up.


def test_a_run_is_set_up_and_started_by_keyboard_alone(page: Page, scripted: Scripted):
    opened(page, scripted)
    expect(page.get_by_role("heading", name="Set up a run")).to_be_visible()
    tabbed_to(page, "Name")
    page.keyboard.type("Ada")
    tabbed_to(page, "mimu.toml")
    page.keyboard.press("ArrowDown")
    tabbed_to(page, "Sensor")
    page.keyboard.press("ArrowDown")
    tabbed_to(page, "Start the run")
    page.keyboard.press("Enter")
    assert scripted.order("operate")["name"] == "Ada"
    asked = scripted.order("start")
    assert asked == {
        "do": "start",
        "plan": "quick",
        "sensor": "MIMU #17",
        "table": {"id": "simulated"},
        "imu": {"id": "simulated"},
    }


def test_enter_in_a_field_starts_no_run(page: Page, scripted: Scripted):
    opened(page, scripted)
    page.get_by_label("Name").first.fill("Ada")
    page.get_by_label("Name").first.press("Enter")
    scripted.order("operate")
    page.get_by_label("Table", exact=True).select_option("typed")
    page.get_by_label("Address of the table").fill("pmac://10.0.0.5:1025?motors=1,2,3&counts=36")
    page.get_by_label("Address of the table").press("Enter")
    page.get_by_role("button", name="Give control back").click()
    scripted.order("leave")
    assert [one["do"] for one in scripted.heard] == ["operate", "leave"]


def test_a_broken_plan_says_why_and_cannot_be_chosen(page: Page, scripted: Scripted):
    opened(page, scripted)
    expect(page.get_by_text("cannot be run: old.toml: [data] hold is missing")).to_be_visible()
    expect(page.get_by_role("radio", name=re.compile("old.toml"))).to_be_disabled()
    expect(page.get_by_role("radio", name=re.compile("mimu.toml"))).to_be_checked()


def test_a_simulated_table_goes_with_a_simulated_imu_alone(page: Page, scripted: Scripted):
    opened(page, scripted)
    table, imu = page.get_by_label("Table", exact=True), page.get_by_label("IMU", exact=True)
    table.select_option("given")
    expect(imu).to_have_value("given")
    imu.select_option("simulated")
    expect(table).to_have_value("simulated")


def test_what_is_missing_is_said_before_a_run_can_be_started(page: Page, scripted: Scripted):
    opened(page, scripted)
    start = page.get_by_role("button", name="Start the run")
    page.get_by_label("Table", exact=True).select_option("typed")
    page.get_by_label("Address of the table").fill("serial:/dev/ttyUSB0")
    expect(start).to_be_disabled()
    start.click(force=True)
    expect(page.get_by_text("type the table's address, such as pmac://")).to_be_visible()
    page.get_by_label("Address of the table").fill("acutrol://10.0.0.6:5025?axes=1,2,3")
    page.get_by_label("IMU", exact=True).select_option("port-0")
    expect(start).to_be_disabled()
    page.get_by_label("Packets of the IMU").select_option("xsens")
    page.get_by_label("Baud of the IMU").fill("921600")
    expect(start).to_be_enabled()
    page.get_by_label("Name").first.fill("Ada")
    start.click()
    asked = scripted.order("start")
    assert asked["table"] == {"address": "acutrol://10.0.0.6:5025?axes=1,2,3"}
    assert asked["imu"] == {"id": "port-0", "preset": "xsens", "baud": 921600}
    assert asked["sensor"] is None


def test_probing_says_in_words_what_the_devices_answer(page: Page, scripted: Scripted):
    scripted.probed = {
        "table": {"ok": True, "lines": ["Turbo PMAC TURBO2", "  outer: at 0.0004 °, servo off"]},
        "imu": {"ok": False, "lines": ["it sends nothing: is it switched on?"]},
    }
    opened(page, scripted)
    page.get_by_label("Name").first.fill("Ada")
    page.get_by_role("button", name="Probe").click()
    expect(page.get_by_text("✓ Table answers")).to_be_visible()
    expect(page.get_by_text("outer: at 0.0004 °, servo off")).to_be_visible()
    expect(page.get_by_text("✗ IMU does not answer")).to_be_visible()
    assert scripted.wait_for(lambda heard: "probe" in heard)["probe"]["plan"] == "mimu"


def test_runs_of_before_are_resumed_or_have_their_report(page: Page, scripted: Scripted):
    opened(page, scripted)
    report = page.get_by_role("link", name=re.compile("Report of MIMU #17"))
    expect(report).to_have_attribute("href", "/runs/mimu-20261120-090000/report")
    page.get_by_label("Name").first.fill("Ada")
    page.get_by_role("button", name=re.compile("Resume MIMU #17")).click()
    asked = scripted.order("resume")
    assert asked == {"do": "resume", "run": "mimu-20261122-101500", "table": None, "imu": None}


def test_a_sensor_of_the_register_leads_to_its_history(page: Page, scripted: Scripted):
    opened(page, scripted)
    expect(page.get_by_role("link", name="History of this sensor")).to_be_hidden()
    page.get_by_label("Sensor").select_option("MIMU #17")
    link = page.get_by_role("link", name="History of this sensor")
    expect(link).to_have_attribute("href", "/history/1")


# The run.


def test_a_run_is_shown_with_its_numbers_and_units(page: Page, scripted: Scripted):
    running(page, scripted)
    expect(page.get_by_role("heading", name="MIMU #17")).to_be_visible()
    expect(page.get_by_text("mimu.toml · SIMULATED bench")).to_be_visible()
    expect(page.get_by_text("step 3 of 31: x down 1, measuring")).to_be_visible()
    expect(page.get_by_text("1:40 gone, 22:01 to go")).to_be_visible()
    axes = page.get_by_role("table").filter(has_text="following error")
    expect(axes.get_by_role("row", name=re.compile("inner"))).to_contain_text("120.0000")
    expect(page.locator("#imu-facts")).to_contain_text("20000")
    expect(page.locator("#imu-facts")).to_contain_text("25.1 °C")
    expect(page.get_by_text(re.compile(r"NIS of the filters.*gyros 1\.02"))).to_be_visible()
    expect(page.get_by_role("button", name=re.compile(r"^ax\.k0: −?\d+ ± \d+ µg"))).to_be_visible()
    expect(page.get_by_text("2 of 31 done, 22:01 to go")).to_be_visible()
    expect(page.locator("[aria-current=step]")).to_contain_text("3. x down 1")
    expect(page.locator("#attitude-numbers")).to_contain_text("strapdown matrix")


def test_the_arrows_choose_the_coefficient_whose_course_is_shown(page: Page, scripted: Scripted):
    running(page, scripted)
    tabbed_to(page, "ax.k0:")
    page.keyboard.press("ArrowRight")
    page.keyboard.press("ArrowDown")
    assert said_of_focus(page).startswith("ay.k1: ")
    expect(page.get_by_role("heading", name="Course of ay.k1, ppm")).to_be_visible()
    for _ in range(4):
        page.keyboard.press("ArrowDown")
    expect(page.get_by_role("heading", name="Course of gy.scale, ppm")).to_be_visible()


def test_charts_glide_while_samples_come_and_rest_when_none_do(page: Page, scripted: Scripted):
    running(page, scripted)
    count = "() => window.inercal.frames"
    page.wait_for_function(f"before => ({count})() > before + 5", arg=page.evaluate(count))
    still = """() => new Promise((done) => { let last = -1; const look = () => {
        if (window.inercal.frames === last) done(true);
        last = window.inercal.frames; setTimeout(look, 400); }; look(); })"""
    assert page.evaluate(still)
    before = page.evaluate(count)
    scripted.tell(messages.samples(100.0, 100.5))
    page.wait_for_function(f"before => ({count})() > before + 5", arg=before)


def test_pause_go_on_and_abort_by_keys_are_the_operators(page: Page, scripted: Scripted):
    running(page, scripted)
    page.keyboard.press("p")
    expect(page.get_by_text("only who operates may: take control first")).to_be_visible()
    operating(page, scripted)
    page.keyboard.press("p")
    scripted.order("pause")
    paused = messages.state(100.1, phase="paused", paused="the operator asked")
    scripted.tell(paused)
    expect(page.get_by_text("paused: the operator asked")).to_be_visible()
    expect(page.get_by_role("button", name="Pause")).to_be_disabled()
    page.keyboard.press("g")
    scripted.order("go on")
    page.keyboard.press("a")
    expect(page.get_by_role("dialog", name="Abort the run?")).to_be_visible()
    page.keyboard.press("Escape")
    expect(page.get_by_role("dialog")).to_have_count(0)
    page.keyboard.press("a")
    page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    scripted.order("abort")
    assert [one["do"] for one in scripted.heard] == ["operate", "pause", "go on", "abort"]


def test_stop_is_anybodys_by_button_and_by_s_pressed_twice(page: Page, scripted: Scripted):
    running(page, scripted)
    page.keyboard.press("s")
    expect(page.get_by_text("s once more: STOP")).to_be_visible()
    assert not scripted.heard
    page.keyboard.press("s")
    scripted.order("stop")
    scripted.heard.clear()
    page.get_by_role("button", name="STOP", exact=True).click()
    scripted.order("stop")


def test_stop_can_be_pressed_while_a_question_is_open(page: Page, scripted: Scripted):
    running(page, scripted)
    operating(page, scripted)
    page.get_by_role("button", name="Abort").click()
    expect(page.get_by_role("dialog", name="Abort the run?")).to_be_visible()
    page.get_by_role("button", name="STOP", exact=True).click()
    scripted.order("stop")


def test_letters_of_a_name_are_no_commands(page: Page, scripted: Scripted):
    running(page, scripted)
    page.get_by_role("button", name="Take control").click()
    page.keyboard.type("gasps")
    page.keyboard.press("Enter")
    assert scripted.order("operate")["name"] == "gasps"
    assert len(scripted.heard) == 1


def test_another_operator_is_named_and_a_refusal_is_said(page: Page, scripted: Scripted):
    scripted.operator = "Grace"
    running(page, scripted)
    expect(page.get_by_text("Grace operates · 1 viewer")).to_be_visible()
    page.get_by_role("button", name="Take control").click()
    page.get_by_role("dialog").get_by_label("Name").fill("Ada")
    page.keyboard.press("Enter")
    expect(page.get_by_text("Refused: Grace operates")).to_be_visible()


def test_a_lost_connection_is_said_and_comes_back_by_itself(
    page: Page, scripted: Scripted, watched: Watched
):
    running(page, scripted)
    scripted.away = True
    scripted.drop()
    lost = page.get_by_role("alert").filter(has_text="Connection lost")
    expect(lost).to_contain_text("STOP of this page cannot reach the table")
    expect(page.locator("body")).to_have_class(re.compile(r"\bold\b"))
    page.get_by_role("button", name="STOP", exact=True).click()
    expect(page.get_by_text("STOP was NOT sent")).to_be_visible()
    scripted.says.append(messages.state(200.0))
    scripted.away = False
    expect(page.get_by_text("3:20 gone")).to_be_visible()
    expect(lost).to_have_count(0)
    expect(page.locator("body")).not_to_have_class(re.compile(r"\bold\b"))
    assert not scripted.heard, "a command was kept for later"
    # A browser says each attempt that failed.
    watched.errors[:] = [one for one in watched.errors if "/live" not in one]


def test_silence_of_the_bench_is_said(page: Page, scripted: Scripted):
    running(page, scripted)
    expect(page.get_by_text("No news from the bench for")).to_be_visible()
    expect(page.locator("body")).to_have_class(re.compile(r"\bold\b"))
    scripted.tell(messages.state(103.0))
    expect(page.get_by_text("No news from the bench for")).to_have_count(0)


def test_an_alarm_stays_until_this_viewer_has_acknowledged_it(page: Page, scripted: Scripted):
    running(page, scripted)
    scripted.tell(messages.event(100.5, "axis inner: amplifier fault", "alarm"))
    alarm = page.get_by_role("alert").filter(has_text="axis inner: amplifier fault")
    expect(alarm).to_be_visible()
    page.reload()
    expect(alarm).to_be_visible()
    tabbed_to(page, "Acknowledge: axis inner")
    page.keyboard.press("Enter")
    expect(alarm).to_have_count(0)
    page.reload()
    expect(page.get_by_text("axis inner: amplifier fault")).to_have_count(1)
    expect(alarm).to_have_count(0)


def test_the_end_says_the_verdict_and_leads_on(page: Page, scripted: Scripted):
    running(page, scripted)
    operating(page, scripted)
    scripted.tell(messages.state(messages.SECONDS), messages.done())
    expect(page.get_by_role("heading", name="The run is done")).to_be_visible()
    expect(page.get_by_text("All is as stated", exact=True)).to_be_visible()
    with page.context.expect_page() as opening:
        page.get_by_role("link", name="Open the report").click()
    expect(opening.value.get_by_role("heading")).to_have_text(re.compile(r"^/runs/.*/report$"))
    history = page.get_by_role("link", name="History of this sensor")
    expect(history).to_have_attribute("href", "/history/1")
    page.get_by_role("button", name="Set up another run").click()
    scripted.order("put away")
    scripted.tell({"kind": "idle"})
    expect(page.get_by_role("heading", name="Set up a run")).to_be_visible()


def test_an_interrupted_run_can_be_resumed_where_it_ended(page: Page, scripted: Scripted):
    running(page, scripted)
    operating(page, scripted)
    ended = {"state": "interrupted", "words": "stopped by the operator", "verdict": None}
    scripted.tell(messages.done(**ended, report=None, calibration=None))
    expect(page.get_by_role("heading", name="The run was interrupted")).to_be_visible()
    expect(page.get_by_role("link", name="Open the report")).to_have_count(0)
    page.get_by_role("button", name="Resume this run").click()
    assert scripted.order("resume")["run"] == "mimu-20261122-140000"


def test_a_run_that_ends_before_it_has_a_plan_says_why(page: Page, scripted: Scripted):
    opened(page, scripted, {"kind": "phase", "run": "r", "words": "asking the devices"})
    expect(page.get_by_text("asking the devices …")).to_be_visible()
    none = dict.fromkeys(("report", "calibration", "history", "verdict"))
    scripted.tell(
        {"kind": "done", "run": "r", "state": "interrupted", "words": "nobody is there", **none}
    )
    expect(page.get_by_text("nobody is there")).to_be_visible()


# Safety of the page itself, sizes and colours.


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


def test_words_from_outside_are_text_and_nothing_else(
    page: Page, scripted: Scripted, hostile: list[messages.Message]
):
    scripted.operator = HOSTILE
    opened(page, scripted, *hostile)
    expect(page.get_by_role("heading", name=HOSTILE)).to_be_visible()
    expect(page.get_by_role("link", name="Open the report")).to_have_count(0)
    assert page.locator("img").count() == 0
    assert page.evaluate("window.hacked") is None


def test_words_of_the_set_up_are_text_and_nothing_else(page: Page, scripted: Scripted):
    made = messages.setup()
    for kind in ("plans", "sensors", "tables", "imus", "presets", "runs"):
        for one in made[kind]:
            one |= {key: HOSTILE for key, value in one.items() if isinstance(value, str)}
    scripted.setup = made
    scripted.probed = {what: {"ok": True, "lines": [HOSTILE]} for what in ("table", "imu")}
    opened(page, scripted)
    expect(page.locator("#runs")).to_contain_text(HOSTILE)
    assert page.locator("img").count() == 0
    assert page.evaluate("window.hacked") is None


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_stop_stays_in_sight_and_nothing_is_cut_off(
    page: Page, scripted: Scripted, width: int, height: int
):
    page.set_viewport_size({"width": width, "height": height})
    running(page, scripted)
    for _ in range(2):
        expect(page.get_by_role("button", name="STOP", exact=True)).to_be_in_viewport(ratio=1)
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        page.evaluate("scrollTo(0, document.body.scrollHeight)")


@pytest.mark.parametrize("view", ["setup", "run"])
def test_buttons_and_fields_are_large_enough_for_a_finger(
    page: Page, scripted: Scripted, view: str
):
    if view == "setup":
        opened(page, scripted)
    else:
        running(page, scripted)
    small = page.evaluate(
        """() => [...document.querySelectorAll("button, select, input[type=text], a.button")]
        .filter((one) => one.checkVisibility() && one.getBoundingClientRect().height < 44)
        .map((one) => one.outerHTML)"""
    )
    assert small == []


def test_all_that_can_be_pressed_has_a_name(page: Page, scripted: Scripted):
    running(page, scripted)
    nameless = page.evaluate(
        """() => [...document.querySelectorAll("button, a, input, select, [role=img], section")]
        .filter((one) => one.checkVisibility() && !one.textContent.trim()
            && !one.getAttribute("aria-label") && !one.labels?.length)
        .map((one) => one.outerHTML)"""
    )
    assert nameless == []


def test_light_and_dark_are_as_the_device_asks(page: Page, scripted: Scripted):
    running(page, scripted)
    paper = "() => getComputedStyle(document.querySelector('main section')).backgroundColor"
    made: list[str] = []
    for scheme in ("light", "dark"):
        page.emulate_media(color_scheme=scheme)
        made.append(page.evaluate(paper))
    assert made == ["rgb(255, 255, 255)", "rgb(26, 32, 40)"]


def test_the_help_says_that_the_software_stop_is_no_safety_function(page: Page, scripted: Scripted):
    running(page, scripted)
    expect(page.get_by_text("The software stop is no safety function.")).to_be_visible()
    page.keyboard.press("?")
    expect(page.get_by_role("dialog", name="Keys")).to_contain_text("twice within a second")
    page.get_by_label("single keys work on this device").uncheck()
    page.keyboard.press("Escape")
    page.keyboard.press("s")
    page.keyboard.press("s")
    page.get_by_role("button", name="STOP", exact=True).click()
    scripted.order("stop")
    assert len(scripted.heard) == 1
