"""A simulated bench within the test's process, whose time passes only while the host sleeps.

Controller, IMU and packets are those of the simulator; there is no process, socket or thread. The
host drives it by its own monotonic clock, as it does a bench of iron, so that a run of a minute
takes seconds and every test of it sees the same bytes.
"""

from collections.abc import Callable, Generator
from contextlib import contextmanager, nullcontext

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.host.conftest import ScriptedLink

from inercal.host import (
    bench_run,
    clock,
    imu_port,
    interruptions,
    link,
    recorder,
    soaks,
    table_driver,
)
from inercal.host.clock import HostUptime
from inercal.host.drivers.motor import Motor
from inercal.host.drivers.pmac import Pmac, PmacAxis
from inercal.host.drivers.rotary_table import AxisLimits
from inercal.host.packets import read_layout
from inercal.host.packets.encode import PacketPacker
from inercal.host.sim.bench_simulator import COUNTS_PER_TURN, BenchDevice
from inercal.host.sim.chamber import SimulatedChamber
from inercal.host.sim.imu_model import SimulatedImu
from inercal.host.sim.motion_link import MotionBlock
from inercal.host.sim.motor import SimulatedMotor
from inercal.host.sim.simulated_errors import draw_errors
from inercal.runfile import Run

ADDRESSES = (
    f"pmac://127.0.0.1:9?motors=1,2,3&counts={COUNTS_PER_TURN}",
    "tcp://127.0.0.1:9?preset=fixed",
    "",
)
_LAYOUT = read_layout("fixed")
_HOST_START = 50.0  # s of the host's monotonic clock when the bench's time is 0
_CLOCK_READERS = (bench_run, clock, imu_port, interruptions, recorder, table_driver)


