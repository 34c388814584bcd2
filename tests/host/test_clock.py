"""Time of a run: the wall's, and a simulated bench's, which says what its IMU has sent."""

import ast
import socket
from collections.abc import Iterator
from pathlib import Path
from threading import Thread

import pytest
from tests.refusals import refused

from inercal import host
from inercal.host import clock
from inercal.host.clock import MonotonicClock, SimulatedClock, Tick, read_host_uptime
from inercal.host.link import LinkLost


class Wall:
    """A wall clock that passes only while somebody sleeps."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch):
        self.passed = 0.0
        monkeypatch.setattr(clock, "monotonic", lambda: 50.0 + self.passed)
        monkeypatch.setattr(clock, "sleep", self.sleep)

    def sleep(self, seconds: float) -> None:
        assert seconds > 0
        self.passed += seconds


@pytest.fixture
def wall(monkeypatch: pytest.MonkeyPatch) -> Wall:
    return Wall(monkeypatch)


class Scripted:
    """A bench's end of the clock, which gives the answers it was told to give."""

    def __init__(self, *answers: str):
        self.asked: list[str] = []
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.address = f"clock://127.0.0.1:{self._listener.getsockname()[1]}"
        self._thread = Thread(target=self._serve, args=(answers,), daemon=True)
        self._thread.start()

    def _serve(self, answers: tuple[str, ...]) -> None:
        end, _ = self._listener.accept()
        with end, end.makefile("rw") as lines:
            for answer in answers:
                self.asked.append(lines.readline().strip())
                lines.write(answer)
                lines.flush()

    def close(self) -> None:
        self._thread.join(5.0)
        self._listener.close()


@pytest.fixture
def bench() -> Iterator[type[Scripted]]:
    made: list[Scripted] = []

    class MessageHistory(Scripted):
        def __init__(self, *answers: str):
            super().__init__(*answers)
            made.append(self)

    yield MessageHistory
    for one in made:
        one.close()


def test_a_run_begins_at_the_time_it_is_given_and_goes_on_from_there(wall: Wall):
    told = MonotonicClock(100.0)
    assert told.now() == pytest.approx(100.0)
    wall.sleep(2.5)
    assert told.now() == pytest.approx(102.5)


@pytest.mark.slow
def test_of_the_host_only_what_is_stored_named_or_shown_reads_the_date():
    readers = set[str]()
    for path in Path(host.__path__[0]).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.Import | ast.ImportFrom):
                continue
            names = {one.name for one in node.names}
            module = node.module if isinstance(node, ast.ImportFrom) else "time"
            if (module == "time" and "time" in names) or names & {"datetime", "date"}:
                readers.add(path.name)
    assert readers == {"journal.py", "folders.py"}


def test_the_uptime_of_the_host_goes_on_and_names_its_boot():
    first, second = read_host_uptime(), read_host_uptime()
    if first is None or second is None:
        pytest.skip("this system tells no uptime")
    assert first.boot == second.boot
    assert 0 < first.seconds <= second.seconds


def test_on_the_wall_a_tick_ends_when_its_time_has_come_and_nobody_knows_what_was_sent(wall: Wall):
    told = MonotonicClock(0.0)
    told.begin(0.02)
    assert wall.passed == 0.0
    tick = told.end()
    assert tick[:3] == (pytest.approx(0.02), None, pytest.approx(0.02))
    told.begin(0.01)  # has been
    assert told.end().time == pytest.approx(0.02)


def test_a_bench_is_asked_at_once_and_heard_at_the_end(bench: type[Scripted]):
    scripted = bench("7.5 100 7.5\n", "7.52 120 7.5\n")
    with_clock = SimulatedClock(scripted.address)
    assert with_clock.now() == 7.5
    with_clock.begin(7.52)
    assert with_clock.now() == 7.5
    assert with_clock.end() == Tick(7.52, 120, 7.5)
    assert with_clock.now() == 7.52
    with_clock.close()
    scripted.close()
    assert scripted.asked == ["now", "until 7.52"]


def test_times_are_told_whole(bench: type[Scripted]):
    scripted = bench("0 0 0\n", "0.30000000000000004 0 0\n")
    with_clock = SimulatedClock(scripted.address)
    with_clock.begin(0.1 + 0.2)
    assert with_clock.end().time == 0.1 + 0.2
    with_clock.close()
    scripted.close()
    assert scripted.asked[1] == "until 0.30000000000000004"


def test_a_paced_bench_goes_no_faster_and_does_not_make_up_for_a_pause(
    wall: Wall, bench: type[Scripted]
):
    scripted = bench("0 0 0\n", *(f"{k} 0 0\n" for k in range(1, 5)))
    with_clock = SimulatedClock(scripted.address, speed=10.0)
    for k in (1.0, 2.0):
        with_clock.begin(k)
        with_clock.end()
        assert wall.passed == pytest.approx(k / 10)
    wall.sleep(60.0)
    for k, passed in ((3.0, 60.2), (4.0, 60.3)):
        with_clock.begin(k)
        with_clock.end()
        assert wall.passed == pytest.approx(passed)
    with_clock.close()


@pytest.mark.parametrize("answer", ["", "no: possible: until TIME, now\n", "1.0 x 2.0\n"])
def test_a_bench_that_is_gone_or_no_bench_is_a_lost_link(bench: type[Scripted], answer: str):
    scripted = bench("0 0 0\n", answer)
    with_clock = SimulatedClock(scripted.address)
    with_clock.begin(1.0)
    with pytest.raises(LinkLost):
        with_clock.end()
    with_clock.close()


def test_nobody_there_is_a_lost_link():
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with pytest.raises(LinkLost):
        SimulatedClock(f"clock://127.0.0.1:{port}")


@pytest.mark.parametrize("address", ["clock://x", "tcp://127.0.0.1:1", "clock:", "clock://h:99999"])
def test_an_address_that_is_no_clock_is_refused(address: str):
    with refused(key="--clock"):
        SimulatedClock(address)


@pytest.mark.parametrize("speed", [0.0, -1.0, float("nan")])
def test_a_speed_that_is_none_is_refused(speed: float):
    with refused(key="--speed"):
        SimulatedClock("clock://127.0.0.1:1", speed)


def test_ends_and_begins_take_turns(bench: type[Scripted]):
    scripted = bench("0 0 0\n", "1 0 0\n")
    with_clock = SimulatedClock(scripted.address)
    with pytest.raises(RuntimeError):
        with_clock.end()
    with_clock.begin(1.0)
    with pytest.raises(RuntimeError):
        with_clock.begin(2.0)
    with_clock.close()
