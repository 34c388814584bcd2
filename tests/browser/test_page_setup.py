"""A run is set up on the page, before a server that says what these tests tell it to."""

import re

import pytest
from playwright.sync_api import Page, expect
from tests.browser.page_actions import choose_plan, confirm_start, open_page, tab_to
from tests.browser.scripted_server import ScriptedServer


@pytest.mark.slow
def test_a_run_is_set_up_and_started_by_keyboard_alone(page: Page, scripted: ScriptedServer):
    open_page(page, scripted)
    expect(page.get_by_role("heading", name="Set up a run")).to_be_visible()
    tab_to(page, "Name")
    page.keyboard.type("Ada")
    expect(page.get_by_role("radio", name="mimu.toml")).to_be_visible()
    tab_to(page, "mimu.toml")
    page.keyboard.press("Space")
    page.keyboard.press("ArrowDown")
    tab_to(page, "Sensor")
    page.keyboard.press("ArrowDown")
    tab_to(page, "#start")
    page.keyboard.press("Enter")
    assert scripted.order("operate")["name"] == "Ada"
    question = page.locator("#ask-start")
    expect(question).to_contain_text("quick.toml")
    expect(question).to_contain_text("simulated bench")
    expect(page.locator("#ask-start [data-closes]")).to_be_focused()
    tab_to(page, "#start-yes")
    page.keyboard.press("Enter")
    asked = scripted.order("start")
    assert asked == {
        "do": "start",
        "plan": "quick",
        "sensor": "MIMU #17",
        "ambient": None,
        "table": {"id": "simulated"},
        "imu": {"id": "simulated"},
    }


@pytest.mark.slow
def test_plans_that_are_loaded_again_keep_the_focus(page: Page, scripted: ScriptedServer):
    open_page(page, scripted)
    chosen = page.get_by_role("radio", name=re.compile("mimu.toml"))
    chosen.focus()
    with page.expect_response("**/api/setup"):  # as after a connection that was lost
        scripted.tell({"kind": "idle"})
    expect(chosen).to_be_focused()
    page.keyboard.press("Space")
    changed = dict(scripted.setup)
    changed["plans"] = [{**one, "steps": 40} for one in changed["plans"]]
    scripted.setup = changed
    scripted.tell({"kind": "idle"})
    expect(page.get_by_text("40 steps").first).to_be_visible()
    expect(chosen).to_be_focused()
    page.keyboard.press("ArrowDown")
    expect(page.get_by_role("radio", name=re.compile("quick.toml"))).to_be_checked()


def test_no_plan_is_chosen_beforehand_and_without_one_nothing_starts(
    page: Page, scripted: ScriptedServer
):
    open_page(page, scripted)
    expect(page.get_by_role("radio", name=re.compile("mimu.toml"))).to_be_visible()
    assert page.locator("#plans input:checked").count() == 0
    expect(page.locator("#start")).to_be_disabled()
    expect(page.locator("#start-why")).to_contain_text("plan")


@pytest.mark.slow
def test_the_question_before_a_start_names_table_and_plan_and_starts_what_it_names(
    page: Page, scripted: ScriptedServer
):
    open_page(page, scripted)
    page.get_by_label("Name").first.fill("Ada")
    choose_plan(page)
    page.get_by_role("combobox", name="Table", exact=True).select_option("given")
    page.locator("#start").click()
    question = page.locator("#ask-start")
    for words in ("mimu.toml, 31 steps", "simulated MIMU", "pmac://10.0.0.5:1025", "preset=xsens"):
        expect(question).to_contain_text(words)
    page.locator("#ask-start [data-closes]").click()
    expect(question).to_be_hidden()
    assert [one["do"] for one in scripted.heard] == ["operate"]
    page.locator("#start").click()
    page.keyboard.press("Escape")
    expect(question).to_be_hidden()
    page.locator("#start").click()
    choose_plan(page, "quick.toml")  # behind the question, which named another
    page.locator("#start-yes").click()
    assert scripted.order("start")["plan"] == "mimu"


