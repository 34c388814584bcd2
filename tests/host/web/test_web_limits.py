"""What is too large, too many or too often, while a run goes on that must not feel it."""

import gzip
import re
import socket
import struct
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from threading import Event

import numpy as np
import pytest
from tests.host.web.pages import PATIENCE, Page, Served, sockets, unharmed
from tests.store.calibration_generator import ten
from websockets.exceptions import ConnectionClosed, InvalidStatus

from inercal.host.web.server import MAX_CONNECTIONS as CONNECTIONS
from inercal.host.web.viewers import MAX_VIEWERS as VIEWERS
from inercal.laboratory.store import NoiseEntry, Register, SensorHistory
from inercal.noise import NoiseAnalysis, analyse_noise
from inercal.recordings import Recording

HUGE = 100_000_000  # bytes


@pytest.mark.slow
def test_a_body_of_100_megabytes_is_refused_before_it_is_read(served: Served, watched: Page):
    own = f"Host: {served.host}\r\nOrigin: http://{served.host}\r\n"
    for head, chunk in (
        (f"Content-Length: {HUGE}", b"x" * 65536),
        ("Transfer-Encoding: chunked", b"10000\r\n" + b"x" * 65536 + b"\r\n"),
    ):
        sent, answer = 0, b""
        with socket.create_connection(("127.0.0.1", served.port), 20) as connection:
            connection.sendall(f"POST /api/probe HTTP/1.1\r\n{own}{head}\r\n\r\n".encode())
            with suppress(ConnectionError, TimeoutError):
                while sent < HUGE:
                    sent += connection.send(chunk)
            with suppress(ConnectionError):
                answer = connection.recv(4096)
        assert sent < HUGE / 5
        assert not answer or b" 413 " in answer
    served.wait(lambda: sum("the body is longer than" in line for line in served.refused) == 2)


