"""`inercal bench serve`: what it is given is what it serves by."""

import re
from pathlib import Path
from typing import Any

import pytest
from tests.refusals import refused

from inercal.basics.errors import InputError
from inercal.cli.bench_commands import serve
from inercal.host.tasks import RunOptions
from inercal.host.web import server

TOKEN, READ_TOKEN = "correct-horse-battery", "only-looks-and-never-touches"
READING = r"\nscripts may read with the token [\w-]{32}"


async def ends(*_: object, **__: object) -> None:
    """Serve nobody."""


def test_limits_of_runs_are_taken_as_of_bench_run(monkeypatch: pytest.MonkeyPatch):
    given: list[server.ServerOptions] = []
    monkeypatch.setattr(server, "serve", given.append)
    serve()
    serve(speed=20.0, temperature="15:40", patience=30.0, read_token=READ_TOKEN)
    assert [one.read_token for one in given] == [None, READ_TOKEN]
    ordinary, watched = (one.run_options for one in given)
    assert ordinary == RunOptions()
    assert watched == RunOptions(20.0, (288.15, 313.15), 30.0)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({}, r"http://127\.0\.0\.1:\d+/"),
        (
            {"token": TOKEN},
            rf"http://127\.0\.0\.1:\d+/ and asks for the token that you gave{READING}",
        ),
        ({"host": "0.0.0.0"}, rf"http://[^:]+:\d+/\?token=[\w-]{{32}}{READING}"),
        ({"host": "0.0.0.0", "token": TOKEN}, rf"http://[^:]+:\d+/ and asks for .*{READING}"),
        ({"host": "0.0.0.0", "read_token": READ_TOKEN}, r"http://[^:]+:\d+/\?token=[\w-]{32}"),
        ({"read_token": READ_TOKEN}, r"http://127\.0\.0\.1:\d+/"),
    ],
)
def test_the_link_has_a_token_that_was_made_and_none_that_was_given(
    options: dict[str, Any],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    monkeypatch.setattr(server.WebServer, "serve", ends)
    register = str(tmp_path / "register.db")
    served = server.ServerOptions(tmp_path, tmp_path / "runs", register, port=0, **options)
    server.serve(served)
    printed = capsys.readouterr()
    assert re.fullmatch(f"the page is at {said}\n", printed.out)
    assert TOKEN not in printed.out + printed.err
    assert READ_TOKEN not in printed.out + printed.err


@pytest.mark.parametrize(
    ("option", "key"),
    [
        ({"temperature": "40:15"}, "--temperature"),
        ({"temperature": "40"}, "--temperature"),
        ({"patience": 0.0}, "--patience"),
        ({"speed": -1.0}, "--speed"),
    ],
)
def test_limits_that_are_none_are_refused_before_anything_is_served(
    option: dict[str, Any], key: str
):
    with refused(InputError, key=key):
        serve(**option)