@pytest.mark.slow
def test_the_ambient_temperature_is_a_number_and_goes_with_the_start(
    page: Page, scripted: ScriptedServer
):
    open_page(page, scripted)
    page.get_by_label("Name").first.fill("Ada")
    choose_plan(page)
    ambient = page.get_by_label("Ambient temperature")
    ambient.fill("warm")
    expect(page.locator("#start")).to_be_disabled()
    ambient.fill("21,5")
    confirm_start(page)
    assert scripted.order("start")["ambient"] == 21.5


@pytest.mark.slow
@pytest.mark.parametrize(
    ("free", "looks", "may"), [(2e8, "small", True), (5e7, "care", True), (3e7, "bad", False)]
)
def test_the_room_on_the_disk_is_said_before_a_start(
    page: Page, scripted: ScriptedServer, free: float, looks: str, may: bool
):
    scripted.setup["free"] = free
    open_page(page, scripted)
    choose_plan(page)
    said = page.locator("#room")
    for size in ("32 MB", f"{free / 1e6:.0f} MB"):
        expect(said).to_contain_text(size)
    expect(said).to_have_class(looks)
    start = page.locator("#start")
    if not may:
        expect(start).to_be_disabled()
        return
    page.get_by_label("Name").first.fill("Ada")
    start.click()
    question = page.locator("#ask-start")
    expect(question).to_be_visible()
    if looks == "care":
        expect(question.locator("#ask-start-room")).not_to_be_empty()


@pytest.mark.slow
def test_enter_in_a_field_starts_no_run(page: Page, scripted: ScriptedServer):
    open_page(page, scripted)
    page.get_by_label("Name").first.fill("Ada")
    page.get_by_label("Name").first.press("Enter")
    scripted.order("operate")
    page.get_by_role("combobox", name="Table", exact=True).select_option("typed")
    page.get_by_label("Address of the table").fill("pmac://10.0.0.5:1025?motors=1,2,3&counts=36")
    page.get_by_label("Address of the table").press("Enter")
    page.locator("#control").click()
    scripted.order("leave")
    assert [one["do"] for one in scripted.heard] == ["operate", "leave"]


def test_a_broken_plan_says_why_and_cannot_be_chosen(page: Page, scripted: ScriptedServer):
    open_page(page, scripted)
    expect(page.get_by_text("cannot be run: old.toml: [data] hold is missing")).to_be_visible()
    expect(page.get_by_role("radio", name=re.compile("old.toml"))).to_be_disabled()
    expect(page.get_by_role("radio", name=re.compile("mimu.toml"))).to_be_enabled()


def test_a_simulated_table_goes_with_a_simulated_imu_alone(page: Page, scripted: ScriptedServer):
    open_page(page, scripted)
    table, imu = (
        page.get_by_role("combobox", name="Table", exact=True),
        page.get_by_role("combobox", name="IMU", exact=True),
    )
    table.select_option("given")
    expect(imu).to_have_value("given")
    imu.select_option("simulated")
    expect(table).to_have_value("simulated")


@pytest.mark.slow
def test_what_is_missing_is_said_before_a_run_can_be_started(page: Page, scripted: ScriptedServer):
    open_page(page, scripted)
    choose_plan(page)
    start = page.locator("#start")
    page.get_by_role("combobox", name="Table", exact=True).select_option("typed")
    page.get_by_label("Address of the table").fill("serial:/dev/ttyUSB0")
    expect(start).to_be_disabled()
    start.click(force=True)
    expect(page.get_by_role("status").get_by_text("type the table's address")).to_be_visible()
    page.get_by_label("Address of the table").fill("acutrol://10.0.0.6:5025?axes=1,2,3")
    page.get_by_role("combobox", name="IMU", exact=True).select_option("port-0")
    expect(start).to_be_disabled()
    page.get_by_role("combobox", name="Packet format of the IMU").select_option("xsens")
    page.get_by_label("Baud rate of the IMU").fill("921600")
    expect(start).to_be_enabled()
    page.get_by_label("Name").first.fill("Ada")
    confirm_start(page)
    asked = scripted.order("start")
    assert asked["table"] == {"address": "acutrol://10.0.0.6:5025?axes=1,2,3"}
    assert asked["imu"] == {"id": "port-0", "preset": "xsens", "baud": 921600}
    assert asked["sensor"] is None