@pytest.mark.slow
def test_a_body_that_does_not_come_is_not_waited_for(
    served: Served, watched: Page, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("inercal.host.web.json_objects._TIMEOUT", 0.1)
    own = {"Host": served.host, "Origin": f"http://{served.host}", "Content-Length": "10"}
    assert served.ask("/api/probe", "POST", None, own).status == 408
    served.was_refused("did not arrive within")


@pytest.mark.slow
def test_of_1000_sockets_most_are_closed_and_the_viewers_there_stay(served: Served, watched: Page):
    opened = sockets(served.port, 1000)
    try:
        unharmed(watched)
        served.wait(lambda: len(served.server.server_state.connections) == CONNECTIONS)
        closed = 0
        for connection in opened:
            connection.settimeout(0)
            try:
                closed += connection.recv(1) == b""
            except BlockingIOError:
                pass
            except ConnectionError:
                closed += 1
        assert closed >= 1000 - CONNECTIONS
        served.was_refused(f"there are more than {CONNECTIONS} connections")
        assert len(served.refused) < 100
    finally:
        for connection in opened:
            connection.close()
    served.wait(lambda: len(served.server.server_state.connections) < VIEWERS)
    with served.page() as page:
        page.until("samples")


@pytest.mark.slow
def test_a_socket_that_asks_nothing_is_closed(
    served: Served, watched: Page, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("inercal.host.web.server._IDLE_TIMEOUT", 0.1)
    with socket.create_connection(("127.0.0.1", served.port), 20) as connection:
        connection.sendall(b"GET / HTTP/1.1\r\nHost: ")
        with suppress(ConnectionError):
            assert connection.recv(1) == b""
    served.was_refused("did not ask anything")


@pytest.mark.slow
def test_a_request_whose_answer_takes_too_long_is_closed_and_a_viewer_stays(
    served: Served, watched: Page, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("inercal.host.web.server._REQUEST_TIMEOUT", 0.1)
    go_on = Event()
    monkeypatch.setattr("inercal.host.web.app.Page._setup", lambda _: go_on.wait(PATIENCE))
    try:
        with pytest.raises(ConnectionError):
            served.ask("/api/setup")
    finally:
        go_on.set()
    served.was_refused("took longer than")
    unharmed(watched)


def test_nothing_of_the_web_servers_inner_protocol_is_subclassed(served: Served):
    used = served.server.config.http_protocol_class
    assert used.__module__.startswith("uvicorn.")


@pytest.mark.slow
def test_more_viewers_than_there_may_be_are_refused_and_may_come_later(
    served: Served, watched: Page
):
    pages = [served.page() for _ in range(VIEWERS - 1)]
    with pytest.raises(InvalidStatus) as refusal:
        served.page()
    assert refusal.value.response.status_code == 403
    served.was_refused("too many viewers")
    watched.until("people", viewers=VIEWERS)
    unharmed(watched)
    for page in pages:
        page.close()
    served.wait(lambda: len(served.hub.people.viewers) == 1)
    with served.page() as page:
        page.until("samples")


@pytest.mark.slow
def test_messages_that_are_bytes_or_too_long_or_too_many_end_the_connection(
    served: Served, watched: Page
):
    with served.page() as page:
        page.connection.send(b"\x00\x01")
        assert page.closed() == 1003
    with served.page() as page:
        page.connection.send('{"do": "' + "x" * 5000 + '"}')
        assert page.closed() == 1009
    with served.page() as page:
        with suppress(ConnectionClosed):  # before the last of them
            for _ in range(60):
                page.connection.send('{"do": "leave"}')
        assert page.closed() == 1008
    served.was_refused("more than 20 messages per second")


@pytest.mark.slow
def test_frames_that_are_none_end_the_connection(served: Served, watched: Page):
    key = "dGhlIHNhbXBsZSBub25jZQ=="
    head = (
        f"GET /live HTTP/1.1\r\nHost: {served.host}\r\nOrigin: http://{served.host}\r\n"
        "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
        f"Sec-WebSocket-Key: {key}\r\n\r\n"
    ).encode()
    for frame in (
        b"\x83\x80\x00\x00\x00\x00",  # an opcode that there is not
        b"\x81\x05hello",  # not masked
        b"\x81\xff" + struct.pack(">Q", 1 << 62) + b"\x00" * 4,  # of 4 exabytes
        b"\x81\x82\x00\x00\x00\x00\xff\xfe",  # no UTF-8
        b"\xff" * 64,
    ):
        with socket.create_connection(("127.0.0.1", served.port), 20) as connection:
            connection.sendall(head)
            assert connection.recv(4096).startswith(b"HTTP/1.1 101")
            connection.sendall(frame)
            with suppress(ConnectionError):
                while connection.recv(65536):
                    pass
    served.wait(lambda: len(served.hub.people.viewers) == 1)


def test_histories_that_hang_keep_nobody_else_waiting_and_few_of_them_wait(
    served: Served, monkeypatch: pytest.MonkeyPatch
):
    drawn, go_on = Event(), Event()

    def history(*_: object) -> str:
        drawn.set()
        assert go_on.wait(PATIENCE)
        return "history"

    monkeypatch.setattr("inercal.host.web.app.Page._history", history)
    with ThreadPoolExecutor(9) as pool:
        try:
            asked = [pool.submit(served.ask, "/history/1") for _ in range(9)]
            assert drawn.wait(PATIENCE)
            served.was_refused("history: 4 already wait")
            assert served.ask("/api/setup").status == 200
            served.wait(lambda: sum(one.done() for one in asked) == 4)
        finally:
            go_on.set()
        assert sorted(one.result().status for one in asked) == [200] * 5 + [429] * 4
    assert served.ask("/history/1").status == 200


@pytest.mark.slow
def test_a_history_is_drawn_again_only_where_the_register_holds_something_else(
    served: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    drawn: list[int] = []

    def page(history: SensorHistory, noise: Sequence[NoiseEntry]) -> str:
        drawn.append(len(history.entries))
        return f"of {len(history.entries)} with {len(noise)}"

    monkeypatch.setattr("inercal.report.history_page", page)
    calibrations = ten(tmp_path)
    for count, asked in ((3, 3), (4, 2)):
        with Register(served.register) as register:
            register.enter_calibrations(calibrations[:count])
        said = {served.ask("/history/1").body.decode() for _ in range(asked)}
        assert said == {f"of {count} with 0"}
    with Register(served.register) as register:
        name = register.sensors()[0].name
        register.enter_noise(noise_of_white_gyros(), name, "2026-03-01")
    assert served.ask("/history/1").body.decode() == "of 4 with 1"
    assert drawn == [3, 4, 4]


@pytest.mark.slow
def test_the_history_of_a_sensor_without_calibrations_is_its_noise(served: Served):
    with Register(served.register) as register:
        register.enter_noise(noise_of_white_gyros(), "gyro 7", "2026-03-01")
    answer = served.ask("/history/1")
    assert answer.status == 200
    text = answer.body.decode()
    assert 'id="noise"' in text
    assert "no calibration yet" in text


def noise_of_white_gyros() -> NoiseAnalysis:
    """Return the noise of 1024 readings of three gyros."""
    y = 1e-3 * np.random.default_rng(1).standard_normal((1024, 3))
    recording = Recording(np.arange(1024.0), y, ("gx", "gy", "gz"), ("rad/s",) * 3)
    return analyse_noise(recording, terms="N", kinds=())


def test_the_files_of_the_page_are_small_over_a_slow_link(served: Served):
    """At 4 kB/s the page is there within 20 s."""
    page = served.ask("/").body.decode()
    names = {"/static/main.js", *re.findall(r'(?:src|href)="(/static/[^"]+)"', page)}
    sent, seen = 0, set(names)
    while names:
        name = names.pop()
        plain, packed = (served.ask(name, headers={"Accept-Encoding": e}) for e in ("", "gzip"))
        assert packed.headers["content-encoding"] == "gzip"
        assert gzip.decompress(packed.body) == plain.body
        sent += len(packed.body)
        if name.endswith(".js"):
            found = re.findall(r'from "\./(\w+\.js)"', plain.body.decode())
            names |= {f"/static/{one}" for one in found} - seen
            seen |= names
    assert sent < 20 * 4000


@pytest.mark.slow
def test_what_is_refused_is_said_on_one_line_each_and_not_too_often(served: Served, watched: Page):
    for k in range(60):
        served.ask(f"/no%0a%1b[31m{k}")
    lines = list(served.refused)
    assert all(line.isprintable() for line in lines)
    assert any("\\n\\x1b[31m" in line for line in lines)
    assert len(lines) < 40
