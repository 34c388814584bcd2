"""Keys of a terminal: each is heard, however many come at once."""

import os
import pty
import sys
from collections.abc import Callable
from pathlib import Path
from time import monotonic, sleep
from typing import Any, cast

import pytest
from tests.refusals import refused

from inercal.cli.bench_view import listen_to_keys
from inercal.cli.mounting_answers import read_answers
from inercal.host.spin_sequencer import MountingRequest

PATIENCE = 20.0  # s


class Asked:
    """A run that keeps what it is asked."""

    has_mountings = False

    def __init__(self):
        self.all: list[str] = []

    def request(self, what: str) -> None:
        self.all.append(what)

    def call_before_request(self, drop: Callable[[], object]) -> None:
        """Have no requests."""


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


class AskedToMount(Asked):
    """A run that asks for mountings, one after the other, and keeps who confirms them.

    It asks for the next when it is told to.
    """

    has_mountings = True

    def __init__(self, mountings: list[str]):
        super().__init__()
        self.confirmed: list[tuple[int, str]] = []
        self.requested = 0
        self._mountings = mountings
        self._drop: Callable[[], object] = lambda: None

    def call_before_request(self, drop: Callable[[], object]) -> None:
        self._drop = drop

    def ask(self) -> None:
        """Ask for the next mounting, once the last is confirmed."""
        until(lambda: len(self.confirmed) == self.requested)
        self._drop()
        self.requested += 1

    @property
    def mounting_request(self) -> MountingRequest | None:
        number = len(self.confirmed)
        if number == self.requested:
            return None
        return MountingRequest(number, self._mountings[number], "mount it")

    def confirm_mounting(self, number: int, mounting: str, by: str) -> None:
        assert mounting == self._mountings[number]
        self.confirmed.append((number, by))


def until(condition: Callable[[], bool]) -> None:
    end = monotonic() + PATIENCE
    while not condition():
        assert monotonic() < end
        sleep(0.002)


def test_a_typed_line_confirms_the_mounting_that_it_names(monkeypatch: pytest.MonkeyPatch):
    terminal, host = pty.openpty()
    run = AskedToMount(["XY", "YX"])
    with os.fdopen(host, encoding="utf-8") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        with listen_to_keys(cast("Any", run), "Anna"):
            os.write(terminal, b"mounted XY\nmounted")
            run.ask()
            # The keys of a run are heard, whatever was hit before; a name may contain them.
            os.write(terminal, b" XY\nmmpmounted pg\nm\nmounted\nmounted YX\nmounted XY\n")
            until(lambda: run.confirmed == [(0, "Anna")])
            os.write(terminal, b"mounted YX\n")
            run.ask()
            os.write(terminal, "mounted XY\nmounted YZ\b\bYX Jürgen\n".encode())
            until(lambda: len(run.confirmed) == 2)
    assert run.confirmed == [(0, "Anna"), (1, "Jürgen")]
    assert run.all == ["pause"]
    os.close(terminal)


def test_a_line_confirms_the_mounting_that_it_names_and_the_end_of_lines_stops_the_run(
    monkeypatch: pytest.MonkeyPatch,
):
    told, lines = os.pipe()
    run = AskedToMount(["XY", "YX", "ZY"])
    os.write(lines, b"mounted XY\nmounted YX\nmounted X")
    with os.fdopen(told, encoding="utf-8") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        with listen_to_keys(cast("Any", run), "Anna"):
            run.ask()
            os.write(lines, b"Y\nyes\nmounted\nmounted YX\nmounted XY\n")
            until(lambda: run.confirmed == [(0, "Anna")])
            os.write(lines, b"mounted YX\n")
            run.ask()
            os.write(lines, b"mounted XY Eve\nmounted YX Ben von Au\n")
            run.ask()
            os.write(lines, b"mounted ZY")  # the beginning of a line
            os.close(lines)
            until(lambda: bool(run.all))
    assert run.confirmed == [(0, "Anna"), (1, "Ben von Au")]
    assert run.all == ["stop"]


def test_a_file_of_answers_confirms_each_mounting_once(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    path = tmp_path / "answers.txt"
    path.write_text("# bench 2\nmounted ZY Cleo\nmounted XY\n\nmounted YX Ben\n")
    run = AskedToMount(["XY", "ZY", "YX", "XY"])
    with open(os.devnull, encoding="utf-8") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        with listen_to_keys(cast("Any", run), "Anna", path):
            for _ in range(4):
                run.ask()
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
