"""The simulated bench: time that is granted, motion that the IMU feels, the same bytes always."""

import shlex
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from threading import Thread
from time import monotonic

import numpy as np
import pytest
from tests.refusals import refused

from inercal.basics.units import Measured
from inercal.benches import Turntable
from inercal.benches.turntable.attitude import ideal_readback
from inercal.host.bench_simulator import BenchSimulator
from inercal.host.clock import SimulatedClock, Tick
from inercal.host.drivers.pmac import Pmac, PmacAxis
from inercal.host.link import open_link
from inercal.host.packets import Decoder, read_layout
from inercal.host.packets.encode import PacketPacker
from inercal.host.sim import bench_simulator as bench_module
from inercal.host.sim.bench_simulator import (
    COUNTS_PER_TURN,
    BenchDevice,
    ClockServer,
    GrantedClock,
)
from inercal.host.sim.imu_model import SimulatedImu
from inercal.host.sim.mimu import PacketSender, serve_motion
from inercal.host.sim.server import SimulatorServer
from inercal.host.sim.simulated_errors import draw_errors
from inercal.runfile import Run, read

MIMU = Path(__file__).parents[2] / "examples" / "turntable" / "mimu.toml"
AXES = tuple(
    PmacAxis(name, i, COUNTS_PER_TURN) for i, name in enumerate(("outer", "middle", "inner"), 1)
)
LAYOUT = read_layout("fixed")


class MessageHistory:
    """A port that keeps what is sent."""

    address = "kept"

    def __init__(self):
        self.data = b""

    def write(self, data: bytes) -> int:
        self.data += data
        return len(data)

    def close(self) -> None: ...


class Whole:
    """A bench, its clock and its IMU in one process."""

    def __init__(self, run: Run, seed: int, stack: ExitStack, silence: float = 1e9):
        drawn = draw_errors(run, seed)
        self.port = MessageHistory()
        self.sender = PacketSender(PacketPacker(LAYOUT, 200.0), lambda: self.port, seed)
        mine, other = socket.socketpair()
        feeling = Thread(
            target=serve_motion,
            args=(other, [(SimulatedImu(run, drawn, 200.0, 60.0), self.sender)]),
        )
        feeling.start()
        stack.callback(other.close)
        stack.callback(feeling.join)
        stack.callback(mine.close)
        self.bench = BenchDevice(drawn, mine)
        self.pace = GrantedClock(silence)
        self.server = SimulatorServer(self.bench, self.pace)
        clock = ClockServer(self.server, self.pace)
        stack.enter_context(self.server)
        self.clock_address = clock.address
        self.clock = SimulatedClock(clock.address)
        stack.callback(self.clock.close)
        self.table = stack.enter_context(Pmac(self.server.address, AXES, timeout=20.0))
        self.table.enable()

    def until(self, time: float) -> Tick:
        self.clock.begin(time)
        return self.clock.end()


@contextmanager
def _whole(run: Run, seed: int = 0, silence: float = 1e9) -> Iterator[Whole]:
    with ExitStack() as stack:
        yield Whole(run, seed, stack, silence)


@pytest.fixture(scope="module")
def run() -> Run:
    return read(MIMU)


@pytest.fixture
def whole(run: Run) -> Iterator[Whole]:
    with _whole(run) as made:
        yield made


class Wall:
    passed = 0.0


@pytest.fixture
def wall(monkeypatch: pytest.MonkeyPatch) -> Wall:
    made = Wall()
    monkeypatch.setattr(bench_module, "monotonic", lambda: 70.0 + made.passed)
    return made


def test_before_the_first_grant_time_stands_still(wall: Wall):
    pace = GrantedClock()
    wall.passed = 100.0
    assert pace() == 0.0
    pace.release()
    wall.passed = 200.0
    assert pace() == 0.0


def test_some_time_after_the_last_grant_time_goes_on_as_the_walls(wall: Wall):
    pace = GrantedClock(silence=1.0)
    assert pace.grant(5.0) == 5.0
    wall.passed = 0.99
    assert pace() == 5.0
    wall.passed = 3.0
    assert pace() == pytest.approx(7.0)
    assert pace.grant(6.0) == pytest.approx(7.0)  # has been
    wall.passed = 3.9
    assert pace() == pytest.approx(7.0)


def test_let_go_time_goes_on_at_once(wall: Wall):
    pace = GrantedClock()
    pace.grant(1.0)
    pace.release()
    wall.passed = 0.5
    assert pace() == pytest.approx(1.5)


