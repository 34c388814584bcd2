"""The guard: what makes it stop the table, that it does so in time, and what it does if it cannot.

The table's time is the wall's here: a guard is about hosts that no longer tell any.
"""

import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import radians
from multiprocessing import get_context
from pathlib import Path
from random import Random
from threading import Event
from time import monotonic
from typing import Any

import pytest

from inercal.host.drivers.pmac import Pmac, PmacAxis
from inercal.host.guard import Guard
from inercal.host.link import LinkLost
from inercal.host.sim.motor import SimulatedMotor
from inercal.host.sim.pmac import SimulatedPmac
from inercal.host.sim.server import ScaledClock, SimulatorServer

Served = SimulatorServer[SimulatedPmac]

AXES = tuple(PmacAxis(name, i, 3_600_000) for i, name in enumerate(("outer", "middle", "inner"), 1))
PATIENCE = 20.0  # s; what is waited for comes at once on an idle machine
SPEED = 10.0  # of the table against the wall


def _address(server: SimulatorServer[Any]) -> str:
    return server.address.replace("tcp://", "pmac://") + "?motors=1,2,3&counts=3600000"


def _until(true: Callable[[], object]) -> None:
    end = monotonic() + PATIENCE
    while not true():
        assert monotonic() < end, "it has not come"
        Event().wait(0.005)


def _hear(guard: Guard, line: str) -> list[str]:
    """Return what the guard says up to a line that begins so."""
    lines: list[str] = []

    def heard() -> bool:
        lines.extend(guard.read_lines())
        return any(text.startswith(line) for text in lines)

    _until(heard)
    return lines


def _turning(server: Served) -> bool:
    with server.lock:
        return bool(max(abs(server.device.table.state.rate)) > radians(1))


@pytest.fixture
def server() -> Iterator[Served]:
    with SimulatorServer(SimulatedPmac(), ScaledClock(SPEED)) as server:
        yield server


@pytest.fixture
def table(server: Served) -> Iterator[Pmac]:
    with Pmac(server.address, AXES, timeout=PATIENCE) as table:
        table.enable()
        table.spin("inner", radians(100), radians(200))
        _until(lambda: _turning(server))
        yield table


@pytest.fixture
def guard(server: Served, table: Pmac) -> Iterator[Guard]:
    with Guard(_address(server), silence=0.5) as guard:
        assert guard.read_lines() == []
        yield guard


@pytest.mark.slow
def test_a_table_is_stopped_on_request_and_twice_is_once(server: Served, table: Pmac, guard: Guard):
    assert guard.stop()
    assert guard.stop()
    assert _hear(guard, "at rest")[0] == "stopping: the host requested it"
    assert not _turning(server)
    assert table.read().axes[2].enabled
    guard.stop()  # one that stands
    assert _hear(guard, "at rest") == ["stopping: the host requested it", "at rest"]
    table.spin("inner", radians(100), radians(200))
    _until(lambda: _turning(server))
    guard.stop()
    _hear(guard, "at rest")
    assert not _turning(server)


def test_a_guard_that_is_let_go_leaves_the_table_as_it_is(server: Served, guard: Guard):
    guard.beat()
    guard.close()
    guard.close()
    assert guard.read_lines() == []
    assert not guard.alive
    assert not guard.stop()
    guard.beat()
    assert _turning(server)


@pytest.mark.slow
def test_silence_counts_from_the_first_beat_and_stops_once(server: Served, guard: Guard):
    quiet = monotonic() + 0.8
    _until(lambda: monotonic() > quiet)
    assert guard.read_lines() == []
    for _ in range(30):
        guard.beat()
        pause = monotonic() + 0.03
        _until(lambda pause=pause: monotonic() > pause)
    assert guard.read_lines() == []
    assert _turning(server)
    assert _hear(guard, "at rest") == ["stopping: the host was silent for 0.5 s", "at rest"]
    assert not _turning(server)
    quiet = monotonic() + 0.8
    _until(lambda: monotonic() > quiet)
    assert guard.read_lines() == []
    guard.beat()
    assert _hear(guard, "at rest")


@pytest.mark.slow
def test_what_a_host_commands_while_its_table_is_stopped_is_stopped_again(
    server: Served, table: Pmac, guard: Guard
):
    simulated = server.device.table
    halt, halts = simulated.halt, list[bool]()

    def halted(i: int, abort: bool = False) -> None:
        halt(i, abort)
        halts.append(abort)
        if halts.count(False) == 1 and not abort:
            simulated.rotate_axis(2, -1.0)  # arrives right behind the guard's last word

    with server.lock:
        simulated.halt = halted
    guard.stop()
    assert _hear(guard, "at rest") == ["stopping: the host requested it", "at rest"]
    assert halts.count(False) >= 2
    assert not _turning(server)


@pytest.mark.slow
def test_a_table_that_is_off_is_not_switched_on(server: Served, table: Pmac, guard: Guard):
    guard.stop()
    _hear(guard, "at rest")
    table.kill()
    seen = server.faults.replies
    _until(lambda: server.faults.replies > seen)  # the guard has looked
    guard.stop()
    assert _hear(guard, "at rest") == ["stopping: the host requested it", "at rest"]
    assert not any(axis.enabled for axis in table.read().axes)


