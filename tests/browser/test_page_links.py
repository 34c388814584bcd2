"""The page over links as they are: who comes late, a slow one, one that breaks."""

import json
import socket
from collections.abc import Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path
from selectors import EVENT_READ, DefaultSelector
from threading import Event, Thread
from time import monotonic
from typing import Self

import pytest
from playwright.sync_api import Page, WebSocket, expect
from tests.browser import messages
from tests.browser.conftest import PageErrors
from tests.browser.live_run import PAST, LiveRun
from tests.browser.page_actions import choose_plan, confirm_start
from tests.host.web.pages import SIMULATED, Served

from inercal.host.web.run_request import RunProcess, RunRequest
from inercal.host.web.viewers import OPERATOR_GRACE

pytestmark = pytest.mark.slow

SLOW = 4000  # bytes a second
STATE_SOON = 12.0  # s of a link of 4 kB/s: the plan of 31 steps and 24 coefficients comes first


BULK = {"coarse", "estimates", "events"}


class SlowProxy:
    """A link to a server: so many bytes a second to the browser, all connections together.

    Attributes
    ----------
    rate : float
        Bytes a second.
    cut : bool
        Nothing passes, and nobody is told.
    """

    def __init__(self, port: int, rate: float):
        self.rate, self.cut, self._target = rate, False, port
        self._listens = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listens.getsockname()[1]
        self._ends, self._pairs = Event(), list[socket.socket]()
        self._threads: list[Thread] = []
        self._due = monotonic()

    def drop(self) -> None:
        """Break all connections."""
        for one in self._pairs:
            with suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)

    def _accept(self) -> None:
        while not self._ends.is_set():
            try:
                near, _ = self._listens.accept()
            except OSError:
                return
            far = socket.create_connection(("127.0.0.1", self._target), 20)
            # A link keeps little: what waits, waits at the server.
            far.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
            self._pairs += [near, far]
            thread = Thread(target=self._carry, args=(near, far), daemon=True)
            self._threads.append(thread)
            thread.start()

    def _carry(self, near: socket.socket, far: socket.socket) -> None:
        selector = DefaultSelector()
        selector.register(near, EVENT_READ, far)
        selector.register(far, EVENT_READ, near)
        with suppress(OSError), near, far:
            while not self._ends.is_set():
                for key, _ in selector.select(0.2):
                    source = near if key.fileobj is near else far
                    data = source.recv(512)
                    while self.cut and not self._ends.wait(0.05):
                        pass
                    if source is far:
                        self._wait_for_turn(len(data))
                    if not data:
                        return
                    (far if source is near else near).sendall(data)

    def _wait_for_turn(self, count: int) -> None:
        """Wait until so many bytes may pass."""
        self._due = max(self._due, monotonic()) + count / self.rate
        self._ends.wait(max(0.0, self._due - monotonic()))

    def __enter__(self) -> Self:
        self._threads.append(Thread(target=self._accept, daemon=True))
        self._threads[0].start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ends.set()
        self._listens.shutdown(socket.SHUT_RDWR)  # which ends a call of accept; close does not
        self._listens.close()
        self.drop()
        for one in self._threads:
            one.join(20)
        for one in self._pairs:
            one.close()


class Bench:
    """A server with a run that goes on."""

    def __init__(self, folder: Path):
        self.runs: list[LiveRun] = []

        def start(order: RunRequest) -> RunProcess:
            self.runs.append(LiveRun(order))
            return self.runs[-1]

        self.served = Served(folder, start=start)

    def begin(self) -> LiveRun:
        """Start a run by another page, and wait until it has a past."""
        with self.served.page() as page:
            page.operate("Grace")
            page.say("start", plan="demo", sensor=None, **SIMULATED)
            page.until("state")
            page.say("leave")
            page.until("people", operator=None)
        return self.runs[-1]

    def address(self, port: int | None = None) -> str:
        return f"http://127.0.0.1:{port or self.served.port}/"


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    made = Bench(tmp_path)
    with made.served:
        yield made
        for run in made.runs:
            run.stop()


def _note_messages(told: list[list[str]], made: WebSocket) -> None:
    """Keep the kinds of the messages of a connection."""
    kinds: list[str] = []
    told.append(kinds)

    def note(frame: str | bytes) -> None:
        message = json.loads(frame)
        kinds.append("alarm" if message.get("level") == "alarm" else message["kind"])

    made.on("framereceived", note)


def shown_points(page: Page, chart: str) -> float:
    """Return the share of a plot's width that its lines fill, by the pixels of its canvas."""
    return page.evaluate(
        """(id) => {
        const canvas = document.querySelector(`${id} canvas`);
        const over = document.querySelector(`${id} .u-over`);
        if (!canvas) return 0;
        const ratio = devicePixelRatio, style = getComputedStyle(document.documentElement);
        const colour = name =>
            style.getPropertyValue(name).match(/\\w\\w/g).map(h => parseInt(h, 16));
        const inks = ["--x", "--y", "--z", "--ink"].map(colour);
        const [left, top] = [over.offsetLeft * ratio, over.offsetTop * ratio].map(Math.round);
        const [wide, tall] = [over.clientWidth * ratio, over.clientHeight * ratio].map(Math.round);
        const copy = document.createElement("canvas");
        [copy.width, copy.height] = [canvas.width, canvas.height];
        const pen = copy.getContext("2d", { willReadFrequently: true });
        pen.drawImage(canvas, 0, 0);
        const data = pen.getImageData(left, top, wide, tall).data;
        let columns = 0;
        for (let i = 0; i < wide; i++) for (let k = 0; k < tall; k++) {
            const at = 4 * (k * wide + i);
            const near = ink => ink.every((c, n) => Math.abs(c - data[at + n]) < 48);
            if (data[at + 3] > 128 && inks.some(near)) { columns += 1; break; }
        }
        return columns / wide; }""",
        chart,
    )


