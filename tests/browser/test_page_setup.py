"""A run is set up on the page, before a server that says what these tests tell it to."""

import re

from playwright.sync_api import Page, expect
from tests.browser.driving import opened, tabbed_to
from tests.browser.scripted import Scripted


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
    page.get_by_role("combobox", name="Table", exact=True).select_option("typed")
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
    table, imu = (
        page.get_by_role("combobox", name="Table", exact=True),
        page.get_by_role("combobox", name="IMU", exact=True),
    )
    table.select_option("given")
    expect(imu).to_have_value("given")
    imu.select_option("simulated")
    expect(table).to_have_value("simulated")


def test_what_is_missing_is_said_before_a_run_can_be_started(page: Page, scripted: Scripted):
    opened(page, scripted)
    start = page.get_by_role("button", name="Start the run")
    page.get_by_role("combobox", name="Table", exact=True).select_option("typed")
    page.get_by_label("Address of the table").fill("serial:/dev/ttyUSB0")
    expect(start).to_be_disabled()
    start.click(force=True)
    expect(page.get_by_role("status").get_by_text("type the table's address")).to_be_visible()
    page.get_by_label("Address of the table").fill("acutrol://10.0.0.6:5025?axes=1,2,3")
    page.get_by_role("combobox", name="IMU", exact=True).select_option("port-0")
    expect(start).to_be_disabled()
    page.get_by_role("combobox", name="Packets of the IMU").select_option("xsens")
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
    page.get_by_role("combobox", name="Sensor").select_option("MIMU #17")
    link = page.get_by_role("link", name="History of this sensor")
    expect(link).to_have_attribute("href", "/history/1")
