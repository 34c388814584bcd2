"""The table of coefficients of a report on a narrow screen."""

from pathlib import Path

import pytest
from playwright.sync_api import Browser
from tests.base_seeds import evidence

from inercal.pipeline import calibrate
from inercal.report import write_report
from inercal.runfile import read

pytestmark = pytest.mark.slow

EXAMPLE = Path(__file__).parents[2] / "examples" / "six_position" / "run.toml"
_EDGES = """rows => rows.map(row => {
  const table = row.closest(".scroll").getBoundingClientRect();
  return [...row.children].filter(cell => cell.offsetParent !== null).map(cell => {
    const text = document.createRange();
    text.selectNodeContents(cell);
    const {left, right} = text.getBoundingClientRect();
    return [left - table.left, table.right - right, cell.scrollWidth - cell.clientWidth];
  }).flat();
})"""


# The table of a simulated sensor has the columns of a measured one, and that of the truth.
@pytest.mark.parametrize("truth", [evidence(False), True], ids=["measured", "simulated"])
def test_value_uncertainty_and_unit_need_no_scrolling(
    browser: Browser, tmp_path: Path, truth: bool
):
    outcome = calibrate(read(EXAMPLE))
    names = outcome.calibration.sensor.coefficients
    near = outcome.calibration.values + 1.4 * outcome.calibration.std
    page_file = tmp_path / "report.html"
    write_report(
        outcome, page_file, dict(zip(names, near.tolist(), strict=True)) if truth else None, None
    )
    page = browser.new_page()
    for width in (360, 400, 1100):
        page.set_viewport_size({"width": width, "height": 900})
        page.goto(page_file.as_uri())
        rows = page.eval_on_selector_all("table.coefficients tr", _EDGES)
        assert len(rows) == len(names) + 1
        for cells in rows:
            left, right, hidden = cells[::3], cells[1::3], cells[2::3]
            assert min(left) >= 0, width
            assert min(right) >= 0, width
            assert max(hidden) <= 0, width
    page.close()