def test_what_is_sent_is_told_of_the_grant_before(whole: Whole):
    assert whole.until(0.1)[:3] == (0.1, 0, 0.0)
    assert whole.until(0.2)[:3] == (0.2, 36 * 20, 0.1)
    # Where no time passes there is nothing to wait for later.
    assert whole.until(0.2)[:3] == (0.2, 36 * 40, 0.2)
    assert whole.until(0.1)[:3] == (0.2, 36 * 40, 0.2)
    assert len(whole.port.data) == 36 * 40


def test_the_table_is_polled_at_the_time_that_was_granted(whole: Whole):
    for k in range(1, 6):
        whole.until(k * 0.02)
        assert whole.bench.time == pytest.approx(k * 0.02, abs=whole.table.period)
        before = whole.bench.time
        whole.table.read()
        assert whole.bench.time == before


def test_a_host_that_leaves_lets_the_bench_go_on(whole: Whole):
    whole.until(0.5)
    whole.clock.close()
    end = monotonic() + 20.0
    while whole.bench.time < 0.6:
        assert monotonic() < end
    again = SimulatedClock(whole.clock_address)
    assert again.now() >= 0.6
    again.close()


def test_a_host_that_is_silent_is_not_waited_for_and_may_come_back(run: Run):
    with _whole(run, silence=0.05) as whole:
        whole.until(0.5)
        end = monotonic() + 20.0
        while whole.bench.time < 0.7:
            assert monotonic() < end
        tick = whole.until(0.0)
        assert tick.time >= 0.7
        assert tick.bytes_sent == 36 * int(tick.time * 200 + 1e-6)
        assert tick.sent_time == tick.time


def test_what_is_no_request_is_answered_by_those_there_are(whole: Whole):
    with open_link(whole.clock_address.replace("clock", "tcp")) as link:
        for words in (b"until x\n", b"until nan\n", b"until inf\n", b"burn\n"):
            link.write(words)
            assert link.read(100, 20.0) == b"no: possible: until TIME, now, mounted NAME\n"


def _carried_out(run: Run, seed: int, size: float, idle: bool) -> tuple[bytes, list[str]]:
    """Return what IMU and table say in a few seconds, granted `size` s at a time."""
    states: list[str] = []
    with _whole(run, seed) as whole:
        for k in range(1, round(4.0 / size) + 1):
            whole.until(k * size)
            if idle and k % 7 == 0:
                whole.table.read()
            time = round(k * size, 9)
            if time % 1.0 == 0.0:
                states.append(repr(whole.table.read().axes))
            if time == 1.0:
                whole.table.spin("inner", 1.0, 2.0)
                whole.table.move("outer", 1.0, 0.5, 0.5)
            if time == 3.0:
                whole.table.home()
        whole.until(4.0)
        return whole.port.data, states


def test_the_same_seed_gives_the_same_bytes_however_time_is_granted(run: Run):
    data, states = _carried_out(run, 3, 0.02, idle=False)
    assert len(data) == 36 * 800
    assert _carried_out(run, 3, 0.5, idle=False) == (data, states)
    assert _carried_out(run, 3, 0.02, idle=True) == (data, states)
    other, elsewhere = _carried_out(run, 4, 0.02, idle=False)
    assert other != data
    assert elsewhere != states


def test_the_readback_is_that_of_the_bench(run: Run):
    assert isinstance(run.bench, Turntable)
    bench = replace(run.bench, white=0.0, latency=Measured(0.004, 0.0), harmonics=(1e-3, 5e-4))
    with _whole(replace(run, bench=bench), seed=5) as whole:
        drawn = draw_errors(replace(run, bench=bench), 5)
        assert drawn.values["sin1[inner]"] != 0
        whole.table.spin("inner", 0.5, 2.0)
        whole.table.spin("outer", -0.3, 2.0)
        whole.until(2.0)
        said = [axis.angle for axis in whole.table.read().axes]
        late = drawn.latencies(whole.table.period)[1]
        now = whole.bench.controller.table.state
        true = np.array([now["encoder"] - now["rate"] * late])
        # The encoders count from where the table stood when it was switched on.
        q = {name: np.asarray(value) for name, value in drawn.values.items()}
        exact = ideal_readback(bench, true, q)[0] - now["zero"]
        np.testing.assert_allclose(said, exact, rtol=0, atol=2 * 2 * np.pi / COUNTS_PER_TURN)


@pytest.mark.slow
def test_noise_of_the_readback_is_of_its_cycle_however_often_it_is_asked_for(run: Run):
    assert isinstance(run.bench, Turntable)
    noisy = replace(run, bench=replace(run.bench, white=1e-4, harmonics=()))
    with _whole(noisy) as whole:
        said = []
        for k in range(1, 401):
            whole.until(k * 0.01)
            first, second = whole.table.read(), whole.table.read()
            assert first == second
            said.append(first.axes[2].angle)
        assert np.std(said) == pytest.approx(1e-4, rel=0.15)


