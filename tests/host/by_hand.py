"""A session by hand at the bench within the test's process: what is asked for when, and what moves.

Time passes only while the host sleeps, so that a test sees every servo cycle of what it asks for.
"""

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from math import degrees
from pathlib import Path

import pytest
from tests.host.conftest import ScriptedLink
from tests.host.in_process_bench import ADDRESSES, InProcessBench, Port, ReplacedGuard

from inercal.host import clock, imu_port, link, table_driver
from inercal.host.addresses import DeviceAddresses
from inercal.host.journal import Journal, JournalEvent
from inercal.host.manual import dead_man, session
from inercal.host.manual import imu as manual_imu
from inercal.host.manual.commands import parse_command
from inercal.host.manual.session import ManualSession
from inercal.host.sim.bench_simulator import COUNTS_PER_TURN, BenchDevice
from inercal.host.sim.pmac import SimulatedPmac
from inercal.runfile import Run

_CLOCK_READERS = (clock, dead_man, imu_port, session, table_driver)
Act = Callable[["ByHand"], None]


def pmac_of(device: BenchDevice) -> SimulatedPmac:
    """Return the controller of a table of angles."""
    assert isinstance(device.controller, SimulatedPmac)
    return device.controller


class ByHand:
    """A session with a script: acts, each at a time of the bench.

    Attributes
    ----------
    bench : InProcessBench
    session : ManualSession
    rates : list of (float, list of float)
        Time of the bench, s, and rates of the axes, °/s, each time that the host looks.
    """

    def __init__(
        self, run: Run, folder: Path, monkeypatch: pytest.MonkeyPatch, *, imu: bool = False
    ):
        self.bench = InProcessBench(run)
        self._folder, self._run, self._imu = folder, run, imu
        self._script: list[tuple[float, Act]] = []
        self.trace: list[Moment] = []
        for module in _CLOCK_READERS:
            monkeypatch.setattr(module, "monotonic", self.bench.monotonic)
        monkeypatch.setattr(clock, "sleep", self._pass)
        monkeypatch.setattr(link, "open_link", lambda _: ScriptedLink(self.bench.answer()))
        monkeypatch.setattr(session, "TableLock", lambda *_: nullcontext())
        monkeypatch.setattr(session, "Guard", lambda *_, **__: ReplacedGuard(self.bench))
        monkeypatch.setattr(session, "open_table", lambda *_: self.bench.table())
        monkeypatch.setattr(
            manual_imu, "open_imu", lambda _, now, *__, **___: Port(self.bench, now)
        )
        self.events: tuple[JournalEvent, ...] = ()

    def ask(self, what: str, **fields: object) -> Act:
        """Return an act that asks for something as Ada."""
        return lambda my: my.session.request("Ada", parse_command({"what": what, **fields}))

    def limit(self, motor: int, low: float, high: float) -> None:
        """Set the soft limits of a motor, °."""
        counts = COUNTS_PER_TURN / 360
        line = f"I{motor}13={high * counts:.0f} I{motor}14={low * counts:.0f}"
        pmac_of(self.bench.device).interpreter.execute_line(line.encode(), 1)

    def operate(self, *script: tuple[float, Act], until: float) -> str:
        """Carry out a script, s of the bench; return why the session ended."""
        self._script = [*script, (until, lambda my: my.session.end("the script is over"))]
        with Journal.create(
            self._folder / "manual.journal", "plan.toml", ADDRESSES, 0.02, 0
        ) as journal:
            addresses = DeviceAddresses(ADDRESSES[0], ADDRESSES[1] if self._imu else "")
            with ManualSession(self._run, journal, addresses) as self.session:
                ended = self.session.operate()
            self.events = journal.events()
        return ended

    def said(self, level: str) -> list[str]:
        """Return what the journal has of a level."""
        return [event.words for event in self.events if event.level == level]

    def _pass(self, seconds: float) -> None:
        """Let time pass cycle by cycle nearly, and do what is due."""
        end = self.bench.time + seconds
        while self.bench.time < end:
            self.bench.advance(min(0.005, end - self.bench.time))
            table = pmac_of(self.bench.device).table
            angles = [degrees(x.encoder - x.zero) for x in table.state]
            self.trace.append(
                Moment(self.bench.time, angles, [degrees(x.rate) for x in table.state])
            )
            while self._script and self._script[0][0] <= self.bench.time:
                self._script.pop(0)[1](self)


@dataclass(frozen=True)
class Moment:
    """Time of the bench, s, and the true angles from the zeros and rates of the axes, °, °/s."""

    time: float
    angles: Sequence[float]
    rates: Sequence[float]