@pytest.mark.slow
def test_a_table_that_does_not_slow_down_is_killed(server: Served, table: Pmac, guard: Guard):
    with server.lock:
        server.device.table.halt = lambda i, abort=False: None  # neither ^A nor J/ is obeyed
    guard.stop()
    lines = _hear(guard, "killed")
    assert lines[-1].startswith("killed: it turned at 100 °/s and did not slow down")
    assert not any(axis.enabled for axis in table.read().axes)
    # It coasts, and is not held while it does.
    _hear(guard, "at rest")
    assert not _turning(server)
    assert not any(axis.enabled for axis in table.read().axes)


@pytest.mark.slow
def test_a_motor_that_refuses_does_not_keep_the_guard_from_the_others(
    server: Served, table: Pmac, guard: Guard
):
    table.spin("outer", radians(50), radians(200))
    with server.lock:
        server.device.fault("amplifier 3")
    guard.stop()
    _hear(guard, "at rest")
    assert not _turning(server)


@pytest.mark.slow
def test_a_table_whose_controller_refuses_to_stop_is_killed(server: Served, guard: Guard):
    line, asked = server.device.interpreter.execute_line, list[bytes]()

    def refuses(packet: bytes, motor: int) -> tuple[bytes, int]:
        if b"J/" in packet:
            asked.append(packet)
            return b"\x07ERR012\r", motor
        return line(packet, motor)

    with server.lock:
        server.device.interpreter.execute_control = lambda character: None
        server.device.interpreter.execute_line = refuses
    guard.stop()
    lines = _hear(guard, "at rest")
    assert [line.partition(":")[0] for line in lines] == ["stopping", "cannot", "killed", "at rest"]
    assert "ERR012" in lines[1]
    assert len(asked) > 1
    assert not _turning(server)


def test_a_lost_link_is_made_anew_and_the_table_stopped_again(server: Served, guard: Guard):
    with server.lock:
        server.drop()
        server.faults.drop = 2
    guard.stop()
    _hear(guard, "at rest")
    assert not _turning(server)


def test_a_table_that_is_gone_and_comes_back_is_stopped(server: Served, table: Pmac, guard: Guard):
    simulated, port = server.device, server.port
    server.stop()
    guard.stop()
    assert "stopping: the host requested it" in _hear(guard, "cannot: ")
    assert guard.alive
    with SimulatorServer(simulated, ScaledClock(SPEED), port=port) as again:
        _hear(guard, "at rest")
        assert not _turning(again)


@pytest.mark.slow
def test_a_guard_without_host_and_table_gives_up_in_the_end(server: Served, table: Pmac):
    with Guard(_address(server), patience=0.5) as guard:
        server.stop()
        guard._close_pipe()  # as the system does of a host that is killed
        assert _hear(guard, "cannot: no reply from the table")[0] == "stopping: the host is gone"
        _until(lambda: not guard.alive)


@pytest.mark.slow
def test_an_idle_guard_finds_its_link_lost_and_says_when_it_is_ready_again(
    server: Served, guard: Guard
):
    simulated, port = server.device, server.port
    server.stop()
    _hear(guard, "cannot: ")
    with SimulatorServer(simulated, ScaledClock(SPEED), port=port) as again:
        assert _hear(guard, "ready")[-1] == "ready"
        guard.stop()
        _hear(guard, "at rest")
        assert not _turning(again)


def test_no_table_and_no_address_are_told_when_the_guard_starts(server: Served):
    with pytest.raises(LinkLost):
        Guard(_address(server).partition("?")[0])
    server.stop()
    _until(lambda: not server._thread.is_alive())
    with pytest.raises(LinkLost):
        Guard(_address(server))


@pytest.mark.slow
def test_a_table_that_does_not_answer_at_first_is_found_all_the_same(
    server: Served, monkeypatch: pytest.MonkeyPatch
):
    class Deaf:
        def feed(self, data: bytes) -> bytes:
            return b""

    session, first = server.device.session, [Deaf()]
    monkeypatch.setattr(server.device, "session", lambda: first.pop() if first else session())
    with Guard(_address(server)) as guard:
        assert guard.alive
    assert not first


def test_a_guard_that_is_killed_is_no_longer_alive_and_hears_nothing(guard: Guard):
    guard._process.send_signal(signal.SIGKILL)
    _until(lambda: not guard.alive)
    guard.beat()
    assert not guard.stop()


def test_a_guard_told_to_end_stops_the_table_first(server: Served, guard: Guard):
    guard._process.terminate()
    assert _hear(guard, "at rest") == [
        "stopping: the guard process received a signal to end",
        "at rest",
    ]
    _until(lambda: not guard.alive)
    assert not _turning(server)


def test_a_guard_that_is_frozen_keeps_no_host_waiting(guard: Guard):
    guard._process.send_signal(signal.SIGSTOP)
    begun = monotonic()
    while guard._write(b"." * 4096):
        pass
    guard._beat_time = -1.0
    guard.beat()
    assert not guard.stop()
    assert monotonic() - begun < PATIENCE
    guard._process.send_signal(signal.SIGCONT)


