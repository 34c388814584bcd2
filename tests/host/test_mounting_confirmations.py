"""No confirmation that is early, wrong or repeated lets a table turn, whichever way it comes.

Forty confirmations, eight for each of five ways: lines on a pipe, lines typed at a terminal, a
file of answers, messages as the page sends them, and messages of other programs.
"""

import asyncio
import os
import pty
import sys
from collections.abc import Callable, Generator, Iterator
from contextlib import suppress
from pathlib import Path
from threading import Event
from time import monotonic
from types import SimpleNamespace
from typing import Any, Protocol, cast

import pytest
from tests.host.in_process_bench import ADDRESSES, InProcessBench
from tests.host.test_ship_run import Killed, ship
from tests.refusals import refused

from inercal.basics.errors import InputError
from inercal.cli import mounting_answers
from inercal.cli.bench_view import listen_to_keys
from inercal.cli.mounting_answers import read_answers
from inercal.host.addresses import DeviceAddresses
from inercal.host.bench_run import BenchRun
from inercal.host.journal import Journal
from inercal.host.run_folder import create_run
from inercal.host.web.device_catalogue import DeviceCatalogue
from inercal.host.web.folders import Plans, Runs
from inercal.host.web.hub import Hub
from inercal.host.web.worker import CommandRelay

PATIENCE = 20.0  # s
FIRST, SECOND = "XY", "YX"
TICKS = 5  # of the run after each confirmation that must not count
LIMIT = 1e-3  # rad/s


class Way(Protocol):
    """Confirms a mounting; what it says of one that does not count is in `refusals`."""

    refusals: list[str]

    def send(self, kind: str, name: str, number: int) -> None: ...


class Lines:
    """Lines on a pipe or a terminal."""

    def __init__(self, place: int, said: list[str]):
        self.place, self.refusals = place, said

    def send(self, kind: str, name: str, number: int) -> None:
        text = {
            "begun early": f"mounted {name[:1]}",
            "the rest of it": f"{name[1:]}\n",
            "unnamed": "mounted\n",
            "misspelt": f"mounted {name.lower()}\n",
        }
        os.write(self.place, text.get(kind, f"mounted {name}\n").encode())


class Messages:
    """Messages to the hub of a page, whose run is this one."""

    def __init__(self, folder: Path, run: BenchRun, of_page: bool):
        self.refusals: list[str] = []
        self._of_page, relay = of_page, CommandRelay()
        relay.attach(run)
        for name in ("plans", "runs"):
            (folder / name).mkdir()
        self.hub = Hub(Plans(folder / "plans"), Runs(folder / "runs"), DeviceCatalogue(""))

        def send_line(line: str) -> bool:
            relay.command(line)
            return True

        self.hub.run_process = cast("Any", SimpleNamespace(send_line=send_line, order=None))
        self.viewer = self.hub.people.add_viewer("a browser")
        assert self.hub.people.take_seat(self.viewer, "Eve") is None

    def send(self, kind: str, name: str, number: int) -> None:
        asked: dict[str, Any] = {"do": "mounted", "number": number, "mounting": name}
        other: dict[str, dict[str, Any]] = {
            "begun early": {"number": 0} if self._of_page else {"number": None},
            "the rest of it": {"number": number + 1} if self._of_page else {"number": f"{number}"},
            "unnamed": {"mounting": ""} if self._of_page else {"mounting": None},
            "misspelt": {"mounting": name.lower()} if self._of_page else {"mounting": [name]},
        }
        try:
            asyncio.run(self.hub.execute(self.viewer, asked | other.get(kind, {})))
        except InputError as error:
            self.refusals.append(str(error))


class Attempted(BenchRun):
    """A run that is told something before each tick."""

    script: Iterator[None]

    def _tick(self) -> None:
        next(self.script)
        super()._tick()


def attempts(run: Attempted, bench: InProcessBench, way: Way, count: list[str]) -> Iterator[None]:
    """Confirm early, wrongly and twice, a tick for each; the right ones are the last of each."""

    def stands(name: str, kind: str) -> Generator[None]:
        for _ in range(TICKS):
            yield
            request = run.mounting_request
            assert request is not None, kind
            assert request.mounting == name
            assert abs(bench.device.controller.table.state.rate[0]) < LIMIT, kind
        count.append(kind)

    def wrong(kind: str, name: str, waits_for: str) -> Generator[None]:
        assert run.mounting_request is not None
        before = len(way.refusals)
        way.send(kind, name, run.mounting_request.number)
        if isinstance(way, Lines):  # which are read by another thread
            until(lambda: len(way.refusals) > before)
        yield from stands(waits_for, kind)

    early = run.sequencer.number
    way.send("early", FIRST, early)
    way.send("begun early", FIRST, early)
    while run.mounting_request is None:
        yield
    yield from stands(FIRST, "early")
    yield from wrong("the rest of it", FIRST, FIRST)
    yield from wrong("another name", "QQ", FIRST)
    yield from wrong("the name of another mounting", SECOND, FIRST)
    yield from wrong("unnamed", FIRST, FIRST)
    yield from wrong("misspelt", FIRST, FIRST)
    right = run.mounting_request
    bench.device.mount(FIRST)
    way.send("right", FIRST, right.number)
    way.send("sent ahead", SECOND, right.number)
    while run.mounting_request == right:
        Event().wait(0.001)  # lines are read by another thread
        yield
    turned = False
    while run.mounting_request is None:
        turned |= abs(bench.device.controller.table.state.rate[0]) > LIMIT
        yield
    assert turned
    yield from stands(SECOND, "sent ahead")
    before = len(way.refusals)
    way.send("repeated", FIRST, right.number)
    if isinstance(way, Lines):
        until(lambda: len(way.refusals) > before)
    yield from stands(SECOND, "repeated")
    raise Killed


