"""One client that takes all it can get: the operator's page, STOP and others go on."""

import json
import socket
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from time import monotonic

import pytest
from tests.host.web.pages import PATIENCE, SIMULATED, Page, Served, as_header, sockets, unharmed
from websockets.exceptions import InvalidStatus

from inercal.host.web.server import MAX_CONNECTIONS
from inercal.host.web.viewers import MAX_VIEWERS

TOKEN = "correct horse battery"
SLOW_POSTS = 300


@contextmanager
def slow_posts(served: Served, count: int, path: str = "/api/probe") -> Iterator[None]:
    """Begin so many requests whose bodies never come, and do not read their answers."""
    own = f"Host: {served.host}\r\nOrigin: http://{served.host}\r\nContent-Length: 100\r\n"
    opened = sockets(served.port, count)
    try:
        for one in opened:
            with suppress(ConnectionError):
                one.sendall(f"POST {path} HTTP/1.1\r\n{own}\r\n{{".encode())
        yield
    finally:
        for one in opened:
            one.close()


@contextmanager
def crowd(served: Served, count: int, cookies: Mapping[str, str] | None = None) -> Iterator[int]:
    """Open so many websockets of one client; yield how many there are places for."""
    with ExitStack() as stack:
        taken = 0
        for _ in range(count):
            with suppress(InvalidStatus):
                stack.enter_context(served.page(cookies=cookies))
                taken += 1
        yield taken


@pytest.mark.slow
def test_slow_bodies_delay_nobody_elses_request(served: Served, watched: Page):
    with slow_posts(served, SLOW_POSTS):
        for path in ("/", "/api/setup", "/static/main.js") * 3:
            assert served.ask(path).status == 200
        assert served.ask("/api/filter", "POST", b'{"plan": "none"}').status in (200, 400)
        unharmed(watched)
        served.was_refused("or it was the oldest of more than")


@pytest.mark.slow
def test_connections_that_ask_nothing_delay_nobody(served: Served, watched: Page):
    opened = sockets(served.port, MAX_CONNECTIONS + 50)
    try:
        for _ in range(3):
            assert served.ask("/").status == 200
        served.was_refused(f"there are more than {MAX_CONNECTIONS} connections")
        assert served.ask("/api/setup").status == 200
        unharmed(watched)
    finally:
        for one in opened:
            one.close()


@pytest.mark.slow
def test_a_body_without_the_token_is_not_waited_for(tmp_path: Path):
    with Served(tmp_path, TOKEN) as served:
        for path in ("/api/probe", "/api/stop", "/x"):
            own = {"Content-Length": "100"}
            begun = monotonic()
            assert served.ask(path, "POST", None, own).status == 401
            assert monotonic() - begun < PATIENCE / 4
        with slow_posts(served, SLOW_POSTS, "/token"):
            assert served.ask("/token", "POST", f"token={TOKEN}".encode()).status == 303


@pytest.mark.slow
def test_one_client_with_all_places_gives_way_to_the_operator_and_to_others(served: Served):
    mine, theirs = served.viewer("mine"), served.viewer("theirs")
    for cookies in (theirs, None, {f"inercal-viewer-{served.port}": "of-its-own-choice"}):
        with crowd(served, MAX_VIEWERS + 8, cookies) as taken:
            assert taken == MAX_VIEWERS
            with served.page(cookies=mine) as page:  # who has not operated yet
                page.operate("Ada")
                page.start()
            with served.page(cookies=mine) as page, served.page(cookies=mine) as second:
                page.until("people", operator="Ada", viewers=MAX_VIEWERS)
                page.operate("Ada")
                second.say("stop")
                page.until("done")
                page.say("leave")
                page.until("people", operator=None)
        served.wait(lambda: not served.hub.people.viewers)
    served.was_refused("its place was given to another client")


@pytest.mark.slow
def test_the_page_that_operates_gives_way_to_nobody(served: Served, watched: Page):
    """Its client has most places, and each of another client takes one of the others of it."""
    with crowd(served, MAX_VIEWERS) as taken, ExitStack() as stack:
        assert taken == MAX_VIEWERS - 1
        for k in range(MAX_VIEWERS):
            with suppress(InvalidStatus):
                stack.enter_context(served.page(cookies=served.viewer(f"browser {k}")))
        unharmed(watched)
        with suppress(InvalidStatus):
            served.page().close()
        assert len(served.hub.people.viewers) == MAX_VIEWERS


@pytest.mark.slow
def test_clients_of_equally_many_places_do_not_drive_each_other_out(served: Served):
    browsers = [served.viewer(f"browser {k}") for k in range(MAX_VIEWERS + 1)]
    with ExitStack() as stack:
        for cookies in browsers[:-1]:
            stack.enter_context(served.page(cookies=cookies))
        with pytest.raises(InvalidStatus):
            served.page(cookies=browsers[-1])
        answer = served.ask("/api/stop", "POST", b"")  # who has no place can stop all the same
        assert (answer.status, "no active run" in answer.json["words"]) == (409, True)


@pytest.mark.slow
def test_a_stop_needs_no_websocket(served: Served):
    with served.page() as page:
        page.operate()
        page.start()
        assert served.ask("/api/stop", "POST", b"[]").status == 400
        assert served.ask("/api/stop", "POST", b'{"run": "another"}').status == 409
        page.until("samples")
        assert served.ask("/api/stop", "POST", b"").status == 200
        page.until("done")


@pytest.mark.parametrize("chosen", ["ada", "ada.x", "", "\u00e9", "a" * 5000])
def test_a_viewers_cookie_cannot_be_chosen(served: Served, chosen: str):
    cookies = {f"inercal-viewer-{served.port}": chosen}
    (issued,) = served.ask("/", headers=as_header(cookies)).cookies
    assert chosen == "" or chosen not in issued
    probe = json.dumps({"plan": "demo", **SIMULATED}).encode()
    with served.page(cookies=cookies) as page, served.page(cookies=cookies, tab="a") as other:
        page.operate("Ada")
        other.say("operate", name="Eve")
        assert other.until("refused")["words"] == "Ada operates"
        assert served.ask("/api/probe", "POST", probe, as_header(cookies)).status == 403


def test_a_page_that_outlives_its_server_is_given_a_cookie_of_the_new_one(served: Served):
    name = f"inercal-viewer-{served.port}"
    with served.page(cookies={name: "of.another-server"}) as page:
        page.operate("Ada")
        response = page.connection.response
        assert response is not None
        said = response.headers["Set-Cookie"]
        assert "HttpOnly" in said
        own = dict([said.partition(";")[0].split("=", 1)])
    with served.page(cookies=own) as page:
        page.until("people", operator="Ada", yours=True)
    assert not served.ask("/", headers=as_header(own)).cookies


def test_requests_for_the_lists_share_one_reading_of_them(
    served: Served, monkeypatch: pytest.MonkeyPatch
):
    calls: list[float] = []

    def setup(_: object) -> dict[str, int]:
        calls.append(monotonic())
        served.wait(lambda: len(served.server.server_state.tasks) > 50)
        return {"call": len(calls)}

    monkeypatch.setattr("inercal.host.web.app.Page._setup", setup)
    opened = sockets(served.port, 60)
    for one in opened:
        one.sendall(f"GET /api/setup HTTP/1.1\r\nHost: {served.host}\r\n\r\n".encode())
    for one in opened:
        one.settimeout(PATIENCE)
        assert _status(one) == 200
        one.close()
    assert len(calls) <= 3


def _status(connection: socket.socket) -> int:
    return int(connection.recv(65536).split()[1])
