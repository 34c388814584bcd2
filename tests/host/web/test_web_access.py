"""Who is let in: origin, host, token, while a run goes on that must not feel it."""

from pathlib import Path

import pytest
from tests.host.web.pages import Page, Served, as_header
from websockets.exceptions import InvalidStatus

TOKEN = "correct horse battery"
EVIL = "http://evil.example"


@pytest.mark.slow
def test_a_websocket_of_another_origin_is_refused(served: Served, watched: Page):
    for origin in (EVIL, "null", None, "http://127.0.0.1:1", "https://x"):
        with pytest.raises(InvalidStatus) as refusal:
            served.page(origin=origin)
        assert refusal.value.response.status_code == 403
    served.was_refused("origin")


@pytest.mark.slow
def test_what_another_site_posts_is_refused(served: Served, watched: Page):
    for origin in (EVIL, "null", ""):
        answer = served.ask("/api/probe", "POST", b"{}", {"Origin": origin})
        assert answer.status == 403
    served.was_refused("'http://evil.example' is not this page's")
    refusal = served.ask("/api/stop", "POST", b"{}", {"Origin": ""}).body.decode()
    assert f"Origin with the address of the page, such as 'http://{served.host}'" in refusal


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_what_a_page_from_elsewhere_has_the_browser_fetch_is_refused(served: Served, site: str):
    for path in ("/api/setup", "/static/page.js", "/runs/x/report"):
        assert served.ask(path, headers={"Sec-Fetch-Site": site}).status == 403
    assert served.ask("/", headers={"Sec-Fetch-Site": site}).status == 200  # a link to the page


@pytest.mark.slow
def test_a_name_that_was_made_to_lead_here_is_refused(served: Served, watched: Page):
    host = f"evil.example:{served.port}"
    for path in ("/", "/api/setup", "/static/page.js"):
        assert served.ask(path, headers={"Host": host}).status == 421
    with pytest.raises(InvalidStatus) as refusal:
        served.page(host=host)
    assert refusal.value.response.status_code == 403
    served.was_refused(f"websocket /live: host '{host}'")


def test_without_the_token_nothing_is_served(tmp_path: Path):
    with Served(tmp_path, TOKEN) as served:
        for path in (
            "/",
            "/api/setup",
            "/static/page.js",
            "/runs/x/report",
            "/history/1",
            "/glossary",
            "/x",
        ):
            answer = served.ask(path)
            assert answer.status == 401
            assert b"<form" in answer.body
        assert served.ask("/api/probe", "POST", b"{}").status == 401
        session = f"inercal-session-{served.port}"
        for cookies in ({}, {session: TOKEN}, {session: "\xff"}):
            with pytest.raises(InvalidStatus) as refusal:
                served.page(cookies=cookies)
            assert refusal.value.response.status_code == 403
        served.was_refused("websocket /live: no token")
        served.was_refused("GET /api/setup: no token")


def test_who_has_shown_the_token_is_let_in(tmp_path: Path):
    with Served(tmp_path, TOKEN) as served:
        for answer in (
            served.ask(f"/?token={TOKEN.replace(' ', '+')}"),
            served.ask("/token", "POST", f"token={TOKEN}".encode()),
        ):
            assert answer.status == 303
            assert answer.headers["location"] == "/"
            (cookie,) = answer.cookies
            assert "HttpOnly" in cookie
            assert "SameSite=strict" in cookie
            assert TOKEN not in cookie
            name, _, value = cookie.partition(";")[0].partition("=")
            assert served.ask("/api/setup", headers={"Cookie": f"{name}={value}"}).status == 200
            with served.page(cookies={name: value}) as page:
                page.until("idle")
        with pytest.raises(InvalidStatus) as refusal:
            served.page(origin=EVIL, cookies={name: value})
        assert refusal.value.response.status_code == 403


@pytest.mark.slow
def test_two_servers_of_one_host_are_open_in_one_browser(tmp_path: Path):
    folders = tmp_path / "one", tmp_path / "other"
    for folder in folders:
        folder.mkdir()
    with Served(folders[0], TOKEN) as one, Served(folders[1], TOKEN) as other:
        kept = dict[str, str]()
        for served in (one, other):
            for said in served.ask("/token", "POST", f"token={TOKEN}".encode()).cookies:
                name, _, value = said.partition(";")[0].partition("=")
                kept[name] = value
        for served in (one, other):
            assert served.ask("/api/setup", headers=as_header(kept)).status == 200


def test_wrong_tokens_are_counted_and_then_the_right_one_is_not_looked_at(tmp_path: Path):
    with Served(tmp_path, TOKEN) as served:
        for k in range(10):
            assert served.ask("/token", "POST", b"token=wrong%d" % k).status == 401
        assert served.ask("/?token=wrong").status == 429
        assert served.ask(f"/?token={TOKEN.replace(' ', '+')}").status == 429
        served.was_refused("too many wrong tokens")


def test_a_page_may_load_nothing_but_its_own_and_stand_in_no_frame(served: Served):
    answer = served.ask("/")
    policy = answer.headers["content-security-policy"]
    assert "default-src 'self'" in policy
    assert "frame-ancestors 'none'" in policy
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert answer.headers["referrer-policy"] == "no-referrer"
