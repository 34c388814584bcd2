"""The filters' parameters on the page's set-up, before the bench's own server."""

import re
import tomllib
from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect
from tests.base_seeds import evidence
from tests.browser.live_run import LiveRun
from tests.browser.page_actions import choose_plan, confirm_start, tab_to
from tests.host.web.pages import Served

from inercal.host.web.run_request import RunProcess, RunRequest, changed_run_file
from inercal.runfile import read

pytestmark = pytest.mark.slow

DEMO = Path(str(files("inercal").joinpath("demo.toml")))


@pytest.fixture
def orders() -> list[RunRequest]:
    return []


@pytest.fixture
def served(tmp_path: Path, orders: list[RunRequest]) -> Iterator[Served]:
    def start(order: RunRequest) -> RunProcess:
        orders.append(order)
        return LiveRun(order)

    with Served(tmp_path, start=start) as server:
        yield server


def opened_form(page: Page, served: Served) -> None:
    """Open the parameters of the demonstration's filters by the keyboard."""
    page.goto(f"http://127.0.0.1:{served.port}/")
    page.locator("#name").fill("Ada")
    choose_plan(page, "demo.toml")
    tab_to(page, "Filter parameters")
    page.keyboard.press("Enter")


def test_a_bad_value_is_said_at_its_field_and_a_good_one_goes_into_the_run(
    page: Page, served: Served, orders: list[RunRequest]
):
    opened_form(page, served)
    tab_to(page, "epoch")
    epoch = page.get_by_label("epoch", exact=True)
    expect(epoch).to_be_focused()
    page.keyboard.type("3 s")
    page.keyboard.press("Tab")
    expect(epoch).to_have_attribute("aria-invalid", "true")
    expect(page.locator("#filter-epoch-error")).to_contain_text("0.02 s to 0.5 s")
    start = page.locator("#start")
    expect(start).to_have_attribute("aria-disabled", "true")
    epoch.fill("0.2 s")
    page.get_by_label("table states", exact=True).select_option("lean")
    expect(page.get_by_text(re.compile("Filter parameters: 2 changed"))).to_be_visible()
    expect(epoch).to_have_attribute("aria-invalid", "false")
    expect(start).to_have_attribute("aria-disabled", "false")
    confirm_start(page)
    expect(page.locator("#live")).to_be_visible()
    (order,) = orders
    assert order.filter == {"epoch": "0.2 s", "table_states": "lean"}


@pytest.mark.parametrize("width", [1366, evidence(768), 400])
def test_the_parameters_are_as_wide_as_the_page(page: Page, served: Served, width: int):
    page.set_viewport_size({"width": width, "height": 768})
    opened_form(page, served)
    expect(page.get_by_label("gyro bias", exact=True)).to_be_visible()
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    widths = page.evaluate(
        "[...document.querySelectorAll('.parameter')].map((one) => one.getBoundingClientRect())"
        ".map(({ left, right }) => [left >= 0, right <= innerWidth])"
    )
    assert widths
    assert all(all(one) for one in widths)


def test_a_change_is_the_only_one_in_the_run_file(tmp_path: Path):
    changes = {"epoch": "0.2 s", "initial.gyro_bias": "100 °/h", "bias_drift": "false"}
    content = changed_run_file(DEMO, None, changes)
    assert content is not None
    before, after = tomllib.loads(DEMO.read_text("utf-8")), tomllib.loads(content.decode())
    written = after["method"].pop("filter")
    assert written == {"epoch": "0.2 s", "bias_drift": False, "initial": {"gyro_bias": "100 °/h"}}
    assert after == before
    (tmp_path / "demo_path.csv").write_bytes(DEMO.with_name("demo_path.csv").read_bytes())
    path = tmp_path / "run.toml"
    path.write_bytes(content)
    config = read(path).filter
    assert config is not None
    assert config.epoch == 0.2
    # An empty text takes the default again.
    again = changed_run_file(path, None, dict.fromkeys(changes, ""))
    assert again is not None
    assert tomllib.loads(again.decode()) == before
