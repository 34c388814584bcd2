"""A bench within the test's process with three IMUs on its table."""

from collections.abc import Callable
from concurrent.futures import Future
from math import nan
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from numpy.typing import NDArray
from tests.host.in_process_bench import ADDRESSES, InProcessBench
from tests.host.watched_runs import Act, Driven, Watched

from inercal.host import further_imus
from inercal.host.addresses import DeviceAddresses
from inercal.host.link import LinkLost
from inercal.host.run_folder import create_run, reopen_run
from inercal.host.sim.imu_model import SimulatedImu
from inercal.host.sim.motion_link import MotionBlock
from inercal.host.sim.simulated_errors import numbered_imu
from inercal.runfile import Run

FURTHER = {f"imu{n}": f"tcp://127.0.0.1:{n}?preset=fixed" for n in (2, 3)}


class FurtherPort:
    """The port of a further IMU, and what it has sent."""

    def __init__(self, bench: "SeveralImus", imu: SimulatedImu):
        self.bench, self.imu = bench, imu
        self.pieces: list[tuple[float, bytes]] = []
        self.gone = False
        self.now: Callable[[], float] = lambda: nan

    def take(self, total_bytes: int | None = None) -> list[tuple[float, bytes]]:
        offset = self.now() - self.bench.time
        pieces, self.pieces = self.pieces, []
        if self.gone:
            raise LinkLost("nobody answers")
        return [(time + offset, data) for time, data in pieces]

    def close(self) -> None: ...


class SeveralImus(InProcessBench):
    """A bench on which two further IMUs sense the same motion."""

    further: dict[str, FurtherPort]

    def restart_imu(self) -> None:
        seconds = 600.0 if self.chamber is None else 2000.0
        self.further = {}
        for number, address in enumerate(FURTHER.values(), start=2):
            run, drawn = numbered_imu(self._run, self._drawn, number)
            self.further[address] = FurtherPort(self, SimulatedImu(run, drawn, self._rate, seconds))
        super().restart_imu()

    def _feel(self, until: float, first_cycle: int, moved: NDArray[np.float64]) -> None:
        super()._feel(until, first_cycle, moved)
        start, cycle = self._imu_start
        kelvin = np.nan if self.chamber is None else self.chamber.case_temperature
        part = MotionBlock(until - start, self._period, first_cycle - cycle, moved, "", kelvin)
        for port in self.further.values():
            number = port.imu.next_number
            if data := b"".join(self._packer(number, port.imu.read_block(part), kelvin)):
                port.pieces.append((until, data))

    def install(self, monkeypatch: pytest.MonkeyPatch) -> None:
        super().install(monkeypatch)
        monkeypatch.setattr(further_imus, "ThreadPoolExecutor", NoThread)
        monkeypatch.setattr(further_imus, "open_imu", self._open)

    def _open(self, address: str, now: Callable[[], float], *_: object, **__: object) -> Any:
        port = self.further[address]
        if port.gone:
            raise LinkLost("nobody answers")
        port.now = now
        port.pieces.clear()
        return port


class NoThread:
    """Does at once what a thread would do."""

    def __init__(self, workers: int): ...

    def submit(self, work: Callable[[float], object], timeout: float) -> Future[object]:
        future: Future[object] = Future()
        try:
            future.set_result(work(timeout))
        except LinkLost as error:
            future.set_exception(error)
        return future

    def shutdown(self) -> None: ...


def drive_all(folder: Path, act: Act, run: Run | None = None, chamber: str = "") -> Driven:
    """Begin a run that reads all IMUs, or resume the one in the folder."""
    made, journal = (
        reopen_run(folder)
        if run is None
        else create_run(folder, run, ADDRESSES, 0.05, chamber=chamber, further_imus=FURTHER)
    )
    with journal:
        said = len(journal.events())
        with Watched(made, journal, DeviceAddresses(*ADDRESSES)) as driven:
            driven.act = act
            done = driven.execute_plan()
        return Driven(done, driven.trouble, journal.events(said))


def recorded(path: Path) -> dict[str, NDArray[Any]]:
    """Return the columns of a recording, and of the bench's group after a slash."""
    file: Any
    with h5py.File(path) as file:
        columns = {name: file[name][:] for name in file if name != "bench"}
        return columns | {f"bench/{name}": one[:] for name, one in file["bench"].items()}
