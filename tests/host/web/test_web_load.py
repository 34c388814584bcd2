"""A run of 2 kHz in real time with twenty viewers, while one client takes all it can get.

The server, the run, the table and the IMU are processes of their own, as on a bench.
"""

import http.client
import socket
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from datetime import UTC, datetime
from pathlib import Path
from threading import Event
from time import monotonic

import pytest
from tests.host.simulated_runs import SHORT, plan
from tests.host.web.pages import COMPILING, PATIENCE, RUNNING, Page, opened
from tests.host.web.test_web_process_survival import Serving
from websockets.exceptions import ConnectionClosed, InvalidStatus

from inercal.host.bench_simulator import BenchSimulator
from inercal.host.journal import Journal
from inercal.host.preparation import precompile_run

RATE, VIEWERS, SLOW_POSTS, SOCKETS = 2000, 20, 300, 40
GIVEN = {"table": {"id": "given"}, "imu": {"id": "given"}}
STOP_LIMIT = 0.05  # s from the message to the run's answer


def get(port: int, path: str, cookie: str = "") -> http.client.HTTPResponse:
    """Return the answer to a request, its body read."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=PATIENCE)
    connection.request("GET", path, headers={"Cookie": cookie} if cookie else {})
    answer = connection.getresponse()
    answer.read()
    return answer


def browser(port: int) -> dict[str, str]:
    """Return the cookie of a browser that has opened the page."""
    said = get(port, "/").getheader("Set-Cookie") or ""
    name, _, value = said.partition(";")[0].partition("=")
    return {name: value}


def look_on(page: Page, ended: Event) -> int:
    """Hear a page as a browser does, until the end; return how many samples came."""
    count = 0
    with suppress(ConnectionClosed, TimeoutError, OSError):
        while not ended.is_set():
            message = page.next()
            count += len(message["t"]) if message["kind"] in ("samples", "coarse") else 0
            page.heard.clear()
    return count


def press(port: int, ended: Event) -> int:
    """Hold slow requests and websockets, and begin anew those that are closed; count rounds."""
    head = (
        f"POST /api/probe HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nOrigin: http://127.0.0.1:{port}"
        "\r\nContent-Length: 100\r\n\r\n{"
    ).encode()
    rounds, theirs = 0, browser(port)
    while not ended.is_set():
        rounds += 1
        with ExitStack() as stack:
            for _ in range(SLOW_POSTS):
                with suppress(OSError):
                    one = stack.enter_context(socket.create_connection(("127.0.0.1", port), 5))
                    one.sendall(head)
            for _ in range(SOCKETS):
                with suppress(InvalidStatus, OSError, TimeoutError):
                    stack.enter_context(opened(port, cookies=theirs, slow=True))
            ended.wait(2.0)
    return rounds


@pytest.mark.slow
@pytest.mark.wall_time
@pytest.mark.parametrize("seconds", [8.0, pytest.param(60.0, marks=pytest.mark.evidence)])
def test_a_run_keeps_all_samples_and_hears_stop_whatever_one_client_does(
    tmp_path: Path, seconds: float
):
    path = SHORT.replace("22", f"{22 + seconds:g}")
    run = plan(tmp_path / "plans", path, [('rate = "200 Hz"', f'rate = "{RATE} Hz"')])
    precompile_run(run)
    with ExitStack() as stack:
        bench = stack.enter_context(BenchSimulator(run.path, seed=4, rate_hz=RATE, pace=1.0))
        serving = stack.enter_context(Serving(tmp_path, "--table", bench.table, "--imu", bench.imu))
        port, pool = serving.port, stack.enter_context(ThreadPoolExecutor(VIEWERS + 1))
        mine = browser(port)
        with opened(port, cookies=mine) as page:
            page.operate("Ada")
            page.say("start", plan="plan", sensor=None, **GIVEN)
            name = page.until("plan", COMPILING)["run"]
            page.until("state", COMPILING)
        ended = Event()
        with ExitStack() as pages:
            pages.callback(ended.set)
            viewers = [
                pool.submit(look_on, pages.enter_context(opened(port)), ended)
                for _ in range(VIEWERS)
            ]
            pressed = pool.submit(press, port, ended)
            end, reloads, slowest = monotonic() + seconds, 0, 0.0
            while monotonic() < end:
                begun = monotonic()
                for part in ("/", "/static/main.js", "/api/setup"):
                    cookie = "; ".join(f"{key}={value}" for key, value in mine.items())
                    assert get(port, part, cookie).status == 200
                with opened(port, cookies=mine, tab="a") as page:
                    page.until("people", operator="Ada", yours=True)
                    page.until("state")
                reloads, slowest = reloads + 1, max(slowest, monotonic() - begun)
            with opened(port, cookies=mine, tab="a") as page:
                state = page.until("state")
                sent = datetime.now(UTC)
                page.say("stop")
                page.until("done", RUNNING)
            ended.set()
            samples, rounds = sum(one.result() for one in viewers), pressed.result()
    with Journal(tmp_path / "runs" / name / "run.journal") as journal:
        stop = next(e for e in journal.events() if e.words == "stopped by the operator")
    took = (datetime.fromisoformat(stop.at) - sent).total_seconds()
    packets = state["imu"]["packets"]
    print(
        f"{packets} packets, {state['imu']['lost']} lost; {samples} samples seen by viewers; "
        f"{reloads} reloads, the slowest {slowest:.2f} s; {rounds} rounds of pressure; STOP heard "
        f"after {1000 * took:.0f} ms"
    )
    assert state["imu"]["lost"] == 0
    assert packets > RATE * (state["time"] - 1)
    assert reloads > 1
    assert took < STOP_LIMIT
