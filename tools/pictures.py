"""Make the pictures of README and site, light and dark: ``python -m tools.pictures``.

They are what Chromium of the system shows of a report and of the live page of a simulated run.
"""

import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from playwright.sync_api import Browser, Page, sync_playwright

IMAGES = Path(__file__).parents[1] / "docs" / "images"
CHROMIUM = "/usr/bin/chromium"
SCHEMES = {"light": "", "dark": "-dark"}
_PROGRAM = (sys.executable, "-c", "from inercal.cli.app import main; main()")
_STEPS = 8  # of the run, of 15, before the live page is shown
_PATIENCE = 300_000.0  # ms; kernels are compiled once on a machine


@contextmanager
def opened(browser: Browser, scheme: str, width: int, height: int) -> Iterator[Page]:
    """Give an empty page in a colour scheme."""
    dark = scheme == "dark"
    context = browser.new_context(
        viewport={"width": width, "height": height}, color_scheme="dark" if dark else "light"
    )
    context.set_default_timeout(_PATIENCE)
    yield context.new_page()
    context.close()


def picture_report(browser: Browser, folder: Path) -> None:
    """Take the head of the report that `inercal demo` writes."""
    subprocess.run([*_PROGRAM, "demo", "--out", str(folder)], check=True, capture_output=True)
    for scheme, end in SCHEMES.items():
        with opened(browser, scheme, 1100, 860) as page:
            page.goto((folder / "mimu.report.html").as_uri())
            page.screenshot(path=IMAGES / f"report{end}.png")


def picture_live_page(browser: Browser, folder: Path) -> None:
    """Take the live page amid a simulated run."""
    command = [*_PROGRAM, "bench", "serve", "--plans", str(folder), "--runs", str(folder / "runs")]
    with subprocess.Popen(
        [*command, "--port", "0", "--speed", "20"], stdout=subprocess.PIPE, text=True
    ) as serving:
        assert serving.stdout is not None
        line = next(one for one in serving.stdout if "http://" in one)
        address = re.search(r"http://\S+", line)
        assert address is not None
        try:
            for scheme, end in SCHEMES.items():
                with opened(browser, scheme, 1366, 768) as page:
                    page.goto(address[0])
                    if scheme == "light":
                        _start(page)
                    page.locator("#clock", has_text=f"step {_STEPS} of").wait_for()
                    page.wait_for_timeout(1000.0)  # the plots fill
                    page.screenshot(path=IMAGES / f"live-page{end}.png")
        finally:
            serving.terminate()


def _start(page: Page) -> None:
    page.get_by_label("Name").first.fill("Ada Lovelace")
    page.locator("#plans input:enabled").first.check()
    page.locator("#start").click()
    page.locator("#start-yes").click()


if __name__ == "__main__":
    with sync_playwright() as playwright, TemporaryDirectory() as name:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        picture_report(chromium, Path(name))
        picture_live_page(chromium, Path(name))
        chromium.close()