def test_a_motor_on_a_serial_port_is_the_hosts_alone_until_it_is_stopped():
    with SimulatorServer(SimulatedMotor(), ScaledClock(SPEED), terminal=True) as server:
        with server.lock:
            server.device._answer_line("ACL 100")
            server.device._answer_line("JOG 90")
        with Guard(f"motor:{server.address}?baud=9600") as guard:
            assert server.faults.replies == 0
            _until(lambda: abs(server.device.table.state[0].rate) > 1)
            guard.stop()
            _hear(guard, "at rest")
            assert abs(server.device.table.state[0].rate) < radians(1)


# What happens to hosts, in a process that can be killed.

HOST = """
import sys
from collections import deque
from itertools import repeat
from inercal.host.guard import Guard

guard = Guard(sys.argv[1], silence=float(sys.argv[2]))
with guard, guard.catch_signals():
    if sys.argv[3] == "beats":
        guard.beat()
    print(f"guarded by {guard._process.pid}", flush=True)
    if sys.argv[3] == "beats":
        while not guard.signal_received:
            guard.beat()
        print("interrupted", flush=True)
    if sys.argv[3] == "busy":
        # One call of C, within which no other thread and no handler of Python's runs.
        deque(repeat(0, 10**12), maxlen=0)
"""


@contextmanager
def _host(server: Served, silence: float, does: str) -> Iterator[tuple[Any, int]]:
    command = [sys.executable, "-c", HOST, _address(server), str(silence), does]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as host:
        assert host.stdout
        guard = int(host.stdout.readline().split()[-1])
        try:
            yield host, guard
        finally:
            host.kill()
            _until(lambda: _ended(guard))  # as long as there is a table


def _ended(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return True


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP])
def test_a_host_that_is_killed_or_frozen_has_its_table_stopped(
    server: Served, table: Pmac, how: signal.Signals
):
    with _host(server, 0.5, "beats") as (host, guard):
        assert _turning(server)
        host.send_signal(how)
        _until(lambda: not _turning(server))
        if how == signal.SIGKILL:
            _until(lambda: _ended(guard))
        else:
            host.send_signal(signal.SIGCONT)
            assert host.poll() is None
    assert table.read().axes[2].enabled


def test_a_signal_stops_the_table_and_is_told_to_the_host(server: Served, table: Pmac):
    with _host(server, 5.0, "beats") as (host, guard):
        host.send_signal(signal.SIGTERM)
        assert host.stdout.readline() == b"interrupted\n"
        _until(lambda: not _turning(server))
        assert host.wait(PATIENCE) == 0
        _until(lambda: _ended(guard))


def _sleeps(ready: Any) -> None:
    ready.set()
    Event().wait(PATIENCE)


def test_no_other_process_keeps_the_end_of_the_host_from_being_seen(
    server: Served, table: Pmac, guard: Guard
):
    command = [sys.executable, "-c", "import time; print(flush=True); time.sleep(60)"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, close_fds=False) as other:
        context = get_context("fork")
        ready = context.Event()
        forked = context.Process(target=_sleeps, args=(ready,))
        forked.start()
        try:
            assert other.stdout
            other.stdout.readline()
            assert ready.wait(PATIENCE)
            guard._close_pipe()  # as the system does of a host that is killed
            assert _hear(guard, "at rest") == ["stopping: the host is gone", "at rest"]
            _until(lambda: not guard.alive)
        finally:
            other.kill()
            forked.kill()
            forked.join()


@pytest.mark.wall_time
@pytest.mark.parametrize("trials", [10, pytest.param(100, marks=pytest.mark.slow)])
def test_from_a_signal_to_the_abort_at_the_controller_are_100_ms_at_most(
    server: Served, table: Pmac, trials: int
):
    """Each time while one call of C has the host's interpreter locked."""
    heard = Event()
    at = 0.0
    carry_out = server.device.interpreter.execute_control

    def control(character: int) -> None:
        nonlocal at
        if character == 0x01 and not heard.is_set():
            at = monotonic()
            heard.set()
        carry_out(character)

    server.device.interpreter.execute_control = control
    table.stop()
    _until(lambda: not _turning(server))
    random = Random(8)

    def measured() -> list[float]:
        latencies: list[float] = []
        for trial in range(trials):
            replies = server.faults.replies
            heard.clear()
            begun = monotonic()
            host.send_signal(signal.SIGINT if trial % 2 else signal.SIGTERM)
            assert heard.wait(PATIENCE)
            latencies.append(at - begun)
            # The abort, the look behind it and two that find the table at rest; then at any moment.
            _until(lambda most=replies + 4: server.faults.replies >= most)
            pause = monotonic() + random.uniform(0.06, 0.12)
            _until(lambda pause=pause: monotonic() > pause)
        print(
            f"{sorted(latencies)[trials // 2] * 1e3:.2f} ms, at most {max(latencies) * 1e3:.2f} ms"
        )
        return latencies

    with _host(server, 1000.0, "busy") as (host, _):
        assert max(measured()) <= 0.1