def test_the_controller_allows_what_the_run_file_allows(run: Run):
    assert isinstance(run.bench, Turntable)
    (limits,) = run.bench.limits
    fast = replace(run, bench=replace(run.bench, limits=(replace(limits, rate=10.0),)))
    with _whole(fast) as whole:
        assert all(limit.rate >= 10.0 - 1e-6 for limit in whole.table.limits)


def test_the_table_goes_on_where_the_imu_is_gone(run: Run):
    drawn = draw_errors(run, 0)
    mine, other = socket.socketpair()
    bench = BenchDevice(drawn, mine)
    other.close()
    bench.advance(1.0)
    bench.synchronise_imu()
    assert bench.time == pytest.approx(1.0, abs=1e-3)
    assert bench.bytes_sent == 0


def test_a_latency_beyond_the_tables_memory_is_refused(run: Run):
    assert isinstance(run.bench, Turntable)
    late = replace(run, bench=replace(run.bench, latency=Measured(5.0, 0.0)))
    with refused(key="[bench] latency", file=late.path):
        draw_errors(late, 0)


def _run_once(seed: int, **options: object) -> tuple[bytes, str]:
    """Return what IMU and table say in half a second of a bench in processes of its own."""
    with BenchSimulator(MIMU, seed=seed, rate_hz=200.0, **options) as bench:  # pyright: ignore[reportArgumentType]
        assert bench.clock is not None
        place, _, rest = bench.table.partition("?")
        assert rest == "motors=1,2,3&counts=3600000"
        clock = SimulatedClock(bench.clock)
        with (
            open_link(bench.imu.partition("?")[0]) as imu,
            Pmac(place.replace("pmac", "tcp"), AXES, timeout=20.0) as table,
        ):
            table.enable()
            table.spin("middle", 0.4, 1.0)
            data, tick = b"", Tick(0.0, 0, 0.0)
            for k in range(1, 26):
                clock.begin(k * 0.02)
                tick = clock.end()
                assert tick.bytes_sent is not None
                while len(data) < tick.bytes_sent:
                    data += imu.read(tick.bytes_sent - len(data), 20.0)
            said = repr(table.read())
            bench.inject_fault("imu", "fault silent on")
            with refused(key="fault", names=("imu",)):
                bench.inject_fault("imu", "fault burn")
            bench.inject_fault("table", "fault amplifier 2")
            with refused(key="fault", names=("table",)):
                bench.inject_fault("table", "fault melted 2")
            bench.inject_fault("imu", "die")
            with refused(key=None, names=("imu",)):
                bench.inject_fault("imu", "fault silent off")
        clock.close()
    return data, said


@pytest.mark.slow
def test_processes_of_their_own_give_the_same_bytes_at_a_terminal_and_at_tcp():
    data, said = _run_once(8)
    counter = Decoder(LAYOUT).feed(data).counter
    assert counter is not None
    assert counter.tolist() == list(range(96))
    assert _run_once(8, terminal=False) == (data, said)


@pytest.mark.slow
def test_at_a_pace_of_its_own_the_bench_waits_for_nobody():
    with BenchSimulator(MIMU, pace=50.0, terminal=False) as bench:
        assert bench.clock is None
        place = bench.table.partition("?")[0].replace("pmac", "tcp")
        with (
            Pmac(place, AXES, timeout=20.0) as table,
            open_link(bench.imu.partition("?")[0]) as imu,
        ):
            begun, first = monotonic(), table.read().time
            while table.read().time < first + 5.0:
                assert monotonic() < begun + 20.0
            assert imu.read(36, 20.0)


@pytest.mark.slow
def test_the_command_serves_without_an_input_until_it_is_interrupted():
    """As a service or by nohup, standard input has ended when it begins."""
    with subprocess.Popen(
        [sys.executable, "-m", "inercal", "bench", "simulate", str(MIMU), "--tcp"],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as served:
        assert served.stdout
        words = shlex.split(served.stdout.readline())
        place = words[words.index("--imu") + 1].partition("?")[0]
        with open_link(place, 20.0):
            assert served.poll() is None
        served.send_signal(signal.SIGINT)
        assert served.wait(20.0) not in (0, 2)


@pytest.mark.slow
def test_a_bench_that_cannot_be_simulated_says_so(tmp_path: Path):
    with refused(names=("imu",)):
        BenchSimulator(MIMU, preset="morse")
    with refused(key="[bench] kind", file="run.toml"):
        BenchSimulator(MIMU.parents[1] / "six_position" / "run.toml")