class InProcessBench:
    """Table and IMU of a run file, and the clocks of their host.

    Attributes
    ----------
    time : float
        Of the bench, s.
    utc_step : float
        s by which the host's date has been set on.
    boot : str
        Which boot the host is in.
    garbled : bool
        The IMU sends zeros instead of packets.
    counter_error : int
        By so much the IMU's counter is too high.
    commands : list of str
        What the host has told the controller.
    chamber : SimulatedChamber or None
        The chamber around the table, if a test has put it there.
    """

    chamber: SimulatedChamber | None = None

    def __init__(self, run: Run, seed: int = 1):
        self._run, self._drawn = run, draw_errors(run, seed)
        self.device = BenchDevice(self._drawn)
        self._period = self.device.controller.table.period
        self._rate = run.rate_hz or 200.0
        self._packer = PacketPacker(_LAYOUT, self._rate)
        self.time, self.utc_step, self.boot, self.garbled = 0.0, 0.0, "first", False
        self.counter_error = 0
        self.commands: list[str] = []
        self.restart_imu()

    def restart_imu(self) -> None:
        """Switch the IMU on, or off and on: its counter begins at 0, now."""
        table = self.device.controller.table
        # The biases drift through all soaks of a run in one block of noise.
        seconds = 600.0 if self.chamber is None else 2000.0
        self._imu = SimulatedImu(self._run, self._drawn, self._rate, seconds)
        self._imu_start = self.time, table.cycle
        self.pieces: list[tuple[float, bytes]] = []
        standing = np.zeros((1, len(table.axes), 3))
        standing[0, :, 0] = table.state.angle
        self._feel(self.time, table.cycle, standing)

    def _feel(self, until: float, first_cycle: int, moved: NDArray[np.float64]) -> None:
        start, cycle = self._imu_start
        number = self._imu.next_number
        kelvin = np.nan if self.chamber is None else self.chamber.case_temperature
        part = MotionBlock(
            until - start, self._period, first_cycle - cycle, moved, self.device.mounting, kelvin
        )
        readings = self._imu.read_block(part)
        if data := b"".join(self._packer(number + self.counter_error, readings, kelvin)):
            self.pieces.append((until, bytes(len(data)) if self.garbled else data))

    def advance(self, seconds: float) -> None:
        """Let time pass."""
        self.time += seconds
        table = self.device.controller.table
        first = table.cycle + 1
        self._feel(self.time, first, table.advance(self.time))

    def monotonic(self) -> float:
        return _HOST_START + self.time

    def utc(self) -> float:
        return 1.8e9 + self.time + self.utc_step

    def fault(self, words: str) -> None:
        self.device.fault(words)

    def answer(self) -> Callable[[bytes], bytes]:
        """Return what a new connection to the controller answers."""
        session = self.device.session()

        def feed(data: bytes) -> bytes:
            self.commands.append(data[8:].decode("ascii", "replace"))
            return session.feed(data)

        return feed

    def stop(self) -> None:
        """Stop the table as a watchdog does, and see it at rest."""
        for i in range(len(self.device.controller.table.axes)):
            self.device.controller.table.halt(i, abort=True)
        self.advance(10.0)

    def install(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Have the host's modules find this bench, and its clocks, instead of devices."""
        for module in _CLOCK_READERS:
            monkeypatch.setattr(module, "monotonic", self.monotonic)
        monkeypatch.setattr("time.time", self.utc)
        monkeypatch.setattr(clock, "sleep", self.advance)
        for module in (bench_run, recorder):
            monkeypatch.setattr(
                module, "read_host_uptime", lambda: HostUptime(self.boot, 1000.0 + self.time)
            )
        monkeypatch.setattr(link, "open_link", lambda _: ScriptedLink(self.answer()))
        monkeypatch.setattr(bench_run, "TableLock", lambda *_: nullcontext())
        monkeypatch.setattr(bench_run, "Guard", lambda *_, **__: ReplacedGuard(self))
        monkeypatch.setattr(bench_run, "open_table", lambda *_: self.table())
        port = soaks.ChamberPort
        monkeypatch.setattr(
            soaks, "ChamberPort", lambda opener, **_: port(opener, synchronous=True)
        )
        monkeypatch.setattr(soaks, "open_chamber", lambda *_: self.chamber)
        monkeypatch.setattr(bench_run, "open_imu", lambda _, now, *__, **___: Port(self, now))

    def table(self) -> Pmac | Motor:
        """Return the table as a driver."""
        if isinstance(self.device.controller, SimulatedMotor):
            (limit,) = self._drawn.bench.axis_motion_limits
            limits = AxisLimits(limit.rate, limit.acceleration)
            return Motor("tcp://9", limits)
        names = [axis.name for axis in self.device.controller.table.axes]
        axes = [PmacAxis(name, motor, COUNTS_PER_TURN) for motor, name in enumerate(names, 1)]
        return Pmac("tcp://127.0.0.1:9", axes)


class ReplacedGuard:
    """A watchdog that stops the table at once."""

    def __init__(self, bench: InProcessBench):
        self.alive, self.signal_received, self.axis_killed = True, False, False
        self._bench, self._lines = bench, list[str]()

    def stop(self) -> bool:
        self._bench.stop()
        self._lines = ["stopping: the host requested it", "at rest"]
        return True

    def read_lines(self) -> list[str]:
        lines, self._lines = self._lines, []
        return lines

    def beat(self) -> None: ...
    def close(self) -> None: ...
    def release_to_guard(self) -> None: ...

    @contextmanager
    def catch_signals(self) -> Generator[None]:
        yield

    def __enter__(self) -> "ReplacedGuard":
        return self

    def __exit__(self, *_: object) -> None: ...


class Port:
    """The IMU's port: what came before it was opened is lost."""

    def __init__(self, bench: InProcessBench, now: Callable[[], float]):
        self._bench, self._now = bench, now
        bench.pieces.clear()

    def take(self, total_bytes: int | None = None) -> list[tuple[float, bytes]]:
        offset = self._now() - self._bench.time
        pieces = [(time + offset, data) for time, data in self._bench.pieces]
        self._bench.pieces.clear()
        return pieces

    def close(self) -> None: ...
