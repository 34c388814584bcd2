"""Keys of a terminal: each is heard, however many come at once."""

import os
import pty
import sys
from collections.abc import Callable
from fcntl import ioctl
from pathlib import Path
from termios import FIONREAD
from time import monotonic, sleep
from typing import Any, cast

import pytest
from tests.refusals import refused

from inercal.cli.bench_view import listen_to_keys
from inercal.cli.mounting_answers import read_answers
from inercal.host.mounting_prompt import MountingRequest

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


def taken(pipe: int) -> bool:
    """Tell whether all that was written into a pipe has been read."""
    return ioctl(pipe, FIONREAD, bytes(4)) == bytes(4)


class AskedToMount(Asked):
    """A run that asks for mountings, one after the other, and keeps who confirms them."""

    has_mountings = True

    def __init__(self, mountings: list[str]):
        super().__init__()
        self.confirmed: list[tuple[int, str]] = []
        self._mountings = mountings

    @property
    def mounting_request(self) -> MountingRequest | None:
        number = len(self.confirmed)
        if number == len(self._mountings):
            return None
        return MountingRequest(number, self._mountings[number], "mount it")

    def confirm_mounting(self, number: int, by: str) -> None:
        self.confirmed.append((number, by))


def until(condition: Callable[[], bool]) -> None:
    end = monotonic() + PATIENCE
    while not condition():
        assert monotonic() < end
        sleep(0.002)


def test_the_key_m_confirms_a_mounting_that_is_asked_for(monkeypatch: pytest.MonkeyPatch):
    terminal, host = pty.openpty()
    run = AskedToMount(["XY"])
    with os.fdopen(host, encoding="utf-8") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        with listen_to_keys(cast("Any", run), "Anna"):
            os.write(terminal, b"mmp")
            until(lambda: run.all == ["pause"])
    assert run.confirmed == [(0, "Anna")]
    os.close(terminal)


def test_a_line_confirms_the_mounting_that_it_names_and_the_end_of_lines_stops_the_run(
    monkeypatch: pytest.MonkeyPatch,
):
    told, lines = os.pipe()
    run = AskedToMount(["XY", "YX", "ZY"])
    with os.fdopen(told, encoding="utf-8") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        with listen_to_keys(cast("Any", run), "Anna"):
            os.write(lines, b"early\n")
            until(lambda: taken(told))
            os.write(lines, b"yes\nmounted\nmounted YX\nmounted XY\n")
            until(lambda: run.confirmed == [(0, "Anna")])
            os.write(lines, b"early\n")
            until(lambda: taken(told))
            os.write(lines, b"mounted XY Eve\nmounted YX Ben von Au\n")
            until(lambda: len(run.confirmed) == 2)
            os.close(lines)
            until(lambda: bool(run.all))
    assert run.confirmed == [(0, "Anna"), (1, "Ben von Au")]
    assert run.all == ["stop"]


def test_lines_from_before_a_request_confirm_nothing(monkeypatch: pytest.MonkeyPatch):
    told, lines = os.pipe()
    run = AskedToMount(["XY", "YX"])
    os.write(lines, b"mounted XY\nmounted YX\nmounted XY\n")
    with os.fdopen(told, encoding="utf-8") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        with listen_to_keys(cast("Any", run), "Anna"):
            until(lambda: taken(told))
            os.write(lines, b"mounted XY")  # the beginning of a line
            assert run.confirmed == []
            os.close(lines)
            until(lambda: bool(run.all))
    assert (run.confirmed, run.all) == ([], ["stop"])


def test_a_file_of_answers_confirms_each_mounting_once(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    path = tmp_path / "answers.txt"
    path.write_text("# bench 2\nmounted ZY Cleo\nmounted XY\n\nmounted YX Ben\n")
    run = AskedToMount(["XY", "ZY", "YX", "XY"])
    with open(os.devnull, encoding="utf-8") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        with listen_to_keys(cast("Any", run), "Anna", path):
            until(lambda: bool(run.all))
    by = " (by answers.txt)"
    assert run.confirmed == [(0, f"Anna{by}"), (1, f"Cleo{by}"), (2, f"Ben{by}")]
    assert run.all == ["stop"]


@pytest.mark.parametrize("line", ["mounted", "yes", "XY", "mount XY"])
def test_a_file_with_another_line_is_refused(tmp_path: Path, line: str):
    path = tmp_path / "answers.txt"
    path.write_text(f"mounted XY\n{line}\n")
    with refused(file=path) as caught:
        read_answers(path)
    assert caught.value.line == 2
