"""Names, messages and requests that mean nothing, or mean harm."""

import socket
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import pytest
from tests.host.web.pages import SIMULATED, Served
from tests.store.calibration_generator import ten

from inercal.host.web.json_objects import parse_object
from inercal.laboratory.store import Register

PATHS = [
    "/static/../app.py",
    "/static/%2e%2e/app.py",
    "/static/..%2fapp.py",
    "/static/%2e%2e%2f%2e%2e%2frun.py",
    "/static//etc/passwd",
    "/static/..\\app.py",
    "/static/%00",
    "/../../../../etc/passwd",
    "/runs/../report",
    "/runs/../../etc/report",
    "/runs/%2e%2e/report",
    "/runs/..%2f..%2fruns/report",
    "/runs/x/../../../etc/passwd",
    "/runs/x/journal",
    "/history/../../etc/passwd",
    "/history/1%2f..",
    "/history/-1",
    "/history/99999999999999999999",
    "/history/" + "9" * 5000,
    "/history/%C2%B2",
]


def test_no_name_of_a_request_is_a_path(served: Served, tmp_path: Path):
    (tmp_path / "runs" / "plan.report.html").write_text("secret")
    for path in PATHS:
        answer = served.ask(path)
        assert answer.status == 404, path
        assert b"secret" not in answer.body, path
        assert b"import" not in answer.body, path


@pytest.mark.slow
def test_histories_are_pages_and_without_what_draws_them_one_line(
    served: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    with Register(served.register) as register:
        register.enter_calibrations(ten(tmp_path)[:3])
    with ThreadPoolExecutor(4) as pool:  # figures are drawn one at a time
        pages = list(pool.map(served.ask, ["/history/1"] * 4))
    assert [page.status for page in pages] == [200] * 4
    assert all(b"<svg" in page.body for page in pages)
    assert b"no sensor 2" in served.ask("/history/2").body
    with Register(served.register) as register:  # else the page that was drawn is the answer
        register.enter_calibrations(ten(tmp_path)[3:4])
    for name in [name for name in sys.modules if name.startswith("inercal.report.")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    answer = served.ask("/history/1")
    assert answer.body == b"reports need matplotlib and jinja2: pip install 'inercal[report]'\n"
    assert answer.status == 404


def test_plans_and_runs_are_looked_up_and_never_joined_to_a_path(served: Served):
    for name in ("../demo", "/etc/passwd", "..", "", None, 3, ["demo"], {}):
        with served.page() as page:
            page.operate()
            page.say("start", plan=name, **SIMULATED)
            assert "no plan" in page.until("refused")["words"]
            page.say("resume", run=name, **SIMULATED)
            assert "no interrupted run" in page.until("refused")["words"]
            page.say("stop", run=name)
            assert "no active run" in page.until("refused")["words"]
            page.say("leave")
            page.until("people", operator=None)
    served.was_refused("no plan")


MESSAGES = [
    ("", "JSON"),
    ("hello", "JSON"),
    ("[1, 2]", "JSON"),
    ("3", "JSON"),
    ("null", "JSON"),
    ("[" * 4000, "JSON"),
    ('{"do": "start"', "JSON"),
    ("{}", "possible: operate"),
    ('{"do": "burn"}', "possible: operate"),
    ('{"do": ["pause"]}', "possible: operate"),
    ('{"do": {"a": 1}}', "possible: operate"),
    ('{"do": "start", "plan": "demo"}', "no table is chosen"),
    ('{"do": "start", "plan": "demo", "table": 3, "imu": []}', "no table is chosen"),
    ('{"do": "start", "plan": "demo", "table": {"id": "simulated"}}', "both simulated"),
    ('{"do": "operate", "name": 7}', "give a name"),
    ('{"do": "operate", "name": "\\u0007"}', "give a name"),
    ('{"do": "operate", "name": "' + "a" * 1000 + '"}', "give a name"),
]


def test_messages_that_mean_nothing_are_refused_in_words(served: Served):
    for message, words in MESSAGES:
        with served.page() as page:
            page.operate()
            page.connection.send(message)
            assert words in page.until("refused")["words"], message
            page.say("leave")
            page.until("people", operator=None)
    served.was_refused("viewer 1: ")


REQUESTS = [
    b"\x16\x03\x01\x02\x00\x01\x00",
    b"GET /\x1b[2J HTTP/1.1\r\n\r\n",
    b"G" * 100_000,
    b"GET / HTTP/1.1\r\nX: " + b"y" * 100_000,
    b"GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n",
    b"POST /api/probe HTTP/1.1\r\nContent-Length: -1\r\n\r\n",
]


def test_requests_that_are_none_are_refused(served: Served):
    for request in REQUESTS:
        with (
            served.page() as page,
            socket.create_connection(("127.0.0.1", served.port), 20) as connection,
        ):
            connection.sendall(request + b"\r\n\r\n")
            with suppress(ConnectionError):
                assert connection.recv(100).startswith(b"HTTP/1.1 4"), request
            page.until("idle")
    assert not any("\x1b" in line for line in served.refused)


@pytest.mark.parametrize("text", ['{"do": "\\ud800"}', '{"a": {"\\udfff": 1}}', "[]", "[" * 9999])
def test_a_message_that_no_reply_can_hold_is_no_object(text: str):
    """JSON can name half of a surrogate pair; UTF-8 cannot write it."""
    for raw in (text, text.encode()):
        with pytest.raises(ValueError, match=r"JSON|surrogate"):
            parse_object(raw)
