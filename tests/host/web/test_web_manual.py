"""A manual session and the server: who commands, what excludes what, what stops the axes."""

import os
import signal
import socket
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from math import degrees
from pathlib import Path
from threading import Event
from time import monotonic

import pytest
from tests.host.by_hand import pmac_of
from tests.host.simulated_runs import plan
from tests.host.web.pages import PATIENCE, SIMULATED, Page, Served
from tests.host.web.test_web_process_survival import Serving

from inercal.host.journal import Journal
from inercal.host.sim.bench_simulator import COUNTS_PER_TURN, BenchDevice
from inercal.host.sim.server import ScaledClock, SimulatorServer
from inercal.host.sim.simulated_errors import draw_errors
from inercal.host.web.run_request import MANUAL_JOURNAL, read_process_record, run_in_progress
from inercal.runfile import Run

INNER = 2
RATE = 10.0  # °/s of a jog
ACCELERATION = 15.0  # °/s², of the demonstration's bench
STOP = 0.3  # s from the last message of a held key to the stop
TIMES = 3  # of each way in which messages cease
IMU = {"address": "tcp://127.0.0.1:9?preset=fixed"}  # is not read


@dataclass
class WatchedTable:
    """A simulated table in this process, at the pace of the wall, and when it was told to stop."""

    address: str
    device: BenchDevice
    clock: ScaledClock
    halts: list[float] = field(default_factory=list[float])

    @property
    def rate(self) -> float:
        """°/s of the inner axis."""
        return degrees(float(pmac_of(self.device).table.state[INNER].rate))

    def until(self, condition: Callable[[], bool]) -> None:
        end, tick = monotonic() + PATIENCE, Event()
        while not condition():
            assert monotonic() < end
            tick.wait(0.005)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return plan(tmp_path_factory.mktemp("plans"))


@pytest.fixture
def table(run: Run) -> Iterator[WatchedTable]:
    device, clock = BenchDevice(draw_errors(run, 1)), ScaledClock()
    with SimulatorServer(device, clock) as server:
        address = server.address.replace("tcp", "pmac", 1)
        where = f"{address}?motors=1,2,3&counts={COUNTS_PER_TURN}"
        watched = WatchedTable(where, device, clock)
        halt = pmac_of(device).table.halt

        def halted(i: int, abort: bool = False) -> None:
            if i == INNER:
                watched.halts.append(clock())
            halt(i, abort)

        pmac_of(device).table.halt = halted
        yield watched


def begin(page: Page, table: WatchedTable, name: str = "Ada") -> str:
    """Begin a manual session, with the servo of the inner axis on; return its name."""
    page.operate(name)
    chosen = {"table": {"address": table.address}, "imu": IMU}
    page.say("begin manual", plan="demo", with_imu=False, **chosen)
    session = page.until("plan")["run"]
    state = page.until("state")
    while not state["manual"]:  # the table has not been read yet
        state = page.until("state")
    if not state["manual"][INNER]["servo"]:  # a session before has left it on
        page.say("manual", ask={"what": "servo", "axis": "inner", "on": True})
        page.until("event", words=f"{name}: axis inner: servo on")
    return session


def jog(page: Page, table: WatchedTable, press: int, seconds: float = 1.2) -> float:
    """Hold a jog; return the time of the table when the last message was sent."""
    ask = {"what": "jog", "axis": "inner", "rate": RATE, "press": press}
    page.say("manual", ask=ask)
    end, tick = monotonic() + seconds, Event()
    while monotonic() < end:
        tick.wait(0.1)
        page.say("manual", ask={"what": "hold", "press": press})
    last = table.clock()
    assert table.rate == pytest.approx(RATE, rel=0.05)
    return last


def stopped_since(table: WatchedTable, last: float) -> float:
    """Wait for rest; return when the table was told to stop after the last message, s later."""
    table.until(lambda: abs(table.rate) < 0.05 and table.clock() > last + STOP)
    rests = table.clock() - last
    first = min(time for time in table.halts if time > last) - last
    assert rests < STOP + RATE / ACCELERATION + 0.5  # the servo settles, and it is looked at
    return first


def journal(folder: Path, session: str) -> list[tuple[str, str]]:
    with Journal(folder / "runs" / session / MANUAL_JOURNAL) as opened:
        return [(event.level, event.words) for event in opened.events()]


