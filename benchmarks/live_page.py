"""What the live page costs: six channels at 200 Hz for a minute, in real time, one who looks on.

The bench is simulated at the pace of the wall's clock; the page is drawn by Chromium without a
screen. Measured are the time between two pictures of the charts, the processor time of the process
that serves, and how its memory and the page's grow in the second half of the minute.
"""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from playwright.sync_api import CDPSession, Page

from benchmarks import Row, Skipped

CHROMIUM = Path("/usr/bin/chromium")
MINUTE = 60.0  # s
COMPILING = 300_000.0  # ms
PICTURE, PART, GROWTH = 1e3 / 30, 15.0, 1.05  # ms, % of a core, of memory
LIMIT = "limit"


def rows() -> Iterator[Row | Skipped]:
    """Yield frames a second, processor time and growth."""
    if not CHROMIUM.exists():
        yield Skipped("live page", f"{CHROMIUM} is missing")
        return
    with TemporaryDirectory() as folder, serving(Path(folder)) as (process, address):
        yield from looked_at(process, address)


@contextmanager
def serving(folder: Path) -> Iterator[tuple[int, str]]:
    """Serve the page of a bench that is simulated in real time; give its process and address."""
    for name in ("demo.toml", "demo_path.csv"):
        (folder / name).write_bytes(files("inercal").joinpath(name).read_bytes())
    where = ["--plans", str(folder), "--runs", str(folder / "runs"), "--port", "0"]
    where += ["--register", str(folder / "register.db"), "--speed", "1"]
    process = subprocess.Popen(
        [sys.executable, "-m", "inercal", "bench", "serve", *where],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    try:
        assert process.stdout
        yield process.pid, process.stdout.readline().split()[-1]
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate()


def looked_at(process: int, address: str) -> Iterator[Row]:
    """Start a run by the page, and look at it for a minute once the filters have begun."""
    from playwright.sync_api import sync_playwright
    from tests.browser.page_actions import choose_plan, confirm_start

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1400, "height": 1000})
        page.goto(address)
        page.get_by_label("Name").first.fill("benchmark")
        choose_plan(page, "demo.toml")
        confirm_start(page)
        page.locator("#attitude-numbers").wait_for(timeout=COMPILING)
        session = page.context.new_cdp_session(page)
        begin, frames, spent = monotonic(), drawn(page), seconds(process)
        page.wait_for_timeout(500 * MINUTE)
        memory, heap = resident(process), heaped(session)
        page.wait_for_timeout(500 * MINUTE)
        wall = monotonic() - begin
        frames, spent = drawn(page) - frames, seconds(process) - spent
        name = f"live page, {wall:.0f} s of six channels at 200 Hz: "
        yield Row(f"{name}a picture", 1e3 * wall / frames, PICTURE, LIMIT, "ms")
        yield Row(f"{name}serving, of a core", 100 * spent / wall, PART, LIMIT, "%")
        for what, before, after in (
            ("memory of serving", memory, resident(process)),
            ("memory of the page", heap, heaped(session)),
        ):
            yield Row(f"{name}{what}, to half time", after / before, GROWTH, LIMIT, "")
        browser.close()


def drawn(page: "Page") -> int:
    """Return how many pictures of the charts the page has drawn."""
    return page.evaluate("window.inercal.frames")


def seconds(process: int) -> float:
    """Return the processor time of a process, all its threads, s."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def resident(process: int) -> int:
    """Return the memory of a process, kB."""
    (line,) = [
        one for one in Path(f"/proc/{process}/status").read_text().splitlines() if "VmRSS" in one
    ]
    return int(line.split()[1])


def heaped(session: "CDPSession") -> float:
    """Return what the page keeps in memory once what is over was thrown away, bytes."""
    session.send("HeapProfiler.collectGarbage")
    return session.send("Runtime.getHeapUsage")["usedSize"]
