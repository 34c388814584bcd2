"""Keys of a terminal: each is heard, however many come at once."""

import os
import pty
import sys
from time import monotonic, sleep
from typing import Any, cast

import pytest

from inercal.cli.bench_view import listen_to_keys

PATIENCE = 20.0  # s


class Asked:
    """A run that keeps what it is asked."""

    def __init__(self):
        self.all: list[str] = []

    def request(self, what: str) -> None:
        self.all.append(what)


def test_keys_that_come_at_once_are_heard_one_by_one(monkeypatch: pytest.MonkeyPatch):
    terminal, host = pty.openpty()
    asked = Asked()
    with os.fdopen(host, encoding="utf-8") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        with listen_to_keys(cast("Any", asked)):
            os.write(terminal, b"px\xc3\xa4gp")
            end = monotonic() + PATIENCE
            while len(asked.all) < 3:
                assert monotonic() < end
                sleep(0.002)
        assert asked.all == ["pause", "go on", "pause"]
    os.close(terminal)


def test_a_terminal_that_ends_is_listened_to_no_more(monkeypatch: pytest.MonkeyPatch):
    terminal, host = pty.openpty()
    reads: list[int] = []

    def ended(descriptor: int, most: int) -> bytes:
        reads.append(descriptor)
        return b""

    asked = Asked()
    with os.fdopen(host, encoding="utf-8") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        monkeypatch.setattr("inercal.cli.bench_view.os.read", ended)
        with listen_to_keys(cast("Any", asked)):
            os.write(terminal, b"p")
            end = monotonic() + PATIENCE
            while not reads:
                assert monotonic() < end
                sleep(0.002)
    assert len(reads) == 1
    assert asked.all == []
    os.close(terminal)