def expect_filled(page: Page) -> None:
    """Expect lines in every plot, over nearly its whole width."""
    for chart in ('[data-measures="f"]', '[data-measures="w"]', "#course-plot"):
        page.locator(chart).scroll_into_view_if_needed()
        enough = 0.6 if chart == "#course-plot" else 0.85  # early guesses are cut off in a close-up
        deadline = monotonic() + 20
        while (share := shown_points(page, chart)) < enough:
            assert monotonic() < deadline, f"{chart}: filled by {share:.2f}"
            page.wait_for_timeout(100)


def test_who_comes_late_sees_the_run_as_it_stands_and_filled_plots(page: Page, bench: Bench):
    bench.begin()
    told: list[list[str]] = []
    page.on("websocket", partial(_note_messages, told))
    page.goto(bench.address())
    expect(page.locator("#phase")).to_have_text("x down 1, measuring")
    expect(page.locator("#waits")).to_be_hidden()
    expect(page.get_by_role("button", name="ax.k0: −").first).to_be_visible()
    expect_filled(page)
    expect(page.locator("#event-list li")).to_have_count(91)
    assert told[0].index("state") < min(told[0].index(kind) for kind in ("samples", "events"))
    words = page.locator("#event-list li").all_inner_texts()
    assert [one.split()[-1] for one in words if " event " in one] == [
        str(k) for k in range(89, -1, -1)
    ]


@pytest.mark.slow
def test_over_4_kilobytes_a_second_state_and_alarms_come_before_samples_and_stay_new(
    page: Page, bench: Bench, watched: PageErrors
):
    run = bench.begin()
    with SlowProxy(bench.served.port, 1e6) as proxy:
        bench.served.take_port(proxy.port)
        told: list[list[str]] = []  # kinds of messages, by connection
        page.on("websocket", partial(_note_messages, told))
        page.goto(bench.address(proxy.port))
        expect(page.locator("#link[data-link=live]")).to_be_visible()
        proxy.rate = SLOW
        proxy.drop()
        begun = monotonic()
        expect(page.locator("#link[data-link=lost]")).to_be_visible()
        expect(page.locator("#link[data-link=live]")).to_be_visible()
        for kinds, patience in (({"state"}, STATE_SOON), (BULK, 2 * STATE_SOON)):
            while not kinds <= set(told[-1]):
                assert monotonic() - begun < patience, f"no {kinds} after {patience} s: {told[-1]}"
                page.wait_for_timeout(50)
        for first in ("state", "alarm"):
            before = told[-1][: told[-1].index(first)]
            assert not (BULK | {"samples"}) & set(before), f"{before} came before {first}"
        assert "samples" not in told[-1]  # means of them are enough for such a link
        # What is said now is here within seconds, though the past is still coming.
        run.tell(messages.event(PAST + 20, "axis outer: amplifier fault", "alarm"))
        said = monotonic()
        expect(page.get_by_role("alert").filter(has_text="amplifier fault")).to_be_visible()
        assert monotonic() - said < 4.0
        # The state stays new, and the link is not given up.
        for _ in range(5):
            before = page.locator("#clock").inner_text()
            expect(page.locator("#clock")).not_to_have_text(before, timeout=5000)
        expect(page.locator("#link[data-link=live]")).to_be_visible()
        expect_filled(page)
        assert len(told) == 2
    watched.errors[:] = [one for one in watched.errors if "/live" not in one]


@pytest.mark.slow
def test_an_operator_whose_link_breaks_without_a_word_has_the_place_again(
    page: Page, bench: Bench, watched: PageErrors
):
    with SlowProxy(bench.served.port, 1e6) as proxy:
        bench.served.take_port(proxy.port)
        page.goto(bench.address(proxy.port))
        page.get_by_label("Name").first.fill("Ada")
        choose_plan(page, "demo.toml")
        confirm_start(page)
        expect(page.locator("#people[data-operator=me]")).to_be_visible()
        expect(page.locator("#phase")).to_contain_text("measuring")
        proxy.cut = True
        expect(page.locator("#link[data-link=lost]")).to_be_visible()
        began = monotonic()
        proxy.cut = False
        proxy.drop()
        expect(page.locator("#link[data-link=live]")).to_be_visible()
        expect(page.locator("#people[data-operator=me]")).to_be_visible()
        assert monotonic() - began < OPERATOR_GRACE
        expect_filled(page)
        page.keyboard.press("p")
        bench.served.wait(lambda: "pause" in bench.runs[-1].commands)
    watched.errors[:] = [one for one in watched.errors if "/live" not in one]


def test_after_the_end_and_a_connection_made_anew_the_plots_are_filled(page: Page, bench: Bench):
    run = bench.begin()
    page.goto(bench.address())
    expect(page.locator("#phase")).to_contain_text("measuring")
    run.tell(messages.done())
    expect(page.locator("#finished[data-state=done] #verdict")).to_be_visible()
    page.reload()
    expect(page.locator("#finished[data-state=done] #verdict")).to_be_visible()
    expect_filled(page)