@pytest.mark.slow
def test_one_operates_by_hand_and_no_run_begins_meanwhile(tmp_path: Path, table: WatchedTable):
    with Served(tmp_path) as served, served.page() as page, served.page() as other:
        session = begin(page, table)
        for command in ("begin manual", "manual", "release"):
            other.say(command, plan="demo", ask={"what": "halt"}, **SIMULATED)
            assert "operator" in other.until("refused")["words"], command
        for command in ("start", "begin manual", "resume"):
            page.say(command, plan="demo", sensor=None, run="x", **SIMULATED)
            assert "manual" in page.until("refused")["words"], command
        for asked in ({"what": "kill"}, {"what": "home"}, None, [1]):
            page.say("manual", ask=asked)
            page.until("refused")
        page.say("manual", ask={"what": "go", "axis": "inner", "angle": 5, "rate": 1})
        refusal = page.until("event", level="warning")
        assert "home it first" in refusal["words"]
        page.say("note", text="the cable is slack")
        page.until("event", level="note")
        # Who gives control back stops what is jogged, and nobody jogs then.
        page.say("manual", ask={"what": "jog", "axis": "inner", "rate": 1, "press": 1})
        page.say("leave")
        page.until("event", words="the server: halt all axes: the operator has released control")
        other.operate("Bob")
        other.say("abort")
        assert other.until("done")["state"] == "manual"
    said = journal(tmp_path, session)
    assert ("note", "Ada: the cable is slack") in said
    assert any("Ada: axis inner: jog" in words for _, words in said)
    assert said[-1][1] == "the session ends: ended by the operator"
    assert not served.runs.all()  # it is no run


def test_no_session_by_hand_begins_during_a_run(tmp_path: Path, table: WatchedTable):
    with Served(tmp_path) as served, served.page() as page:
        page.operate()
        page.start()
        page.say("begin manual", plan="demo", table={"address": table.address}, imu=IMU)
        assert page.until("refused")["words"].startswith("another run is active")
        page.say("manual", ask={"what": "halt"})
        assert "manual" in page.until("refused")["words"]
        page.say("abort")
        page.until("done")


@pytest.mark.slow
def test_any_viewer_stops_the_table_by_the_watchdog(tmp_path: Path, table: WatchedTable):
    with Served(tmp_path) as served, served.page() as page, served.page() as other:
        begin(page, table)
        last = jog(page, table, 1, 0.8)
        other.say("stop")
        assert page.until("done")["words"] == "stopped by the operator"
        assert stopped_since(table, last) < STOP


@pytest.mark.slow
def test_of_a_table_that_is_not_there_nothing_is_kept(tmp_path: Path):
    with Served(tmp_path) as served, served.page() as page:
        page.operate()
        nowhere = {"address": "pmac://127.0.0.1:9?motors=1,2,3&counts=3600000"}
        page.say("begin manual", plan="demo", table=nowhere, imu=IMU)
        page.until("done", state="manual")
    assert not list((tmp_path / "runs").iterdir())


@pytest.mark.wall_time
@pytest.mark.slow
@pytest.mark.parametrize("how", ["messages cease", "the page is gone"])
def test_a_jog_stops_within_0_3_s_of_the_last_message(
    tmp_path: Path, table: WatchedTable, how: str
):
    with Served(tmp_path) as served:
        page = served.page(cookies=served.viewer("x"))
        begin(page, table)
        for press in range(1, TIMES + 1):
            last = jog(page, table, press)
            if how == "the page is gone":
                page.connection.socket.shutdown(socket.SHUT_RDWR)  # no word of the websocket
                took = stopped_since(table, last)
                page = served.page(cookies=served.viewer("x"))
                page.operate("Ada")
            else:
                took = stopped_since(table, last)
            print(f"{how}: told to stop {took:.3f} s after the last message")
            assert took < STOP
        page.say("abort")
        page.until("done")
        page.close()


@pytest.mark.wall_time
@pytest.mark.slow
@pytest.mark.parametrize("which", ["server", "session", "server frozen"])
def test_a_process_that_is_killed_leaves_the_table_at_rest(
    tmp_path: Path, table: WatchedTable, which: str
):
    for number in range(TIMES):
        folder = tmp_path / str(number)
        folder.mkdir()
        with Serving(folder) as serving, serving.page() as page:
            session = begin(page, table)
            place = folder / "runs" / session
            last = jog(page, table, 1)
            if which == "server":
                serving.killed()
            elif which == "server frozen":
                serving.process.send_signal(signal.SIGSTOP)
            else:
                note = read_process_record(place)
                assert note is not None
                os.kill(note.process, signal.SIGKILL)
            took = stopped_since(table, last)
            print(f"{which} killed: told to stop {took:.3f} s after the last message")
            assert took < STOP
            if which == "server frozen":
                serving.process.send_signal(signal.SIGCONT)
                page.say("abort")
                page.until("done")
            table.until(lambda place=place: not run_in_progress(place))
        said = journal(folder, session)
        if which == "server":
            assert said[-1][1] == "the session ends: the server of the page is gone"
        table.halts.clear()