@pytest.mark.slow
def test_probing_says_in_words_what_the_devices_answer(page: Page, scripted: ScriptedServer):
    scripted.probed = {
        "table": {"ok": True, "lines": ["Turbo PMAC TURBO2", "  outer: at 0.0004 °, servo off"]},
        "imu": {"ok": False, "lines": ["it sends nothing: is it switched on?"]},
    }
    open_page(page, scripted)
    page.get_by_label("Name").first.fill("Ada")
    choose_plan(page)
    page.locator("#probe").click()
    expect(page.get_by_text("✓ Table answers")).to_be_visible()
    expect(page.get_by_text("outer: at 0.0004 °, servo off")).to_be_visible()
    expect(page.get_by_text("✗ IMU does not answer")).to_be_visible()
    assert scripted.wait_for(lambda heard: "probe" in heard)["probe"]["plan"] == "mimu"


def test_runs_of_before_are_resumed_or_have_their_report(page: Page, scripted: ScriptedServer):
    open_page(page, scripted)
    report = page.get_by_role("link", name=re.compile("Report of MIMU #17"))
    expect(report).to_have_attribute("href", "/runs/mimu-20261120-090000/report")
    page.get_by_label("Name").first.fill("Ada")
    page.get_by_role("button", name=re.compile("Resume MIMU #17")).click()
    asked = scripted.order("resume")
    assert asked == {"do": "resume", "run": "mimu-20261122-101500", "table": None, "imu": None}


@pytest.mark.slow
def test_a_sensor_that_no_register_knows_is_named_on_the_page(page: Page, scripted: ScriptedServer):
    open_page(page, scripted)
    choose_plan(page)
    start = page.locator("#start")
    page.get_by_role("combobox", name="Sensor").select_option("typed")
    expect(start).to_be_disabled()
    expect(page.locator("#start-why")).to_contain_text("sensor")
    page.get_by_label("Name of the sensor").fill("  MIMU #19 ")
    expect(page.locator("#summary")).to_have_text(re.compile("^MIMU #19: mimu.toml"))
    page.get_by_role("textbox", name="Name", exact=True).fill("Ada")
    confirm_start(page)
    assert scripted.order("start")["sensor"] == "MIMU #19"


def test_the_register_and_what_is_wrong_with_it_stay_written(page: Page, scripted: ScriptedServer):
    open_page(page, scripted)
    expect(page.get_by_text("Register: sqlite:///register.db")).to_be_visible()
    trouble = "postgresql://bench@10.0.0.9/inercal: nobody answers"
    scripted.setup |= {"register": "", "trouble": trouble, "sensors": []}
    page.locator("#again").click()
    expect(page.get_by_text(f"The register: {trouble}")).to_be_visible()
    expect(page.get_by_text("Register: sqlite")).to_be_hidden()


@pytest.mark.slow
def test_earlier_runs_are_read_again_after_the_stop_of_one(page: Page, scripted: ScriptedServer):
    runs = scripted.setup["runs"]
    scripted.setup["runs"] = [{**runs[0], "state": "running"}, *runs[1:]]
    open_page(page, scripted)
    stop = page.get_by_role("button", name=re.compile("STOP MIMU #17"))
    stop.click()
    assert scripted.order("stop")["run"] == runs[0]["id"]
    scripted.setup["runs"] = runs
    expect(page.get_by_role("button", name=re.compile("Resume MIMU #17"))).to_be_visible()
    expect(stop).to_have_count(0)
    assert page.evaluate("document.activeElement.id") == "runs"


@pytest.mark.slow
def test_a_sensor_of_the_register_leads_to_its_history(page: Page, scripted: ScriptedServer):
    open_page(page, scripted)
    expect(
        page.locator("#history, #results a[href^='/history']").locator("visible=true")
    ).to_be_hidden()
    page.get_by_role("combobox", name="Sensor").select_option("1")
    link = page.locator("#history, #results a[href^='/history']").locator("visible=true")
    expect(link).to_have_attribute("href", "/history/1")