def until(condition: Callable[[], bool]) -> None:
    end = monotonic() + PATIENCE
    while not condition():
        assert monotonic() < end
        Event().wait(0.005)


@pytest.fixture
def said(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return what is said of lines."""
    words: list[str] = []
    monkeypatch.setattr(mounting_answers, "report_line", words.append)
    return words


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> InProcessBench:
    made = InProcessBench(ship(tmp_path / "plan"), 1)
    made.install(monkeypatch)
    return made


def drive(folder: Path, bench: InProcessBench, act: Callable[[Attempted], Iterator[None]]) -> bool:
    """Carry out the plan, told what `act` tells; True when all of it was told."""
    made, journal = create_run(folder, bench._run, ADDRESSES)
    with journal, Attempted(made, journal, DeviceAddresses(*ADDRESSES)) as run:
        run.script = act(run)
        with suppress(Killed):
            run.execute_plan()
            return False
    return True


@pytest.mark.parametrize("way", [
    pytest.param("typed", marks=pytest.mark.slow),
    *(pytest.param(way, marks=pytest.mark.evidence) for way in ("pipe", "page", "messages")),
])  # fmt: skip
def test_what_is_early_wrong_or_repeated_moves_nothing(
    tmp_path: Path, bench: InProcessBench, monkeypatch: pytest.MonkeyPatch, said: list[str],
    way: str,
):  # fmt: skip
    count: list[str] = []

    def by_messages(run: Attempted) -> Iterator[None]:
        yield from attempts(run, bench, Messages(tmp_path, run, way == "page"), count)

    def by_lines(run: Attempted) -> Iterator[None]:
        place, stdin = os.pipe()[::-1] if way == "pipe" else pty.openpty()
        with os.fdopen(stdin, encoding="utf-8") as opened:
            monkeypatch.setattr(sys, "stdin", opened)
            with listen_to_keys(run, "Anna"):
                yield from attempts(run, bench, Lines(place, said), count)

    folder = tmp_path / "run"
    assert drive(folder, bench, by_messages if way in ("page", "messages") else by_lines)
    print(f"{way}: {len(count)} confirmations, 0 moves: {', '.join(count)}")
    assert len(count) == 8
    with Journal(folder / "run.journal") as journal:
        assert journal.mounting() == FIRST
        confirmed = [e.words for e in journal.events() if "confirms: the sensor" in e.words]
    assert len(confirmed) == 1


FILES = {
    "empty": "# nobody has mounted anything\n",
    "another name": "mounted QQ\n",
    "the names of other mountings": "mounted YX Eve\nmounted ZY\n",
    "misspelt": "mounted xy\n",
    "longer": "mounted XY30\n",
    "repeated": "mounted XY\nmounted XY\n",
}


@pytest.mark.parametrize("kind", [
    pytest.param(kind, marks=[pytest.mark.evidence] * (kind != "misspelt")) for kind in FILES
])  # fmt: skip
def test_a_file_of_answers_moves_nothing_that_it_does_not_name(
    tmp_path: Path, bench: InProcessBench, said: list[str], kind: str
):
    path = tmp_path / "answers.txt"
    path.write_text(FILES[kind])
    waits_for = SECOND if kind == "repeated" else FIRST

    def act(run: Attempted) -> Iterator[None]:
        with mounting_answers.answer_mountings(run, "Anna", path):
            while run.mounting_request is None or run.mounting_request.mounting != waits_for:
                if run.mounting_request is not None:
                    bench.device.mount(run.mounting_request.mounting)
                    Event().wait(0.001)
                yield
            until(lambda: bool(said))  # the file has no answer, and the run is told to stop
            while True:
                assert abs(bench.device.controller.table.state.rate[0]) < LIMIT
                yield

    assert not drive(tmp_path / "run", bench, act)
    with Journal(tmp_path / "run" / "run.journal") as journal:
        assert journal.mounting() == ("XY" if kind == "repeated" else "")
        assert journal.header().state == "interrupted"


@pytest.mark.parametrize("line", ["mounted", "XY"])
def test_a_file_with_an_answer_that_names_nothing_is_refused(tmp_path: Path, line: str):
    path = tmp_path / "answers.txt"
    path.write_text(f"{line}\nmounted XY\n")
    with refused(file=path):
        read_answers(path)
